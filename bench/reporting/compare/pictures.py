"""Both methods on one frame, side by side: the frames of two runs that changed most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from bench.atomic import write_bytes
from bench.harness import FramePipeline, ProcessedFrame
from bench.harness.stages import Progress
from bench.reporting.canvas import figure_pixels, jpeg_bytes
from bench.reporting.compare.changes import RunComparison
from bench.reporting.formats import image_name
from bench.reporting.frame import Layers, draw_frames, scored_layers
from bench.reporting.frame_pictures import ImageKey, draw_images

Frame = Mapping[Any, Any]  # a row of the frames that changed
PICTURED = 2  # of each kind
QUALITY = 90  # of JPEG; as PNG a picture takes 2 MB


def draw_changed_frames(
    comparison: RunComparison,
    folder: Path,
    *,
    number: int,
    progress: Progress | None = None,
) -> RunComparison:
    """Draw the frames that changed most as both methods were scored on them.

    Args:
        comparison: of two runs.
        folder: of the pictures.
        number: of the comparison, for the names of the files.
        progress: called with the pictures done and their number.

    Returns:
        The comparison with the pictures, and with a line for every reason why one could not be made.
    """
    chosen: dict[ImageKey, dict[str, Frame]] = {}  # by image and name
    largest = comparison.frames.groupby("kind", sort=False).head(PICTURED).to_dict("records")
    for ordinal, frame in enumerate(largest, start=1):
        name = f"{number:02d}-{ordinal:02d}-{frame['kind'].replace(' ', '-')}.jpg"
        chosen.setdefault((frame["recording"], frame["camera"], frame["timestamp_ns"]), {})[name] = frame

    def draw(key: ImageKey, both: Sequence[ProcessedFrame], _: FramePipeline) -> dict[str, Frame]:
        for name, frame in chosen[key].items():
            figure = draw_frames(_sides(frame, both, comparison), name=image_name(*key), title=_headline(frame))
            write_bytes(folder / name, jpeg_bytes(figure_pixels(figure), quality=QUALITY))
        return chosen[key]

    found, problems = draw_images((comparison.before, comparison.after), chosen, draw, progress=progress)
    drawn = {name: frame for of_image in found.values() for name, frame in of_image.items()}
    remarks = tuple(f"no picture: {problem}" for problem in problems)
    return replace(comparison, pictures=dict(sorted(drawn.items())), remarks=remarks)


def frame_title(frame: Frame) -> str:
    """For example "newly missed: pedestrian 'a', crossing, 5.0 m (drive-1, front, 1200 ms)".

    Args:
        frame: with `CHANGED`.
    """
    return f"{_headline(frame)} ({frame['recording']}, {frame['camera']}, {frame['timestamp_ns'] / 1e6:.0f} ms)"


def _headline(frame: Frame) -> str:
    return f"{frame['kind']}: {frame['what']}" if frame["what"] else str(frame["kind"])


def _sides(frame: Frame, both: Sequence[ProcessedFrame], comparison: RunComparison) -> list[Layers]:
    """Each run with its name, and with the coverage of the object where it is one that changed."""
    runs = comparison.before, comparison.after
    numbers = (frame["before"], frame["iou_before"]), (frame["after"], frame["iou_after"])
    sides = []
    for processed, run, method, (value, iou) in zip(both, runs, comparison.methods, numbers, strict=True):
        label = run.label if method == run.label else f"{run.label}: {method}"
        note = f"coverage {100 * value:.1f} %, IoU {100 * iou:.1f} %" if frame["what"] else ""
        sides.append(scored_layers(processed, label=label, note=note))
    return sides
