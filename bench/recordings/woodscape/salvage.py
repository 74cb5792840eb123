"""Every fault of the files of a pair of WoodScape, and what is left of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.records import ImageRef, MountedCamera, Recording
from bench.recordings.salvage import Part, Salvaged, collected, standing_still
from bench.recordings.validation import json_faults
from bench.recordings.woodscape.camera import CalibrationFile, WoodscapeOptions, read_camera
from bench.recordings.woodscape.files import Kind, found_files
from bench.recordings.woodscape.vehicle import VehicleFile, read_arc

STAND_IN_NS = (0, 33_320_000)  # times of a pair whose own are lost


def salvage_woodscape(root: Path, *, pair: str, options: WoodscapeOptions) -> Salvaged:
    """Read each file for itself and keep what can be read. Arguments as for `open_woodscape`."""
    faults: list[DataError] = []
    files = found_files(root, pair, faults.append)
    camera: MountedCamera | None = None
    if "calibration" in files:
        with collected(found := list[DataError]()):
            camera = read_camera(root, files["calibration"], pair, options)
        faults += (json_faults(CalibrationFile, files["calibration"]) if found else ()) or found
    trajectory, times_ns = None, STAND_IN_NS
    vehicle: tuple[Kind, Kind] = ("vehicle_before", "vehicle")
    told = [fault for kind in vehicle if kind in files for fault in json_faults(VehicleFile, files[kind])]
    if not told and all(kind in files for kind in vehicle):
        with collected(told):
            trajectory, times_ns = read_arc(files["vehicle_before"], files["vehicle"], options)
    faults += told
    if camera is None:
        return Salvaged(faults=tuple(faults), recording=None)
    name, images = camera.name, []
    if "previous" in files:
        images.append(ImageRef(camera=name, timestamp_ns=times_ns[0], path=files["previous"], scored=False))
    if "current" in files:
        images.append(
            ImageRef(camera=name, timestamp_ns=times_ns[1], path=files["current"], moving_path=files.get("mask"))
        )
    lost: frozenset[Part] = frozenset() if trajectory is not None else frozenset({"trajectory"})
    recording = Recording(
        name=pair,
        root=root,
        licence=options.licence,
        frame_interval_ns=times_ns[1] - times_ns[0],
        cameras={name: camera},
        images={name: tuple(images)},
        trajectory=trajectory or standing_still(root),
        vehicle_from_lidar=RigidTransform.identity(),
        sweeps=(),
        tracks=(),
        vehicle_outline_m=np.array(options.outline_m(int(pair.split("_")[0])), dtype=np.float64),
    )
    return Salvaged(faults=tuple(faults), recording=recording, lost=lost)
