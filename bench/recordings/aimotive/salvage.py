"""Every fault of the files that opening an aiMotive sequence reads, and what is left of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from bench.egomotion import Trajectory, bus_signal_faults
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.aimotive.boxes import BoxFrame, box_frame_faults, read_box_frame, tracks_from_boxes
from bench.recordings.aimotive.cameras import FRAME_INTERVAL_NS, AimotiveOptions, salvage_cameras
from bench.recordings.aimotive.egomotion import egomotion_faults, sequence_trajectory
from bench.recordings.aimotive.files import box_files, image_refs, sweep_refs
from bench.recordings.aimotive.lidar import read_lidar_mounting
from bench.recordings.annotation_faults import annotation_faults
from bench.recordings.annotations import read_annotations
from bench.recordings.records import ImageRef, Recording, SweepRef, Track
from bench.recordings.salvage import Part, Salvaged, collected, standing_still


def salvage_aimotive(
    root: Path, *, sequence: str, options: AimotiveOptions, annotations: Path | None = None
) -> Salvaged:
    """Read each part for itself and keep what can be read. Arguments as for `open_aimotive`."""
    folder = root / sequence
    faults: list[DataError] = []
    lost: set[Part] = set()
    cameras = salvage_cameras(root, folder, options, faults.append)
    boxes, untold = _boxes(root, folder, faults)
    times_ns = {number: frame.timestamp_ns for number, frame in boxes.items()}
    trajectory = _trajectory(root, folder, options, times_ns, faults)
    tracks = _tracks(boxes, trajectory, annotations, faults)
    images: dict[str, tuple[ImageRef, ...]] = dict.fromkeys(cameras, ())
    for name in cameras:
        with collected(faults):
            images[name] = image_refs(root, folder, name, times_ns, faults.append, untold=untold)
    sweeps: tuple[SweepRef, ...] = ()
    with collected(faults):
        sweeps = sweep_refs(root, folder, times_ns, faults.append, untold=untold)
    beams = _lidar_mounting(root, folder, faults)
    if not cameras or not boxes:
        return Salvaged(faults=tuple(faults), recording=None)
    if trajectory is None:
        lost.add("trajectory")
    if tracks is None:
        lost.add("annotations")
    recording = Recording(
        name=folder.name,
        root=root,
        licence=options.licence,
        frame_interval_ns=FRAME_INTERVAL_NS,
        cameras=cameras,
        images=images,
        trajectory=trajectory or standing_still(root),
        vehicle_from_lidar=RigidTransform.identity(),
        sweeps=sweeps,
        tracks=tracks or (),
        vehicle_outline_m=np.array(options.vehicle_outline_m, dtype=np.float64),
        lidar_from_beams=beams,
    )
    return Salvaged(faults=tuple(faults), recording=recording, lost=frozenset(lost))


def _boxes(root: Path, folder: Path, faults: list[DataError]) -> tuple[dict[int, BoxFrame], frozenset[int]]:
    """Frames by increasing time, and the numbers of those that are lost."""
    files: Mapping[int, Path] = {}
    with collected(faults):
        files = box_files(root, folder, faults.append)
    boxes: dict[int, BoxFrame] = {}
    last_ns: int | None = None
    for number, file in files.items():
        try:
            frame = read_box_frame(file)
            if last_ns is not None and frame.timestamp_ns <= last_ns:
                got = f"{frame.timestamp_ns} after {last_ns}"
                raise DataError(file, field="Timestamp", expected="times that increase", got=got)
        except DataError as error:
            faults += box_frame_faults(file) or (error,)
            continue
        boxes[number], last_ns = frame, frame.timestamp_ns
    return boxes, frozenset(files) - frozenset(boxes)


def _lidar_mounting(root: Path, folder: Path, faults: list[DataError]) -> RigidTransform:
    """The identity where it cannot be read; a fault of the whole file is told once, with the cameras."""
    try:
        return read_lidar_mounting(root, folder)
    except DataError as error:
        if error.field is not None:
            faults.append(error)
        return RigidTransform.identity()


def _trajectory(
    root: Path, folder: Path, options: AimotiveOptions, times_ns: Mapping[int, int], faults: list[DataError]
) -> Trajectory | None:
    try:
        return sequence_trajectory(root, folder, options, times_ns)
    except DataError as error:
        if options.ego_motion is None:
            faults += egomotion_faults(root, folder, times_ns) or (error,)
        else:
            told = () if options.ego_motion.columns else bus_signal_faults(Path(error.file))
            faults += told or (error,)
    return None


def _tracks(
    boxes: Mapping[int, BoxFrame], trajectory: Trajectory | None, annotations: Path | None, faults: list[DataError]
) -> tuple[Track, ...] | None:
    if annotations is not None and annotations.is_file():
        try:
            return read_annotations(annotations)
        except DataError as error:
            faults += annotation_faults(annotations) or (error,)
            return None
    if trajectory is None:
        return None
    try:
        return tracks_from_boxes(tuple(boxes.values()), trajectory)
    except DataError as error:
        faults.append(error)
    return None
