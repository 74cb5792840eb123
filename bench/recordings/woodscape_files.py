"""Where WoodScape's files lie: its archives, its readme and its loader do not agree (WoodScape #16)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from os import scandir
from pathlib import Path

from bench.errors import DataError
from bench.recordings.paths import refuse_escape

CURRENT = ("rgb_images",)
PREVIOUS = ("previous_images",)
MASKS = ("motion_annotations/gtLabels", "motion_annotations/motion_annotations/gtLabels", "motion_annotations")
CALIBRATIONS = ("calibration_data/calibration", "calibration", "calibration_data")
VEHICLE = ("vehicle_data/rgb_images", "vehicle_info/rgb_images", "vehicle_data", "vehicle_info")
VEHICLE_BEFORE = ("vehicle_data/previous_images", "vehicle_info/previous_images")
IMAGE = re.compile(r"(\d{5})_(FV|RV|MVL|MVR)\.png")


@dataclass(frozen=True, slots=True, kw_only=True)
class PairFiles:
    """The files of a pair of images.

    Attributes:
        current: the annotated image.
        previous: the one before it.
        mask: what moves in the annotated one.
        calibration: of the camera.
        vehicle: speed and yaw rate at the annotated image.
        vehicle_before: at the one before it.
    """

    current: Path
    previous: Path
    mask: Path
    calibration: Path
    vehicle: Path
    vehicle_before: Path


def list_pairs(root: Path, cameras: tuple[str, ...]) -> list[str]:
    """Names `<index>_<camera>` of the annotated images, in order.

    Raises:
        DataError: no folder of images.
    """
    folder = root / CURRENT[0]
    if not folder.is_dir():
        raise DataError(folder, wanted="images <index>_<camera>.png", came="no such folder")
    refuse_escape(root, folder, file=folder)
    with scandir(folder) as entries:
        matches = [IMAGE.fullmatch(entry.name) for entry in entries]
    return sorted(f"{m[1]}_{m[2]}" for m in matches if m is not None and m[2] in cameras)


def find_pair(root: Path, name: str) -> PairFiles:
    """The files of a pair, wherever the data set's variants have them.

    Args:
        root: of the data set.
        name: `<index>_<camera>`.

    Raises:
        DataError: one is nowhere; the message says where it was looked for.
    """
    # The suffix is on the image only; the earlier vehicle data has the name of the later.
    befores = [f"{name}{suffix}.png" for suffix in ("_prev", "_PREV", "_Prev")]
    return PairFiles(
        current=_found(root, CURRENT, [f"{name}.png"]),
        previous=_found(root, PREVIOUS, befores),
        mask=_found(root, MASKS, [f"{name}.png"]),
        calibration=_found(root, CALIBRATIONS, [f"{name}.json"]),
        vehicle=_found(root, VEHICLE, [f"{name}.json"]),
        vehicle_before=_found(root, VEHICLE_BEFORE, [f"{name}.json", f"{name}_prev.json"]),
    )


def _found(root: Path, folders: tuple[str, ...], names: list[str]) -> Path:
    for folder in folders:
        for name in names:
            path = root / folder / name
            if path.is_file():
                refuse_escape(root, path, file=path)
                return path
    places = " or ".join(folders)
    raise DataError(root / folders[0] / names[0], wanted=f"a file in {places}", came="none of this name")
