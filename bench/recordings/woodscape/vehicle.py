"""WoodScape's vehicle data of the two images of a pair, brought into an arc."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, ConfigDict, Field

from bench.egomotion import Trajectory, planar_trajectory
from bench.errors import DataError
from bench.recordings.validation import FileModel, read_json
from bench.recordings.woodscape.camera import WoodscapeOptions

LATEST_US = 9_000_000_000_000_000  # in nanoseconds still an int64
LONGEST_PAIR_NS = 500_000_000
FASTEST_MPS = 100.0
LONGEST_NUMBER = 40


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
