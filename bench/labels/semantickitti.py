"""`.label` files of SemanticKITTI, and of predictions in its layout, as point clusters.

A label says of each point what it is and to which instance it belongs; both together name an object through the
sequence. Points labelled as moving without an instance, as masks of moving-object segmentation are, are grouped by
proximity and followed from sweep to sweep. Labels hold no velocity: that of moving objects is
estimated from the middles of their points.

Source:
    config/semantic-kitti-mos.yaml and auxiliary/laserscan.py of the data set's API.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.atomic import write_bytes
from bench.errors import DataError, UsageError
from bench.labels.formats import LabelOptions, LabelSet, map_classes, tool_class
from bench.labels.frames import frame_files, frame_names, pair_with_sweeps, refuse_other_frames
from bench.labels.motion import (
    GroupedSweep,
    linked_groups,
    middle_velocities,
    motion_lost,
    near_groups,
    states_at_sweeps,
    with_motion,
)
from bench.recordings import (
    OBJECT_CLASSES,
    Cuboid,
    GroundPolygon,
    ObjectShape,
    ObjectState,
    PointIndices,
    Recording,
    SweepRef,
    Track,
)
from bench.reference.clusters import object_cluster
from bench.reference.sweeps import PosedSweep, pose_sweep

# Numbers and names of the data set's configuration; 9 and 251 are those of its moving-object task.
NAMES = {
    0: "unlabeled", 1: "outlier", 9: "static",
    10: "car", 11: "bicycle", 13: "bus", 15: "motorcycle", 16: "on-rails", 18: "truck", 20: "other-vehicle",
    30: "person", 31: "bicyclist", 32: "motorcyclist",
    40: "road", 44: "parking", 48: "sidewalk", 49: "other-ground",
    50: "building", 51: "fence", 52: "other-structure", 60: "lane-marking",
    70: "vegetation", 71: "trunk", 72: "terrain", 80: "pole", 81: "traffic-sign", 99: "other-object",
    251: "moving", 252: "moving-car", 253: "moving-bicyclist", 254: "moving-person", 255: "moving-motorcyclist",
    256: "moving-on-rails", 257: "moving-bus", 258: "moving-truck", 259: "moving-other-vehicle",
}  # fmt: skip
NUMBERS = {name: number for number, name in NAMES.items()}
MOVING_FROM, MOVING_TO = 251, 259
UNLABELED, STATIC = 0, 9
WITHOUT_CLASS = (0, 1)  # unlabeled and outlier: points of unknown kind

_CLASSES = {
    **dict.fromkeys(("car", "bus", "truck", "on-rails", "other-vehicle"), "vehicle"),
    **dict.fromkeys(("bicyclist", "motorcyclist"), "cyclist"),
    "person": "pedestrian",
}
CLASSES: dict[str, str | None] = {
    **{name: _CLASSES.get(name.removeprefix("moving-")) for name in NAMES.values() if name != "moving"},
    **dict.fromkeys(("bicycle", "motorcycle"), "cyclist"),
}  # without "moving", whose class is for the user to say

INSTANCE_BITS = 16
LARGEST_INSTANCE = (1 << INSTANCE_BITS) - 1


def is_moving(label: int) -> bool:
    """Return True where a label says that its points moved."""
    return MOVING_FROM <= label <= MOVING_TO


def read_labels(file: Path, *, points: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Read a `.label` file.

    Args:
        file: one little-endian uint32 for each point.
        points: number of points of its sweep.

    Returns:
        labels: (N,) int64, the lower 16 bits.
        instances: (N,) int64, the upper 16 bits; 0 where a point belongs to no instance.

    Raises:
        DataError: missing, or not one number for each point.
    """
    values = _stored_labels(file)
    if len(values) != points or file.stat().st_size % 4:
        got = f"{file.stat().st_size} bytes, {len(values)} labels" + (" and a rest" if file.stat().st_size % 4 else "")
        hint = "labels count in the sweep as the recording has it: give those of the same, uncut sweeps"
        raise DataError(
            file, expected=f"{points} labels of 4 bytes, one for each point of its sweep", got=got, hint=hint
        )
    values = values.astype(np.int64)
    return values & LARGEST_INSTANCE, values >> INSTANCE_BITS


def labels_in(file: Path) -> set[int]:
    """Set of the labels in a file, whatever its length.

    Raises:
        DataError: missing.
    """
    return set(np.unique(_stored_labels(file) & LARGEST_INSTANCE).tolist())


