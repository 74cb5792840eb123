"""Where WoodScape's files lie: its archives, its readme and its loader do not agree (WoodScape #16)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from os import scandir
from pathlib import Path
from typing import Literal

from bench.errors import DataError
from bench.recordings.atomic import refuse_escape
from bench.recordings.error_handlers import OnError, reporting

# Of a pair: the annotated image, the one before it, what moves in the annotated one, the calibration of the camera, and
# speed and yaw rate at both images.
Kind = Literal["current", "previous", "mask", "calibration", "vehicle", "vehicle_before"]

# Folders, the likeliest first. Archives unpacked into a folder of their own name give a folder twice.
PLACES: Mapping[Kind, tuple[str, ...]] = {
    "current": ("rgb_images", "rgb_images/rgb_images"),
    "previous": ("previous_images", "previous_images/previous_images"),
    "mask": (
        "motion_annotations/gtLabels",
        "motion_annotations/motion_annotations/gtLabels",
        "motion_annotations",
        "motion_annotations/motion_annotations",
    ),
    "calibration": (
        "calibration_data/calibration",
        "calibration",
        "calibration_data",
        "calibration/calibration",
        "calibration_data/calibration_data",
        "calibration_data/calibration_data/calibration",
    ),
    "vehicle": (
        "vehicle_data/rgb_images",
        "vehicle_info/rgb_images",
        "vehicle_data",
        "vehicle_info",
        "vehicle_data/vehicle_data/rgb_images",
        "vehicle_info/vehicle_info/rgb_images",
    ),
    "vehicle_before": (
        "vehicle_data/previous_images",
        "vehicle_info/previous_images",
        "vehicle_data/vehicle_data/previous_images",
        "vehicle_info/vehicle_info/previous_images",
    ),
}
IMAGE = re.compile(r"(\d{5})_(FV|RV|MVL|MVR)\.png")


def list_pairs(root: Path, cameras: tuple[str, ...]) -> list[str]:
    """Names `<index>_<camera>` of the annotated images, in order.

    Raises:
        DataError: no folder of images.
    """
    present = [root / place for place in PLACES["current"] if (root / place).is_dir()]
    if not present:
        folder = root / PLACES["current"][0]
        raise DataError(folder, expected="images <index>_<camera>.png", got="no such folder")
    names: set[str] = set()
    for folder in present:
        refuse_escape(root, folder, file=folder)
        with scandir(folder) as entries:
            matches = [IMAGE.fullmatch(entry.name) for entry in entries]
        names |= {f"{m[1]}_{m[2]}" for m in matches if m is not None and m[2] in cameras}
    return sorted(names)


def find_pair(root: Path, name: str, on_error: OnError) -> dict[Kind, Path]:
    """The files of a pair, wherever the data set's variants have them.

    Args:
        root: of the data set.
        name: `<index>_<camera>`.
        on_error: takes an error for each that is nowhere; it says where the file was looked for.
    """
    # The suffix is on the image only; the earlier vehicle data has the name of the later.
    befores = [f"{name}{suffix}.png" for suffix in ("_prev", "_PREV", "_Prev")]
    names: dict[Kind, list[str]] = {
        "current": [f"{name}.png"],
        "previous": befores,
        "mask": [f"{name}.png"],
        "calibration": [f"{name}.json"],
        "vehicle": [f"{name}.json"],
        "vehicle_before": [f"{name}.json", f"{name}_prev.json"],
    }
    found: dict[Kind, Path] = {}
    for kind, candidates in names.items():
        with reporting(on_error):
            found[kind] = _found(root, PLACES[kind], candidates)
    return found


def _found(root: Path, folders: tuple[str, ...], names: list[str]) -> Path:
    for folder in folders:
        for name in names:
            path = root / folder / name
            if path.is_file():
                refuse_escape(root, path, file=path)
                return path
    places = " or ".join(folders)
    raise DataError(root / folders[0] / names[0], expected=f"a file in {places}", got="none of this name")
