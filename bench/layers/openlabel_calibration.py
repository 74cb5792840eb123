"""Lenses and mountings of an OpenLABEL file as the parts of a native recording's head."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from bench.cameras import camera_parameters
from bench.errors import DataError
from bench.layers.openlabel_cameras import read_lens
from bench.layers.openlabel_file import Root, read_label_file
from bench.layers.openlabel_systems import chain, standing_poses
from bench.recordings.schema import CameraHead, LidarHead, Mounting
from bench.recordings.validation import validated


def calibration_head(file: Path) -> dict[str, Any]:
    """`cameras` and, where the file has one lidar, `lidar` of `recording.json`, as JSON values.

    The file's one local system is taken for the vehicle frame: x forward, y left, z up, origin on the ground below the
    middle of the rear axle. Where it lies elsewhere, the mountings have to be moved by hand.

    Args:
        file: an OpenLABEL file.

    Raises:
        DataError: not OpenLABEL, no camera with a lens, no or several local systems, a camera without a pose.
    """
    content = read_label_file(file)
    vehicle = _vehicle(content, file)
    head: dict[str, Any] = {"cameras": {}}
    for name, stream in content.streams.items():
        field = f"openlabel.streams.{name}"
        if stream.type == "camera":
            lens = read_lens(stream.stream_properties, file, f"{field}.stream_properties")
            if lens is None:
                continue
            parameters = {k: v for k, v in camera_parameters(lens).items() if k not in {"width", "height"}}
            head["cameras"][name] = {
                "model": parameters,
                "image_size": (lens.width, lens.height),
                "vehicle_from_camera": _mounting(name, vehicle, content, file),
            }
            validated(CameraHead, head["cameras"][name], file=file, field=field)
        elif stream.type == "lidar" and "lidar" not in head:
            head["lidar"] = {"vehicle_from_lidar": _mounting(name, vehicle, content, file)}
            validated(LidarHead, head["lidar"], file=file, field=field)
    if not head["cameras"]:
        expected = "a stream of type camera with intrinsics_fisheye, intrinsics_pinhole or intrinsics_custom"
        raise DataError(file, field="openlabel.streams", expected=expected, got=", ".join(content.streams) or "none")
    return head


def calibration_text(file: Path) -> str:
    """The same as text."""
    return json.dumps(calibration_head(file), indent=1, allow_nan=False) + "\n"


def _vehicle(content: Root, file: Path) -> str:
    local = [name for name, system in content.coordinate_systems.items() if system.type in {"local_cs", "local"}]
    if len(local) != 1:
        field = "openlabel.coordinate_systems"
        raise DataError(file, field=field, expected="one local_cs, the vehicle", got=", ".join(local) or "none")
    return local[0]


def _mounting(name: str, vehicle: str, content: Root, file: Path) -> dict[str, Any]:
    vehicle_from_sensor = chain(name, vehicle, standing_poses(content, file))
    if vehicle_from_sensor is None:
        field = f"openlabel.coordinate_systems.{name}"
        raise DataError(file, field=field, expected=f"poses that lead to {vehicle!r}", got="none")
    return Mounting.of(vehicle_from_sensor).model_dump()
