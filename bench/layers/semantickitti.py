"""`.label` files of SemanticKITTI, and of predictions in its layout, as point clusters.

A label says of each point what it is and to which instance it belongs; both together name an object through the
sequence. Points labelled as moving without an instance, as masks of moving-object segmentation are, are grouped by
nearness and followed from sweep to sweep. Labels tell no velocity: what stands has none, that of what moves is
estimated from the middles of its points.

Source:
    config/semantic-kitti-mos.yaml and auxiliary/laserscan.py of the data set's API.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.layers.classes import map_classes
from bench.layers.frame_files import frame_files
from bench.layers.frames import pair_with_sweeps
from bench.layers.layer import Layer, LayerOptions
from bench.layers.point_groups import GroupedSweep, linked_groups, near_groups
from bench.layers.point_motion import middle_velocities
from bench.layers.semantickitti_labels import (
    CLASSES,
    NAMES,
    NOT_TOLD,
    is_moving,
    labels_in,
    read_labels,
)
from bench.layers.semantickitti_writing import write_layer
from bench.recordings import ObjectState, PointIndices, Recording, SweepRef, Track
from bench.reference.sweeps import place_sweep

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
    """What the files hold, gathered sweep by sweep.

    Attributes:
        instances: (label, instance) -> sightings by time.
        loose: label -> sightings without an instance, by sweep.
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

    def read(self, source: Path, recording: Recording, options: LayerOptions) -> Layer:
        """Read a sequence's labels; see `LayerFormat.read`."""
        files = {file.stem: file for file in frame_files(source, ".label", folders=FOLDERS)}
        frames = pair_with_sweeps(files, recording, options, source=source)
        present = set[int]().union(*(labels_in(file) for file in files.values())) - set(NOT_TOLD)
        classes = map_classes(map(_name, present), options, source=source, known=CLASSES)
        expected = {label for label in present if classes[_name(label)] is not None}
        gathered = _Gathered()
        for name, sweep in frames.items():
            _gather(gathered, files[name], sweep, recording, expected)
        tracks = tuple(_tracks(gathered, classes, recording))
        times_ns = tuple(sweep.timestamp_ns for sweep in frames.values())
        return Layer(tracks=tracks, timestamps_ns=times_ns, lost=tuple(_loss(gathered, classes, tracks, options)))

    def write(self, layer: Layer, recording: Recording, out: Path, options: LayerOptions) -> tuple[str, ...]:
        """Write the folder labels/ of a sequence; see `LayerFormat.write`."""
        return write_layer(layer, recording, out / FOLDERS[0], options)


def _name(label: int) -> str:
    return NAMES.get(label, str(label))


def _stands(label: int) -> bool:
    """Whether a label says that its points did not move; of numbers that only the user knows it says nothing."""
    return label in NAMES and not is_moving(label)


def _gather(gathered: _Gathered, file: Path, sweep: SweepRef, recording: Recording, expected: set[int]) -> None:
    points = sweep.read()
    labels, instances = read_labels(file, points=len(points.points_lidar))
    placed = place_sweep(points, recording.trajectory, recording.vehicle_from_lidar)

    def seen(rows: NDArray[np.int64]) -> _Seen:
        offset_ns = round(float((points.times_ns[rows] - sweep.timestamp_ns).mean()))
        return _Seen(
            timestamp_ns=sweep.timestamp_ns,
            rows=rows,
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
            if not _stands(int(label)):
                groups = near_groups(points.points_lidar[of_instance])
                found = [seen(of_instance[groups == group]) for group in range(int(groups.max()) + 1)]
                gathered.loose[int(label)].append(found)


def _tracks(gathered: _Gathered, classes: Mapping[str, str | None], recording: Recording) -> list[Track]:
    tracks = []
    for (label, instance), sightings in sorted(gathered.instances.items()):
        if ours := classes[_name(label)]:
            tracks.append(_track(f"{_name(label)}-{instance}", ours, sightings, recording, stands=_stands(label)))
    for label, sweeps in sorted(gathered.loose.items()):
        if ours := classes[_name(label)]:
            for number, sightings in sorted(_followed(sweeps).items()):
                tracks.append(_track(f"{_name(label)}-group-{number + 1}", ours, sightings, recording, stands=False))
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


def _track(name: str, ours: str, sightings: Sequence[_Seen], recording: Recording, *, stands: bool) -> Track:
    times_ns = np.array([one.timestamp_ns for one in sightings], dtype=np.int64)
    if stands:
        velocities = np.zeros((len(sightings), 3))
    else:
        seen_ns = np.array([one.seen_ns for one in sightings], dtype=np.int64)
        world_mps = middle_velocities(seen_ns, np.array([one.middle_m for one in sightings]))
        world_from_vehicle, _, _ = recording.trajectory.at(times_ns)
        velocities = np.einsum("nji,nj->ni", world_from_vehicle, world_mps)
    states = tuple(
        ObjectState(
            timestamp_ns=one.timestamp_ns,
            shape=PointIndices(indices=one.rows.astype(np.int64), sweep_timestamp_ns=one.timestamp_ns),
            velocity_mps=velocity,
        )
        for one, velocity in zip(sightings, velocities, strict=True)
    )
    return Track(track_id=name, object_class=ours, states=states)


def _loss(
    gathered: _Gathered, classes: Mapping[str, str | None], tracks: Sequence[Track], options: LayerOptions
) -> list[str]:
    chosen = {name.casefold() for name in options.classes}
    lost = [
        f"{count} points of {_name(label)}: left out as asked"
        for label, count in sorted(gathered.points.items())
        if _name(label) in chosen and classes.get(_name(label), "") is None
    ]
    if unlabelled := sum(gathered.points[label] for label in NOT_TOLD):
        lost.append(f"{unlabelled} points of which the labels do not say what they are (unlabeled, outlier)")
    for label, count in sorted(gathered.nameless.items()):
        start = f"{count} points of {_name(label)} without an instance"
        groups = sum(track.track_id.startswith(f"{_name(label)}-group-") for track in tracks)
        standing = "left out, they stand" if _stands(label) else f"grouped by nearness and followed, {groups} objects"
        lost.append(f"{start}: {standing}")
    moving = [track for track in tracks if not all(np.array_equal(s.velocity_mps, np.zeros(3)) for s in track.states)]
    if moving:
        unknown = sum(not np.isfinite(state.velocity_mps).all() for track in moving for state in track.states)
        lost.append(
            f"velocities: labels tell none; those of {len(moving)} objects labelled as moving are estimated from the "
            f"middles of their points, {unknown} states stay without"
        )
    return lost
