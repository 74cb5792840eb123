"""Every fault of the files that opening a native recording reads, and what is left of the recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.egomotion import Trajectory, bus_signal_faults
from bench.errors import DataError
from bench.recordings.annotation_faults import annotation_faults
from bench.recordings.native import (
    EGOMOTION_FILES,
    HEAD,
    Source,
    annotated_tracks,
    ego_motion_of,
    image_refs,
    lidar_from_beams,
    mounted_camera,
    read_head,
    refuse_other_name,
    refuse_uncalibrated,
    sweep_refs,
)
from bench.recordings.records import ImageRef, MountedCamera, Recording, SweepRef, Track
from bench.recordings.salvage import Part, Salvaged, collected, standing_still
from bench.recordings.schema import RecordingHead
from bench.recordings.validation import json_faults


def salvage_native(
    root: Path,
    *,
    evaluated_size_px: tuple[int, int] | None = None,
    ego_motion: Source = "recorded",
    calibration: Source = "recorded",
    annotations: Path | None = None,
) -> Salvaged:
    """Read each part for itself and keep what can be read. Arguments as for `open_native`."""
    faults: list[DataError] = []
    lost: set[Part] = set()
    head: RecordingHead | None = None
    cameras: dict[str, MountedCamera] = {}
    images: dict[str, tuple[ImageRef, ...]] = {}
    sweeps: tuple[SweepRef, ...] = ()

    with collected(faults) as complete:
        head = read_head(root, calibration)
    if not complete:
        faults[:] = json_faults(RecordingHead, root / HEAD) or faults
    if head is not None:
        for refuse in (refuse_other_name, refuse_uncalibrated):
            with collected(faults):
                refuse(root, head)
        for name, entry in head.cameras.items():
            with collected(faults):
                refs = image_refs(root, name, faults.append)
                cameras[name] = mounted_camera(root, name, entry, head, evaluated_size_px)
                images[name] = refs
    with collected(faults):
        sweeps = sweep_refs(root, faults.append)
    trajectory = _trajectory(root, ego_motion, faults, lost)
    tracks = _tracks(root, annotations, faults, lost)
    if head is None or not cameras:
        return Salvaged(faults=tuple(faults), recording=None, lost=frozenset(lost))
    recording = Recording(
        name=root.resolve().name,
        root=root,
        licence=head.licence,
        frame_interval_ns=head.frame_interval_ns,
        cameras=cameras,
        images=images,
        trajectory=trajectory,
        vehicle_from_lidar=head.lidar.vehicle_from_lidar.transform,
        sweeps=sweeps,
        tracks=tracks,
        vehicle_outline_m=np.array(head.vehicle.outline_m, dtype=np.float64),
        lidar_from_beams=lidar_from_beams(head.lidar),
    )
    return Salvaged(faults=tuple(faults), recording=recording, lost=frozenset(lost))


def _trajectory(root: Path, ego_motion: Source, faults: list[DataError], lost: set[Part]) -> Trajectory:
    try:
        return ego_motion_of(root, ego_motion)
    except DataError as error:
        lost.add("trajectory")
        file = root / EGOMOTION_FILES[0]
        told = bus_signal_faults(file) if ego_motion == "recorded" and error.file == str(file) else ()
        faults.extend(told or (error,))
    return standing_still(root)


def _tracks(root: Path, annotations: Path | None, faults: list[DataError], lost: set[Part]) -> tuple[Track, ...]:
    file = annotations if annotations is not None and annotations.is_file() else root / "annotations.json"
    try:
        tracks = annotated_tracks(root, annotations)
    except DataError as error:
        lost.add("annotations")
        faults.extend((annotation_faults(file) if file.is_file() else ()) or (error,))
        return ()
    return tracks
