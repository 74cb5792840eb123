"""How far trained networks go by looks: `python -m benchmarks.looks NETWORK.onnx ... --cache DIR`.

All that geometry knows of the validation images stays; only how the last of them looks is changed: to its negative, to
a third of its contrast, to none. What a network loses by it, it had by looks. Real bodies look unlike rendered ones but
move alike. Inputs are prepared as `bench.training.train` does, where they are missing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from bench.execution import usable_cores
from bench.methods.learned.inputs import COARSE, FINE, Channels
from bench.methods.learned.method import LearnedMethod
from bench.reporting.document import Table, to_markdown
from bench.training.pairs import DATASET, GREY, LEAST_PX, PreparedDrive, prepare, valid_region, vary

LOOKS = {"as they are": 1.0, "negative": -1.0, "a third of the contrast": 1 / 3, "none": 0.0}  # gains


def iou_by_looks(method: LearnedMethod, drive: PreparedDrive) -> NDArray[np.float64]:
    """IoU of one image of a drive with each of `LOOKS`, (LOOKS,); NaN where next to nothing moves.

    Args:
        method: with the network.
        drive: prepared; its first image is scored.
    """
    card, coarse, fine = method.trained, drive.coarse()[0], drive.fine()[0]
    valid = valid_region(coarse)
    moving = (fine[-1] > 127) & valid
    if moving.sum() < LEAST_PX:
        return np.full(len(LOOKS), np.nan)
    found = []
    for gain in LOOKS.values():
        shown = Channels(coarse=_looking(coarse, COARSE, card.coarse, gain), fine=_looking(fine, FINE, card.fine, gain))
        mask = (method.scores(shown) > card.threshold) & valid
        found.append((mask & moving).sum() / (mask | moving).sum())
    return np.array(found)


def _looking(channels: NDArray[np.uint8], names: Sequence[str], taken: Sequence[str], gain: float) -> NDArray[np.uint8]:
    """The channels that a network takes, the grey one among them of another contrast."""
    chosen = channels[[names.index(name) for name in taken]]
    vary(chosen, [row for row, name in enumerate(taken) if name in GREY], gain)
    return chosen


def table(by_network: Mapping[str, NDArray[np.float64]]) -> str:
    """Markdown: mean IoU in percent as the images are, and points lost by each change.

    Args:
        by_network: (images, LOOKS) of each.
    """
    first, *others = LOOKS
    rows = []
    for name, found in by_network.items():
        whole, *changed = 100 * np.nanmean(found, axis=0)
        rows.append([name, f"{whole:.1f}", *(f"{loss:+.1f}" for loss in np.array(changed) - whole)])
    return to_markdown([Table(columns=["network", first, *others], rows=rows)])


def main(
    networks: Annotated[list[Path], typer.Argument(help="learned.onnx, each beside its card")],
    cache: Annotated[Path, typer.Option(help="folder of prepared inputs, as of bench.training.train")],
    workers: Annotated[int, typer.Option(min=1, help="processes that prepare")] = usable_cores(),
) -> None:
    """Score networks on images that look otherwise."""
    held = prepare(DATASET, "validation", cache, disturbed=True, workers=workers, progress=lambda *_: None)
    methods = {str(file): LearnedMethod(weights=str(file)) for file in networks}
    scored = {name: np.stack([iou_by_looks(method, drive) for drive in held]) for name, method in methods.items()}
    typer.echo(table(scored))


if __name__ == "__main__":
    typer.run(main)
