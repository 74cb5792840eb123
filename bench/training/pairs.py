"""Images with those before them and exact masks of what moves, for any network."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Literal

from bench.errors import DataError
from bench.harness.datasets import Dataset, Frame, open_dataset

DATASET = "training"
VALIDATION = "validation"
SplitPart = Literal["training", "validation", "all"]


def training_pairs(
    dataset: str | Path = DATASET,
    *,
    part: SplitPart = "training",
    every: int = 1,
    longest_history: int = 1,
    colour: bool = False,
    workers: int = 1,
) -> Iterator[Frame]:
    """Images, each with the one before it and the exact mask of what moves.

    Args:
        dataset: a rendered data set, by name or card; it is rendered first where it is missing.
        part: the drives of the data set's split "validation", all others, or all. A drive is in one part as a whole.
        every: 1 for every pair of a drive and camera, 2 for every second and so on; neighbours differ little.
        longest_history: earlier images that come with each where a drive has as many; one at least.
        colour: images are BGR instead of grey.
        workers: processes that render.

    Returns:
        Frames in order of drive, camera and time. `Frame.input` holds both images, lens, road, motion of the camera and
        the valid region, all as NumPy arrays and records; `Frame.exact` is the mask, (H, W) bool.

    Raises:
        UnknownNameError: no data set of this name, or none with a split "validation".
        DataError: the data cannot be used, or have no exact masks.
    """
    names = drives_of(dataset, part, workers=workers)
    data = open_dataset(dataset)
    yield from pairs_of(data, names, every=every, longest_history=longest_history, colour=colour)


def drives_of(dataset: str | Path, part: SplitPart, *, workers: int = 1) -> tuple[str, ...]:
    """Names of the drives of a part; see `training_pairs`."""
    names = open_dataset(dataset, workers=workers).names
    if part == "all":
        return names
    held_out = set(open_dataset(dataset, VALIDATION).names)
    return tuple(name for name in names if (name in held_out) == (part == VALIDATION))


def pairs_of(
    data: Dataset,
    names: Sequence[str],
    *,
    every: int = 1,
    longest_history: int = 1,
    colour: bool = False,
) -> Iterator[Frame]:
    """Pairs of some of a data set's drives; see `training_pairs`."""
    frames = data.frames(
        recordings=names,
        longest_history=longest_history,
        colour=colour,
        exact=True,
    )
    for _, drive in groupby(frames, key=lambda frame: (frame.recording, frame.camera)):
        for number, frame in enumerate(drive):
            if frame.exact is None:
                raise DataError(data.card.file, expected="exact masks, as rendered data have", got="none")
            if number % every == 0:
                yield frame