def _stored_labels(file: Path) -> NDArray[np.integer]:
    try:
        return np.fromfile(file, dtype="<u4")
    except OSError as error:
        raise DataError(file, expected="a readable .label file", got=error.strerror or str(error)) from error


def write_labels(file: Path, labels: NDArray[np.int64], instances: NDArray[np.int64]) -> None:
    """Write a `.label` file.

    Args:
        file: appears whole or not at all.
        labels: (N,) int64, 0 to 65535.
        instances: (N,) int64, 0 to 65535.
    """
    values = (instances << INSTANCE_BITS) | labels
    write_bytes(file, values.astype("<u4").tobytes())


CLEARANCE_M = 0.05  # points lower than this above an object's bottom are the ground's, as in the protocols
MOVING_MPS = 0.5  # an object that was ever faster moved; the label holds for all its sweeps, as in the data set
WRITTEN = {"pedestrian": "person", "cyclist": "bicyclist", "vehicle": "car", "animal": "other-object"}
LABEL_NAME = re.compile(r"(?P<name>[a-z-]+?)-(?:(?P<instance>[1-9][0-9]*)|group-[1-9][0-9]*)")


_Label = tuple[int, int]  # number and instance


def write_label_set(label_set: LabelSet, recording: Recording, folder: Path, options: LabelOptions) -> tuple[str, ...]:
    """Write a `.label` file for each annotated sweep.

    Points on no object get the label static, those on unclear objects unlabeled. Where objects overlap, points that are
    named one by one go first, then the smaller object.

    Args:
        label_set: the annotations.
        recording: what they belong to.
        folder: of the files.
        options: the first class that the user maps to one of ours is what it is called, "moving-" or not.

    Returns:
        What the files cannot hold.

    Raises:
        DataError: point indices beyond the sweep, or no ego-motion during it.
        UsageError: a class that has no label, or more objects than instances.
    """
    moved = [_at_its_sweeps(with_motion(track, recording.trajectory)) for track in label_set.tracks]
    states, lost = states_at_sweeps(
        replace(label_set, tracks=tuple(moved)), recording, (Cuboid, GroundPolygon, PointIndices)
    )
    labels = _labels(moved, options)
    names = frame_names(recording, options)
    sweeps = {sweep.timestamp_ns: sweep for sweep in recording.sweeps}
    pointless = 0
    refuse_other_frames(folder, ".label", map(names.__getitem__, states))
    for time_ns, objects in states.items():
        numbers, instances, without_points = _sweep_labels(sweeps[time_ns], objects, labels, recording)
        write_labels(folder / f"{names[time_ns]}.label", numbers, instances)
        pointless += without_points
    if pointless:
        lost.append(f"{pointless} places of objects hold no point of their sweep: they leave nothing to label")
    return (*lost, *_loss(label_set.tracks, labels))


def _at_its_sweeps(track: Track) -> Track:
    """Move states given by point indices to the time of the sweep that these count in."""
    times = {s.timestamp_ns for s in track.states if not isinstance(s.shape, PointIndices)}
    states: dict[int, ObjectState] = {}
    for state in track.states:
        time_ns = state.timestamp_ns
        if isinstance(state.shape, PointIndices) and state.shape.sweep_timestamp_ns not in times:
            time_ns = state.shape.sweep_timestamp_ns
        states.setdefault(time_ns, replace(state, timestamp_ns=time_ns))
    return replace(track, states=tuple(states[time_ns] for time_ns in sorted(states)))


def _labels(tracks: Sequence[Track], options: LabelOptions) -> dict[str, _Label]:
    """Track -> label and instance; those that came from labels get theirs back."""
    labels = {track.track_id: label for track in tracks if (label := _label_in_name(track)) is not None}
    taken = set(labels.values())
    last: Counter[int] = Counter()
    for track in tracks:
        if track.track_id in labels:
            continue
        number = _number(track, options)
        instance = next(i for i in range(last[number] + 1, LARGEST_INSTANCE + 2) if (number, i) not in taken)
        if instance > LARGEST_INSTANCE:
            raise UsageError(f"{track.track_id!r}: expected at most {LARGEST_INSTANCE} objects of a label, got more")
        last[number] = instance
        labels[track.track_id] = number, instance
    return labels


