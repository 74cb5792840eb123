"""What large false patches of a run on rendered data are, by the exact masks of these images and of those before.

python -m benchmarks.false_patches RUN, the folder of a run's results; `--every 3` looks at every third recording. A
patch is a connected area of more pixels than the protocol calls large that is marked, is no object's in the reference
and shows nothing that moves in the exact mask. It is beside an object if a pixel of it is at most `BESIDE_PX` from one
that moves, and was hidden where something moved in one of the images before, at the same pixels but for `SLACK_PX`;
the ego vehicle's motion is left out, so that the share is too low rather than too high.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray

from bench.evaluation.counts import find_regions
from bench.evaluation.rows import EVALUATED, IMAGE
from bench.harness.counts import stored_recordings
from bench.harness.datasets import StoredFrames
from bench.harness.exact import read_exact_mask
from bench.harness.stored import StoredRun, read_run

BEFORE = 3  # images in which something may have hidden a patch, as `learned` looks back
BESIDE_PX, SLACK_PX = 3.0, 2
DARK = 20  # grey value


def patches(run: StoredRun, frames: StoredFrames, images: pd.DataFrame) -> Iterator[dict[str, float]]:
    """Each large false patch of some images, in pixels and shares of its area.

    Args:
        run: the results.
        frames: of the run.
        images: recording, camera and timestamp_ns of each.
    """
    slack = np.ones((2 * SLACK_PX + 1, 2 * SLACK_PX + 1), np.uint8)
    for key in images.itertuples(index=False):
        frame, pipeline = frames.process(*key), frames.pipeline(key.recording, key.camera)
        index = pipeline.images.index(frame.image)
        masks = [
            read_exact_mask(pipeline.images[k], pipeline.recording, pipeline.reference(k))
            for k in range(max(index - BEFORE, 0), index + 1)
        ]
        *earlier, moving = [mask for mask in masks if mask is not None]
        height, width = moving.shape
        false = find_regions(frame.reference, frame.segmentation.mask_at(width, height)).false & ~moving
        hid = cv2.dilate(np.any([np.zeros_like(moving), *earlier], 0).astype(np.uint8), slack)
        away_px = np.asarray(cv2.distanceTransform((~moving).astype(np.uint8), cv2.DIST_L2, 5), np.float32)
        _, labels, boxes, _ = cv2.connectedComponentsWithStats(false.astype(np.uint8))
        large = np.flatnonzero(boxes[:, cv2.CC_STAT_AREA] > run.protocol.scoring.false_positive_component_px)
        for patch in large[large > 0]:
            yield told(labels == patch, hid > 0, away_px, frame.pixels)


def told(
    patch: NDArray[np.bool_], hid: NDArray[np.bool_], away_px: NDArray[np.floating], pixels: NDArray[np.uint8]
) -> dict[str, float]:
    """A patch in numbers."""
    return {
        "px": float(np.count_nonzero(patch)),
        "beside": float(away_px[patch].min() <= BESIDE_PX),
        "hidden": float(hid[patch].mean()),
        "dark": float((pixels[patch] < DARK).mean()),
    }


def main(
    run: Annotated[Path, typer.Argument(help="folder of a run's results on rendered data")],
    every: Annotated[int, typer.Option(min=1, help="looks at every N-th recording")] = 1,
) -> None:
    """Print the share of images with a large false patch, and shares of the patches' area."""
    stored = read_run(run)
    scored = stored.frames([*IMAGE, "status", "fp_large_components"])
    scored = scored[
        (scored["status"] == EVALUATED) & scored["recording"].isin(stored_recordings(stored.folder)[::every])
    ]
    flagged = scored[scored["fp_large_components"] > 0].sort_values(IMAGE)
    found = pd.DataFrame(patches(stored, StoredFrames(stored), flagged[IMAGE]))
    of_area = found[["beside", "hidden", "dark"]].mul(found["px"], axis=0)
    beside = found["beside"] > 0
    typer.echo(f"{len(scored)} images, {100 * len(flagged) / len(scored):.1f} % with a large false component")
    typer.echo(f"{len(found)} patches that show nothing that moves; of their area, in percent:")
    for name, rows in (("all", slice(None)), ("beside an object", beside), ("elsewhere", ~beside)):
        shares = 100 * of_area.loc[rows, ["hidden", "dark"]].sum() / found.loc[rows, "px"].sum()
        part = 100 * found.loc[rows, "px"].sum() / found["px"].sum()
        typer.echo(f"{name}: {part:.0f}; hidden before {shares['hidden']:.0f}, dark {shares['dark']:.0f}")


if __name__ == "__main__":
    typer.run(main)
