"""Tracks -> `.label` files."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.errors import DataError, UsageError
from bench.layers.classes import tool_class
from bench.layers.frame_files import frame_names, refuse_other_frames
from bench.layers.layer import Layer, LayerOptions
from bench.layers.motion import with_motion
from bench.layers.semantickitti_labels import (
    CLASSES,
    LARGEST_INSTANCE,
    NAMES,
    NUMBERS,
    STATIC,
    UNLABELED,
    is_moving,
    write_labels,
)
from bench.layers.sweep_states import motion_lost, states_at_sweeps
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
from bench.reference.sweeps import PlacedSweep, place_sweep

CLEARANCE_M = 0.05  # points lower than this above an object's bottom are the ground's, as in the protocols
MOVING_MPS = 0.5  # an object that was ever faster moved; the label holds for all its sweeps, as in the data set
WRITTEN = {"pedestrian": "person", "cyclist": "bicyclist", "vehicle": "car", "animal": "other-object"}
TOLD = re.compile(r"(?P<name>[a-z-]+?)-(?:(?P<instance>[1-9][0-9]*)|group-[1-9][0-9]*)")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Label:
    number: int
    instance: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _SweepLabels:
    """Labels and instances of the points of a sweep, (N,) int64 each, and how many objects have none of them."""

    numbers: NDArray[np.int64]
    instances: NDArray[np.int64]
    pointless: int


def write_layer(layer: Layer, recording: Recording, folder: Path, options: LayerOptions) -> tuple[str, ...]:
    """Write a `.label` file for each annotated sweep.

    Points on no object get the label static, those on unclear objects unlabeled. Where objects overlap, points that are
    named one by one go first, then the smaller object.

    Args:
        layer: the annotations.
        recording: what they belong to.
        folder: of the files.
        options: the first class that the user maps to one of ours is what it is called, "moving-" or not.

    Returns:
        What the files cannot hold.

    Raises:
        DataError: point indices beyond the sweep, or no ego-motion during it.
        UsageError: a class that has no label, or more objects than instances.
    """
    moved = [_at_its_sweeps(with_motion(track, recording.trajectory)) for track in layer.tracks]
    states, lost = states_at_sweeps(
        replace(layer, tracks=tuple(moved)), recording, (Cuboid, GroundPolygon, PointIndices)
    )
    labels = _labels(moved, options)
    names = frame_names(recording, options)
    sweeps = {sweep.timestamp_ns: sweep for sweep in recording.sweeps}
    pointless = 0
    refuse_other_frames(folder, ".label", map(names.__getitem__, states))
    for time_ns, objects in states.items():
        written = _sweep_labels(sweeps[time_ns], objects, labels, recording)
        write_labels(folder / f"{names[time_ns]}.label", written.numbers, written.instances)
        pointless += written.pointless
    if pointless:
        lost.append(f"{pointless} places of objects hold no point of their sweep: they leave nothing to label")
    return (*lost, *_loss(layer.tracks, labels))


def _at_its_sweeps(track: Track) -> Track:
    """States whose points are named stand at the time of the sweep that they count in."""
    times = {s.timestamp_ns for s in track.states if not isinstance(s.shape, PointIndices)}
    states: dict[int, ObjectState] = {}
    for state in track.states:
        time_ns = state.timestamp_ns
        if isinstance(state.shape, PointIndices) and state.shape.sweep_timestamp_ns not in times:
            time_ns = state.shape.sweep_timestamp_ns
        states.setdefault(time_ns, replace(state, timestamp_ns=time_ns))
    return replace(track, states=tuple(states[time_ns] for time_ns in sorted(states)))


def _labels(tracks: Sequence[Track], options: LayerOptions) -> dict[str, _Label]:
    """Track -> label and instance; those that came from labels get theirs back."""
    labels = {track.track_id: told for track in tracks if (told := _told(track)) is not None}
    taken = {(label.number, label.instance) for label in labels.values()}
    last: Counter[int] = Counter()
    for track in tracks:
        if track.track_id in labels:
            continue
        number = _number(track, options)
        instance = next(i for i in range(last[number] + 1, LARGEST_INSTANCE + 2) if (number, i) not in taken)
        if instance > LARGEST_INSTANCE:
            raise UsageError(f"{track.track_id!r}: expected at most {LARGEST_INSTANCE} objects of a label, got more")
        last[number] = instance
        labels[track.track_id] = _Label(number=number, instance=instance)
    return labels


def _told(track: Track) -> _Label | None:
    """The label in a name as reading gives them, "moving-car-3"."""
    match = TOLD.fullmatch(track.track_id)
    if match is None or match["name"] not in NUMBERS:
        return None
    if CLASSES.get(match["name"], track.object_class) != track.object_class:
        return None
    instance = int(match["instance"] or 0)
    return _Label(number=NUMBERS[match["name"]], instance=instance) if instance <= LARGEST_INSTANCE else None


def _number(track: Track, options: LayerOptions) -> int:
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
) -> _SweepLabels:
    sweep = ref.read()
    count = len(sweep.points_lidar)
    numbers = np.full(count, STATIC, dtype=np.int64)
    instances = np.zeros(count, dtype=np.int64)
    pointless = 0
    placed = place_sweep(sweep, recording.trajectory, recording.vehicle_from_lidar)
    if placed is None and count and any(not isinstance(state.shape, PointIndices) for _, state in objects):
        do = "give ego-motion that covers every sweep"
        raise DataError(ref.path, expected="ego-motion during the whole sweep", got="none for part of it", do=do)
    for track, state in sorted(objects, key=lambda one: -_volume(one[1].shape)):
        rows = _rows(track, state, ref, count, placed, recording)
        pointless += not len(rows)
        label = _Label(number=UNLABELED, instance=0) if state.unclear else labels[track.track_id]
        numbers[rows], instances[rows] = label.number, label.instance
    return _SweepLabels(numbers=numbers, instances=instances, pointless=pointless)


def _rows(
    track: Track, state: ObjectState, ref: SweepRef, count: int, placed: PlacedSweep | None, recording: Recording
) -> NDArray[np.int64]:
    if isinstance(state.shape, PointIndices):
        rows = state.shape.indices
        if rows.size and not 0 <= int(rows.min()) <= int(rows.max()) < count:
            got = f"{int(rows.min())} to {int(rows.max())}"
            expected = f"point indices of {track.track_id!r} from 0 to {count - 1}"
            raise DataError(ref.path, expected=expected, got=got, do="annotate the sweep as the recording has it")
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
    return found.rows.astype(np.int64)


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
        lost.append(f"{unclear} unclear sightings: their points are unlabeled")
    certain = [replace(track, states=tuple(replace(s, unclear=False) for s in track.states)) for track in tracks]
    lost += motion_lost(certain)
    for ours in OBJECT_CLASSES:
        of_class = {labels[track.track_id].number for track in tracks if track.object_class == ours}
        moving = sorted(
            NAMES[number] for number in of_class if is_moving(number) and CLASSES.get(NAMES[number]) != ours
        )
        standing = sorted(NAMES[n] for n in of_class if not is_moving(n) and CLASSES.get(NAMES[n]) != ours)
        if names := [*moving, *standing]:
            lost.append(f"class {ours}: written as {' and '.join(names)}, which does not say it")
    return lost
