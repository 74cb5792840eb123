"""WoodScape's files, whose places archives, readme and loader disagree on (WoodScape #16); vehicle data of a pair."""

from __future__ import annotations

import re
from collections.abc import Mapping
from os import scandir
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, ConfigDict, Field

from bench.adapters.woodscape.camera import WoodscapeOptions
from bench.atomic import linked_folder, refuse_escape
from bench.egomotion import Trajectory, planar_trajectory
from bench.errors import DataError
from bench.recordings.validation import FileModel, read_json

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
LATEST_US = 9_000_000_000_000_000  # in nanoseconds still an int64
LONGEST_PAIR_NS = 500_000_000
FASTEST_MPS = 100.0
LONGEST_NUMBER = 40


def list_pairs(root: Path, options: WoodscapeOptions) -> list[str]:
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
        refuse_escape(linked_folder(root, folder, levels=options.follow_links), folder, file=folder)
        with scandir(folder) as entries:
            matches = [IMAGE.fullmatch(entry.name) for entry in entries]
        names |= {f"{m[1]}_{m[2]}" for m in matches if m is not None and m[2] in options.cameras}
    return sorted(names)


def find_pair(root: Path, name: str, options: WoodscapeOptions) -> dict[Kind, Path]:
    """The files of a pair, wherever the data set's variants have them.

    Args:
        root: of the data set.
        name: `<index>_<camera>`.
        options: for how far links are followed.

    Raises:
        DataError: one that is nowhere; it says where the file was looked for.
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
    return {kind: _found(root, PLACES[kind], these, options.follow_links) for kind, these in names.items()}


def _found(root: Path, folders: tuple[str, ...], names: list[str], levels: int) -> Path:
    for folder in folders:
        for name in names:
            path = root / folder / name
            if path.is_file():
                refuse_escape(linked_folder(root, path, levels=levels), path, file=path)
                return path
    places = " or ".join(folders)
    raise DataError(root / folders[0] / names[0], expected=f"a file in {places}", got="none of this name")


def _from_text(value: object) -> object:
    """The data set writes numbers as text."""
    if not isinstance(value, str) or len(value) > LONGEST_NUMBER:
        return value
    try:
        return float(value)
    except ValueError:
        return value


def _whole_from_text(value: object) -> object:
    return int(value) if isinstance(value, str) and value.isascii() and value.isdigit() and len(value) < 20 else value


Number = Annotated[float, BeforeValidator(_from_text)]


class VehicleFile(FileModel):
    """A file of `vehicle_data`; acceleration and steering are of unknown unit and passed over."""

    model_config = ConfigDict(extra="ignore")

    timestamp: Annotated[int, BeforeValidator(_whole_from_text), Field(ge=0, le=LATEST_US)]
    ego_speed: Number
    ego_yaw_rate: Number = Field(alias="ego_yawRate")
    ego_gear: str = "D"


def read_arc(file_before: Path, file: Path, options: WoodscapeOptions) -> tuple[Trajectory, tuple[int, int]]:
    """Read both files of a pair.

    Args:
        file_before: of the earlier image.
        file: of the later one.
        options: the sign of the yaw rate.

    Returns:
        trajectory: from the earlier to the later image.
        times_ns: of both.

    Raises:
        DataError: missing, not what the format asks for, times that are no pair, or a speed that no car has.
    """
    before, after = (read_json(VehicleFile, path) for path in (file_before, file))
    times_ns = before.timestamp * 1000, after.timestamp * 1000
    wait_ns = times_ns[1] - times_ns[0]
    if not 0 < wait_ns <= LONGEST_PAIR_NS:
        expected = f"a time up to {LONGEST_PAIR_NS // 1000} microseconds after that of {file_before.parent.name}"
        raise DataError(file, field="timestamp", expected=expected, got=f"one {wait_ns // 1000} after it")
    speeds_mps = np.array([before.ego_speed, after.ego_speed]) / 3.6
    if np.abs(speeds_mps).max() > FASTEST_MPS:
        got = f"{before.ego_speed} and {after.ego_speed}"
        raise DataError(file, field="ego_speed", expected=f"at most {FASTEST_MPS * 3.6:g} km/h", got=got)
    turn = 1.0 if options.yaw_rate_positive == "left" else -1.0
    trajectory = planar_trajectory(
        source=str(file),
        timestamps_ns=np.array(times_ns, dtype=np.int64),
        speed_mps=speeds_mps,
        yaw_rate_radps=turn * np.deg2rad([before.ego_yaw_rate, after.ego_yaw_rate]),
        gear=[before.ego_gear, after.ego_gear],
    )
    return trajectory, times_ns
