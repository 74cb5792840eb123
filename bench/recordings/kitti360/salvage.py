"""Every fault of the files that opening a sequence of KITTI-360 reads, and what is left of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from bench.errors import DataError
from bench.recordings.annotation_faults import annotation_faults
from bench.recordings.annotations import read_annotations
from bench.recordings.atomic import refuse_escape
from bench.recordings.kitti360.boxes import WorldBox, read_boxes
from bench.recordings.kitti360.calibration import CameraName, Kitti360Options, salvage_rig
from bench.recordings.kitti360.faults import clock_faults, pose_faults
from bench.recordings.kitti360.files import (
    BOXES,
    IMAGES,
    POSES,
    Drive,
    FrameClock,
    camera_names,
    image_files,
    image_refs,
    read_clock,
    read_drive,
    sweep_files,
    sweep_refs,
    wanted_frames,
)
from bench.recordings.kitti360.tracks import Annotated, tracks_from_world
from bench.recordings.records import Recording
from bench.recordings.salvage import Part, Salvaged, collected, standing_still
from bench.recordings.validation import MOST_FAULTS

EVERYTHING = Annotated(tracks=(), windows=())


def salvage_kitti360(
    root: Path, *, sequence: str, options: Kitti360Options, annotations: Path | None = None
) -> Salvaged:
    """Read each part for itself and keep what can be read. Arguments as for `open_kitti360`."""
    faults: list[DataError] = []
    names = camera_names(root / IMAGES / sequence, options)
    rig = salvage_rig(root, names, options, faults.append)
    images: dict[CameraName, Mapping[int, Path]] = {}
    for name in names:
        with collected(faults):
            images[name] = image_files(root, sequence, name, faults.append)
            if not images[name]:
                folder = root / IMAGES / sequence / name / "data_rgb"
                raise DataError(folder, expected="images <frame, ten digits>.png", got="none")
    sweeps: Mapping[int, Path] = {}
    with collected(faults):
        sweeps = sweep_files(root, sequence, faults.append)
    clock = _clock(root, sequence, images, faults)
    drive = None
    file = root / POSES / sequence / "poses.txt"
    if rig is None or clock is None:
        faults += pose_faults(file, clock)
    else:
        try:
            refuse_escape(root, file, file=file)
            drive = read_drive(
                file, clock, rig.vehicle_from_imu, max_gap_s=options.max_pose_gap_s, standing_m=options.standing_m
            )
        except DataError as error:
            faults += pose_faults(file, clock) or (error,)
    annotated = _annotated(root, sequence, options, annotations, drive, clock, faults)
    if rig is None or clock is None or not rig.cameras:
        return Salvaged(faults=tuple(faults), recording=None)
    expected = wanted_frames(sequence, options, (annotated or EVERYTHING).covers)
    recording = Recording(
        name=sequence,
        root=root,
        licence=options.licence,
        frame_interval_ns=clock.interval_ns,
        cameras=rig.cameras,
        images={
            name: image_refs(name, images.get(name, {}), clock, expected, faults.append)
            for name in names
            if name in rig.cameras
        },
        trajectory=standing_still(root) if drive is None else drive.trajectory,
        vehicle_from_lidar=rig.vehicle_from_lidar,
        sweeps=sweep_refs(sweeps, clock, expected, faults.append),
        tracks=() if annotated is None else annotated.tracks,
        vehicle_outline_m=np.array(options.vehicle_outline_m, dtype=np.float64),
    )
    gone: dict[Part, bool] = {"trajectory": drive is None, "annotations": annotated is None}
    return Salvaged(
        faults=tuple(faults), recording=recording, lost=frozenset(part for part, lost in gone.items() if lost)
    )


def _clock(
    root: Path, sequence: str, images: Mapping[CameraName, Mapping[int, Path]], faults: list[DataError]
) -> FrameClock | None:
    """The clock of the first camera that has one, though opening asks for that of the first."""
    for camera, files in images.items():
        file = root / IMAGES / sequence / camera / "timestamps.txt"
        try:
            refuse_escape(root, file, file=file)
            return read_clock(file, list(files))
        except DataError as error:
            faults += clock_faults(file) or (error,)
    return None


def _annotated(
    root: Path,
    sequence: str,
    options: Kitti360Options,
    annotations: Path | None,
    drive: Drive | None,
    clock: FrameClock | None,
    faults: list[DataError],
) -> Annotated | None:
    if annotations is not None and annotations.is_file():
        try:
            return Annotated(tracks=read_annotations(annotations), windows=())
        except DataError as error:
            faults += annotation_faults(annotations) or (error,)
            return None
    file = root / BOXES / options.boxes / f"{sequence}.xml"
    boxes: list[WorldBox | tuple[int, int]] = []
    found: list[DataError] = []
    with collected(found) as whole:
        refuse_escape(root, file, file=file)
        boxes += read_boxes(file, found.append)
    faults += found[:MOST_FAULTS]
    if not whole or drive is None or clock is None:
        return None
    return tracks_from_world(
        boxes, drive, clock, static_range_m=options.static_range_m, static_people=options.static_people
    )