def _label_in_name(track: Track) -> _Label | None:
    """The label in a name as reading gives them, "moving-car-3"."""
    match = LABEL_NAME.fullmatch(track.track_id)
    if match is None or match["name"] not in NUMBERS:
        return None
    if CLASSES.get(match["name"], track.object_class) != track.object_class:
        return None
    instance = int(match["instance"] or 0)
    return (NUMBERS[match["name"]], instance) if instance <= LARGEST_INSTANCE else None


def _number(track: Track, options: LabelOptions) -> int:
    name = tool_class(track.object_class, options, WRITTEN).casefold().removeprefix("moving-")
    if name not in NUMBERS:
        expected = ", ".join(NAMES.values())
        raise UsageError(f"class {name!r}: SemanticKITTI has no label of this name; its labels are {expected}")
    if not _moved_ever(track):
        return NUMBERS[name]
    return NUMBERS.get(f"moving-{name}", NUMBERS["moving"])


def _moved_ever(track: Track) -> bool:
    speeds = np.array([np.hypot(*state.velocity_mps[:2]) for state in track.states])
    return any(state.category is not None for state in track.states) or bool((speeds >= MOVING_MPS).any())


def _sweep_labels(
    ref: SweepRef, objects: Sequence[tuple[Track, ObjectState]], labels: dict[str, _Label], recording: Recording
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Labels and instances of the points of a sweep, (N,) int64 each, and how many objects have none of them."""
    sweep = ref.read()
    count = sweep.rows_stored
    stored = np.arange(count) if sweep.stored_rows is None else sweep.stored_rows
    numbers = np.full(count, STATIC, dtype=np.int64)
    instances = np.zeros(count, dtype=np.int64)
    pointless = 0
    placed = pose_sweep(sweep, recording.trajectory, recording.vehicle_from_lidar)
    if (
        placed is None
        and len(sweep.points_lidar)
        and any(not isinstance(state.shape, PointIndices) for _, state in objects)
    ):
        hint = "give ego-motion that covers every sweep"
        raise DataError(ref.path, expected="ego-motion during the whole sweep", got="none for part of it", hint=hint)
    for track, state in sorted(objects, key=lambda one: -_volume(one[1].shape)):
        rows = _rows(track, state, ref, stored, count, placed, recording)
        pointless += not len(rows)
        numbers[rows], instances[rows] = (UNLABELED, 0) if state.unclear else labels[track.track_id]
    return numbers, instances, pointless


def _rows(
    track: Track,
    state: ObjectState,
    ref: SweepRef,
    stored: NDArray[np.int64],
    count: int,
    placed: PosedSweep | None,
    recording: Recording,
) -> NDArray[np.int64]:
    if isinstance(state.shape, PointIndices):
        rows = state.shape.indices
        if rows.size and not 0 <= int(rows.min()) <= int(rows.max()) < count:
            got = f"{int(rows.min())} to {int(rows.max())}"
            expected = f"point indices of {track.track_id!r} from 0 to {count - 1}"
            raise DataError(ref.path, expected=expected, got=got, hint="annotate the sweep as the recording has it")
        return rows
    if placed is None:
        return np.empty(0, dtype=np.int64)
    world_from_vehicle = recording.trajectory.world_from_vehicle(state.timestamp_ns)
    found = object_cluster(
        placed,
        state,
        velocity_world_mps=world_from_vehicle.rotate(state.velocity_mps),
        world_from_vehicle=world_from_vehicle,
        exposure_ns=state.timestamp_ns,
        clearance_m=CLEARANCE_M,
    )
    return stored[found.rows]


def _volume(shape: ObjectShape) -> float:
    """Of the shape, m^3; 0 for named points, which go over all others."""
    match shape:
        case Cuboid(size_m=size_m):
            return float(np.prod(size_m))
        case GroundPolygon(outline_m=outline_m, bottom_m=bottom_m, top_m=top_m):
            return float(shapely.Polygon(outline_m).area * (top_m - bottom_m))
    return 0.0


def _loss(tracks: Sequence[Track], labels: dict[str, _Label]) -> list[str]:
    states = [state for track in tracks for state in track.states]
    lost = [f"labels say moving of objects that were ever over {MOVING_MPS} m/s or have a kind of motion, not how"]
    if boxes := sum(not isinstance(state.shape, PointIndices) for state in states):
        lost.append(f"{boxes} boxes and outlines: their points are kept, the shapes are not")
    if unclear := sum(state.unclear for state in states):
        lost.append(f"{unclear} unclear observations: their points are unlabeled")
    certain = [replace(track, states=tuple(replace(s, unclear=False) for s in track.states)) for track in tracks]
    lost += motion_lost(certain)
    for ours in OBJECT_CLASSES:
        of_class = {labels[track.track_id][0] for track in tracks if track.object_class == ours}
        other = [number for number in of_class if CLASSES.get(NAMES[number]) != ours]
        if names := [NAMES[number] for number in sorted(other, key=lambda n: (not is_moving(n), NAMES[n]))]:
            lost.append(f"class {ours}: written as {' and '.join(names)}, which does not say it")
    return lost


FOLDERS = ("labels", "predictions")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Seen:
    """The points of one object in one sweep.

    Attributes:
        timestamp_ns: of the sweep.
        rows: (K,) int64, of its points.
        seen_ns: mean time of the points.
        middle_m: (3,) float64, m, world frame, their mean; NaN without ego-motion.
    """

    timestamp_ns: int
    rows: NDArray[np.int64]
    seen_ns: int
    middle_m: NDArray[np.float64]


@dataclass(slots=True, kw_only=True)
class _Gathered:
    """Content of the files, gathered sweep by sweep.

    Attributes:
        instances: (label, instance) -> observations by time.
        loose: label -> observations without an instance, by sweep.
        points: label -> number of its points.
        nameless: label -> number of its points without an instance.
    """

    instances: dict[tuple[int, int], list[_Seen]] = field(default_factory=lambda: defaultdict(list))
    loose: dict[int, list[list[_Seen]]] = field(default_factory=lambda: defaultdict(list))
    points: Counter[int] = field(default_factory=Counter)
    nameless: Counter[int] = field(default_factory=Counter)


class SemanticKitti:
    """The labels of SemanticKITTI."""

    name = "semantickitti"
    description = (
        "SemanticKITTI: a sequence folder, or its folder labels/ or predictions/ with one .label for each sweep"
    )

    def read(self, source: Path, recording: Recording, options: LabelOptions) -> LabelSet:
        """Read a sequence's labels; see `LabelFormat.read`."""
        files = {file.stem: file for file in frame_files(source, ".label", folders=FOLDERS)}
        frames = pair_with_sweeps(files, recording, options, source=source)
        present = set[int]().union(*(labels_in(file) for file in files.values())) - set(WITHOUT_CLASS)
        classes = map_classes(map(_name, present), options, source=source, known=CLASSES)
        expected = {label for label in present if classes[_name(label)] is not None}
        gathered = _Gathered()
        for name, sweep in frames.items():
            _gather(gathered, files[name], sweep, recording, expected)
        tracks = tuple(_tracks(gathered, classes, recording))
        times_ns = tuple(sweep.timestamp_ns for sweep in frames.values())
        return LabelSet(
            tracks=tracks, timestamps_ns=times_ns, lost=tuple(_loss_of_groups(gathered, classes, tracks, options))
        )

    def write(self, label_set: LabelSet, recording: Recording, out: Path, options: LabelOptions) -> tuple[str, ...]:
        """Write the folder labels/ of a sequence; see `LabelFormat.write`."""
        return write_label_set(label_set, recording, out / FOLDERS[0], options)


def _name(label: int) -> str:
    return NAMES.get(label, str(label))


def _is_stationary(label: int) -> bool:
    """Return True where a label says that its points did not move; False for numbers that only the user knows."""
    return label in NAMES and not is_moving(label)


def _gather(gathered: _Gathered, file: Path, sweep: SweepRef, recording: Recording, expected: set[int]) -> None:
    points = sweep.read()
    labels, instances = read_labels(file, points=points.rows_stored)
    stored = np.arange(len(labels)) if points.stored_rows is None else points.stored_rows
    labels, instances = labels[stored], instances[stored]  # those of lost returns say nothing
    placed = pose_sweep(points, recording.trajectory, recording.vehicle_from_lidar)

    def seen(rows: NDArray[np.int64]) -> _Seen:
        offset_ns = round(float((points.times_ns[rows] - sweep.timestamp_ns).mean()))
        return _Seen(
            timestamp_ns=sweep.timestamp_ns,
            rows=stored[rows],
            seen_ns=sweep.timestamp_ns + offset_ns,
            middle_m=np.full(3, np.nan) if placed is None else placed.points_world(rows).mean(axis=0),
        )

    for label, count in zip(*np.unique(labels, return_counts=True), strict=True):
        gathered.points[int(label)] += int(count)
        if label not in expected:
            continue
        rows = np.flatnonzero(labels == label)
        for instance in np.unique(instances[rows]).tolist():
            of_instance = rows[instances[rows] == instance]
            if instance:
                gathered.instances[int(label), instance].append(seen(of_instance))
                continue
            gathered.nameless[int(label)] += len(of_instance)
            if not _is_stationary(int(label)):
                groups = near_groups(points.points_lidar[of_instance])
                found = [seen(of_instance[groups == group]) for group in range(int(groups.max()) + 1)]
                gathered.loose[int(label)].append(found)


def _tracks(gathered: _Gathered, classes: Mapping[str, str | None], recording: Recording) -> list[Track]:
    tracks = []
    for (label, instance), observations in sorted(gathered.instances.items()):
        if ours := classes[_name(label)]:
            tracks.append(
                _track(f"{_name(label)}-{instance}", ours, observations, recording, stationary=_is_stationary(label))
            )
    for label, sweeps in sorted(gathered.loose.items()):
        if ours := classes[_name(label)]:
            for number, observations in sorted(_followed(sweeps).items()):
                tracks.append(
                    _track(f"{_name(label)}-group-{number + 1}", ours, observations, recording, stationary=False)
                )
    return tracks


def _followed(sweeps: Sequence[Sequence[_Seen]]) -> dict[int, list[_Seen]]:
    """Groups of sweeps -> objects."""
    grouped = [
        GroupedSweep(timestamp_ns=groups[0].timestamp_ns, middles_m=np.array([one.middle_m for one in groups]))
        for groups in sweeps
    ]
    objects: dict[int, list[_Seen]] = defaultdict(list)
    for groups, numbers in zip(sweeps, linked_groups(grouped), strict=True):
        for one, number in zip(groups, numbers, strict=True):
            objects[number].append(one)
    return objects


def _track(name: str, ours: str, observations: Sequence[_Seen], recording: Recording, *, stationary: bool) -> Track:
    times_ns = np.array([one.timestamp_ns for one in observations], dtype=np.int64)
    if stationary:
        velocities = np.zeros((len(observations), 3))
    else:
        seen_ns = np.array([one.seen_ns for one in observations], dtype=np.int64)
        world_mps = middle_velocities(seen_ns, np.array([one.middle_m for one in observations]))
        world_from_vehicle, _, _ = recording.trajectory.at(times_ns)
        velocities = np.einsum("nji,nj->ni", world_from_vehicle, world_mps)
    states = tuple(
        ObjectState(
            timestamp_ns=one.timestamp_ns,
            shape=PointIndices(indices=one.rows.astype(np.int64), sweep_timestamp_ns=one.timestamp_ns),
            velocity_mps=velocity,
        )
        for one, velocity in zip(observations, velocities, strict=True)
    )
    return Track(track_id=name, object_class=ours, states=states)


def _loss_of_groups(
    gathered: _Gathered, classes: Mapping[str, str | None], tracks: Sequence[Track], options: LabelOptions
) -> list[str]:
    chosen = {name.casefold() for name in options.classes}
    lost = [
        f"{count} points of {_name(label)}: left out as asked"
        for label, count in sorted(gathered.points.items())
        if _name(label) in chosen and classes.get(_name(label), "") is None
    ]
    if unlabelled := sum(gathered.points[label] for label in WITHOUT_CLASS):
        lost.append(f"{unlabelled} points without a class (unlabeled, outlier)")
    for label, count in sorted(gathered.nameless.items()):
        start = f"{count} points of {_name(label)} without an instance"
        groups = sum(track.track_id.startswith(f"{_name(label)}-group-") for track in tracks)
        treatment = (
            "left out, stationary" if _is_stationary(label) else f"grouped by proximity and followed, {groups} objects"
        )
        lost.append(f"{start}: {treatment}")
    moving = [track for track in tracks if not all(np.array_equal(s.velocity_mps, np.zeros(3)) for s in track.states)]
    if moving:
        unknown = sum(not np.isfinite(state.velocity_mps).all() for track in moving for state in track.states)
        lost.append(
            f"velocities: labels hold none; those of {len(moving)} objects labelled as moving are estimated from the "
            f"middles of their points, {unknown} states remain without"
        )
    return lost
