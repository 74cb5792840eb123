"""The labels of SemanticKITTI, and `.label` files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError
from bench.recordings import write_bytes

# Numbers and names of the data set's configuration; 9 and 251 are those of its moving-object task.
NAMES = {
    0: "unlabeled",
    1: "outlier",
    9: "static",
    10: "car",
    11: "bicycle",
    13: "bus",
    15: "motorcycle",
    16: "on-rails",
    18: "truck",
    20: "other-vehicle",
    30: "person",
    31: "bicyclist",
    32: "motorcyclist",
    40: "road",
    44: "parking",
    48: "sidewalk",
    49: "other-ground",
    50: "building",
    51: "fence",
    52: "other-structure",
    60: "lane-marking",
    70: "vegetation",
    71: "trunk",
    72: "terrain",
    80: "pole",
    81: "traffic-sign",
    99: "other-object",
    251: "moving",
    252: "moving-car",
    253: "moving-bicyclist",
    254: "moving-person",
    255: "moving-motorcyclist",
    256: "moving-on-rails",
    257: "moving-bus",
    258: "moving-truck",
    259: "moving-other-vehicle",
}
NUMBERS = {name: number for number, name in NAMES.items()}
MOVING_FROM, MOVING_TO = 251, 259
UNLABELED, STATIC = 0, 9
NOT_TOLD = (0, 1)  # unlabeled and outlier: nobody says what these points are

_VEHICLES = ("car", "bus", "truck", "on-rails", "other-vehicle")
_CYCLISTS = ("bicyclist", "motorcyclist")
CLASSES: dict[str, str | None] = {
    **dict.fromkeys(NAMES.values()),
    **dict.fromkeys(_VEHICLES, "vehicle"),
    **dict.fromkeys((f"moving-{name}" for name in _VEHICLES), "vehicle"),
    **dict.fromkeys(_CYCLISTS, "cyclist"),
    **dict.fromkeys((f"moving-{name}" for name in _CYCLISTS), "cyclist"),
    **dict.fromkeys(("bicycle", "motorcycle"), "cyclist"),
    **dict.fromkeys(("person", "moving-person"), "pedestrian"),
}
del CLASSES["moving"]  # of which class is for the user to say

INSTANCE_BITS = 16
LARGEST_INSTANCE = (1 << INSTANCE_BITS) - 1


def is_moving(label: int) -> bool:
    """Whether a label says that its points moved."""
    return MOVING_FROM <= label <= MOVING_TO


def read_labels(file: Path, *, points: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Read a `.label` file.

    Args:
        file: one little-endian uint32 for each point.
        points: number of points of its sweep.

    Returns:
        labels: (N,) int64, the lower 16 bits.
        instances: (N,) int64, the upper 16 bits; 0 where a point belongs to no instance.

    Raises:
        DataError: missing, or not one number for each point.
    """
    try:
        size = file.stat().st_size
    except OSError as error:
        raise DataError(file, expected="a readable .label file", got=error.strerror or str(error)) from error
    if size != 4 * points:
        got = f"{size} bytes, {size // 4} labels" + (" and a rest" if size % 4 else "")
        do = "labels count in the sweep as the recording has it: give those of the same, uncut sweeps"
        raise DataError(file, expected=f"{points} labels of 4 bytes, one for each point of its sweep", got=got, do=do)
    values = np.fromfile(file, dtype="<u4").astype(np.int64)
    return values & LARGEST_INSTANCE, values >> INSTANCE_BITS


def labels_in(file: Path) -> set[int]:
    """The labels that stand in a file; its length is not looked at.

    Raises:
        DataError: missing.
    """
    try:
        values = np.fromfile(file, dtype="<u4")
    except OSError as error:
        raise DataError(file, expected="a readable .label file", got=error.strerror or str(error)) from error
    return set(np.unique(values & LARGEST_INSTANCE).tolist())


def write_labels(file: Path, labels: NDArray[np.int64], instances: NDArray[np.int64]) -> None:
    """Write a `.label` file.

    Args:
        file: appears whole or not at all.
        labels: (N,) int64, 0 to 65535.
        instances: (N,) int64, 0 to 65535.
    """
    values = (instances << INSTANCE_BITS) | labels
    write_bytes(file, values.astype("<u4").tobytes())
