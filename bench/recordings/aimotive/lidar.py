"""Where the lidar of an aiMotive sequence sits, by the calibration file."""

from __future__ import annotations

import json
from pathlib import Path

from pydantic import ConfigDict, Field

from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform
from bench.recordings.aimotive.cameras import CALIBRATION
from bench.recordings.atomic import refuse_escape
from bench.recordings.text_files import read_text
from bench.recordings.validation import FileModel, data_error, validated


class LidarCalibration(FileModel):
    """The key of a lidar's calibration that is used; the file has many more."""

    model_config = ConfigDict(extra="ignore")

    RT_body_from_sensor: tuple[tuple[float, float, float, float], ...] = Field(min_length=4, max_length=4)


def read_lidar_mounting(root: Path, folder: Path) -> RigidTransform:
    """`body_from_beams` of the one lidar that the calibration names.

    Points come in body axes, so it serves only to tell rows and columns of beams. Where the calibration names no lidar,
    or several whose points are mixed, it is the identity: footprints then have no rows to go by.

    Args:
        root: folder of the data set, which the file must not leave.
        folder: of the sequence.

    Raises:
        DataError: missing, not a calibration, or a mounting that is none.
    """
    file = folder / CALIBRATION
    refuse_escape(root, file, file=file)
    try:
        content = json.loads(read_text(file))
    except (ValueError, RecursionError) as error:
        raise DataError(file, expected="JSON", got=str(error)) from error
    if not isinstance(content, dict):
        raise DataError(file, expected="calibrations by sensor name", got=type(content).__name__)
    names = [n for n, entry in content.items() if isinstance(entry, dict) and entry.get("sensor_type") == "lidar"]
    if len(names) != 1:
        return RigidTransform.identity()
    entry = validated(LidarCalibration, content[names[0]], file=file, field=names[0])
    try:
        return RigidTransform.from_matrix(entry.RT_body_from_sensor)
    except ShapeError as error:
        raise data_error(error, file=file, field=f"{names[0]}.RT_body_from_sensor") from error
