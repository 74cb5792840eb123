"""The registered label formats, and the conversion of a tool's files to tracks.

Velocities that files do not hold come from places; objects without ids are followed from time to time.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from bench.annotation.formats.contract import UNCLEAR, LabelFormat, LabelOptions, Observation, map_classes
from bench.egomotion import Trajectory
from bench.errors import DataError, UnknownNameError
from bench.plug_ins import imported, known_targets
from bench.recordings import Cuboid, ObjectState, Recording, Track
from bench.records.recording import world_velocities, world_yaw_rates
from bench.times import SECOND_NS

Floats = NDArray[np.float64]
ENTRY_POINTS = "fisheye_bench.labels"
LABEL_FORMATS = {
    "boxes": "bench.annotation.formats.table:BoxTable",
    "openlabel": "bench.annotation.formats.openlabel:OpenLabelFormat",
    "cvat": "bench.annotation.formats.tracklets:CvatTracklets",
    "semantickitti": "bench.annotation.formats.semantickitti:SemanticKitti",
}
LONGEST_GAP_NS = SECOND_NS  # an object that was out of sight for longer says nothing of its speed
WINDOW_NS = SECOND_NS  # the visible side of an object changes: shorter windows give its jitter, not its motion
FASTEST_MPS = {"pedestrian": 5.0, "cyclist": 15.0, "animal": 15.0, "vehicle": 30.0, "unclear": 30.0}
JITTER_M = 1.0  # of the middle of what is seen


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LabelSet:
    """Annotations of one recording, and when the scene was annotated.

    Attributes:
        tracks: objects; their states are in the vehicle frame at each state's time.
        timestamps_ns: all annotated times, also those at which the scene held nothing, increasing.
        lost: one line for each thing that the source does not hold or that was lost in the translation.
    """

    tracks: tuple[Track, ...]
    timestamps_ns: tuple[int, ...]
    lost: tuple[str, ...] = ()


def known_formats() -> dict[str, str]:
    """Name -> "module:Class" of the package's formats and of those that installed packages add."""
    return known_targets(ENTRY_POINTS, LABEL_FORMATS)


def label_format(name: str) -> LabelFormat:
    """A format of labels.

    Raises:
        UnknownNameError: no such format.
        UsageError: nothing to import where an installed package says that it is.
    """
    known = known_formats()
    if name not in known:
        raise UnknownNameError("label format", name, known)
    chosen: LabelFormat = imported(known[name], expected=f"format {name!r}: expected a class")()
    return chosen


def import_labels(format_name: str, source: Path, recording: Recording, options: LabelOptions) -> LabelSet:
    """Read a tool's files.

    Args:
        format_name: of the files.
        source: the tool's file or folder.
        recording: what was annotated.
        options: what the user says about the files.

    Raises:
        UnknownNameError: no such format.
        DataError: files that the format refuses, unknown classes, an object of two classes, or twice at one time.
    """
    labels = label_format(format_name).read(source, recording, options)
    classes = map_classes((observation.label for observation in labels.observations), options, source=source)
    left_out: Counter[str] = Counter(o.label for o in labels.observations if classes[o.label] is None)
    lost = [*labels.lost, *(f"{n} places of class {name!r}, left out as asked" for name, n in left_out.items())]
    by_track = _by_track([o for o in labels.observations if classes[o.label]], classes, recording, lost)
    tracks = [_track(name, seen, classes, recording, source) for name, seen in by_track.items()]
    if single := sum(len(track.states) == 1 for track in tracks):
        lost.append(f"{single} objects are seen once, so that their speed is unknown where the files do not say it")
    times_ns = set(labels.timestamps_ns)
    if missing := [sweep for sweep in recording.sweeps if sweep.timestamp_ns not in times_ns]:
        lost.append(
            f"{len(missing)} of {len(recording.sweeps)} sweeps have no frame in the source, first "
            f"{missing[0].path.name}: their images count as annotated unless the card excludes them"
        )
    return LabelSet(tracks=tuple(tracks), timestamps_ns=tuple(sorted(times_ns)), lost=tuple(lost))


def _by_track(
    observations: Sequence[Observation], classes: Mapping[str, str | None], recording: Recording, lost: list[str]
) -> dict[str, list[Observation]]:
    """Observations by object, each by time; those without ids are followed by nearness, class by class."""
    tracks: dict[str, list[Observation]] = defaultdict(list)
    loose: dict[str, dict[int, list[Observation]]] = defaultdict(lambda: defaultdict(list))
    for observation in sorted(observations, key=lambda o: o.state.timestamp_ns):
        if observation.track:
            tracks[observation.track].append(observation)
        else:
            loose[observation.label][observation.state.timestamp_ns].append(observation)
    for label, by_time in loose.items():
        places_m = [_places(together, recording.trajectory) for together in by_time.values()]
        numbers = followed(list(by_time), places_m, fastest_mps=FASTEST_MPS[classes[label] or UNCLEAR])
        for together, row in zip(by_time.values(), numbers, strict=True):
            for observation, number in zip(together, row, strict=True):
                tracks[f"{label}-unnamed-{number + 1}"].append(observation)
        count, objects = sum(map(len, by_time.values())), 1 + max(max(row) for row in numbers)
        lost.append(f"{count} places of {label} without an id: followed by nearness, {objects} objects")
    return tracks


def _places(seen: Sequence[Observation], trajectory: Trajectory) -> Floats:
    """(N, 3) m, world frame, middles of boxes or points; NaN without ego-motion."""
    rotations, positions_m, _ = trajectory.at(np.array([o.state.timestamp_ns for o in seen], dtype=np.int64))
    places_m = np.empty((len(seen), 3))
    for i, observation in enumerate(seen):
        if isinstance(shape := observation.state.shape, Cuboid):
            places_m[i] = rotations[i] @ shape.vehicle_from_object.translation_m + positions_m[i]
        else:
            places_m[i] = observation.middle_m
    return places_m


def _track(
    name: str, seen: Sequence[Observation], classes: Mapping[str, str | None], recording: Recording, source: Path
) -> Track:
    field = f"object {name!r}"
    if len(kinds := {classes[o.label]: o.label for o in seen}) > 1:
        got = " and ".join(map(repr, kinds.values()))
        raise DataError(source, field=field, expected="one class for each object", got=got)
    for time_ns, count in Counter(o.state.timestamp_ns for o in seen).items():
        if count > 1:
            raise DataError(source, field=field, expected="one place at each time", got=f"{count} at {time_ns}")
    ours = classes[seen[0].label]
    assert ours is not None
    states = with_motion(seen, recording.trajectory)
    if ours == UNCLEAR:
        states = [replace(state, unclear=True) for state in states]
    object_class = "vehicle" if ours == UNCLEAR else ours  # of what is not scored it does not matter
    return Track(track_id=name, object_class=object_class, states=tuple(states))


def with_motion(seen: Sequence[Observation], trajectory: Trajectory) -> list[ObjectState]:
    """States with velocities, and of boxes with yaw rates, where they have none, from their places in the world.

    Velocities stay NaN where there is no ego-motion, and where an object is seen once in a second.

    Args:
        seen: of one object, by time; boxes, or points.
        trajectory: of the ego vehicle.
    """
    states = [observation.state for observation in seen]
    times_ns = np.array([state.timestamp_ns for state in states], dtype=np.int64)
    rotations, _, _ = trajectory.at(times_ns)
    places_m, turns_radps = _places(seen, trajectory), np.zeros(len(seen))
    boxes = [state.shape.vehicle_from_object.rotation for state in states if isinstance(state.shape, Cuboid)]
    if boxes:
        headings, world_mps = rotations @ np.stack(boxes), np.full(places_m.shape, np.nan)
        for run in np.split(np.arange(len(seen)), np.flatnonzero(np.diff(times_ns) > LONGEST_GAP_NS) + 1):
            known = run[np.isfinite(places_m[run]).all(axis=1)]
            if len(known) > 1:
                world_mps[known] = world_velocities(times_ns[known], places_m[known])
                turns_radps[known] = world_yaw_rates(times_ns[known], headings[known])
    else:
        world_mps = middle_velocities(np.array([o.seen_ns for o in seen], dtype=np.int64), places_m)
    velocities_mps = np.einsum("nji,nj->ni", rotations, world_mps)
    return [
        replace(state, velocity_mps=velocity_mps, yaw_rate_radps=float(turn_radps))
        if np.isnan(state.velocity_mps).any()
        else state
        for state, velocity_mps, turn_radps in zip(states, velocities_mps, turns_radps, strict=True)
    ]


def middle_velocities(times_ns: NDArray[np.int64], middles_m: Floats) -> Floats:
    """Velocity at each time: the slope of a straight line through the middles half a second before and after.

    Args:
        times_ns: (N,) int64, increasing; mean time of the points.
        middles_m: (N, 3) float64, m, world frame; NaN where unknown.

    Returns:
        (N, 3) float64, m/s, world axes; NaN where fewer than two middles are known within the window.
    """
    velocities = np.full(middles_m.shape, np.nan)
    known = np.flatnonzero(np.isfinite(middles_m).all(axis=1))
    known_ns = times_ns[known]
    first = np.searchsorted(known_ns, times_ns - WINDOW_NS // 2, side="left")
    last = np.searchsorted(known_ns, times_ns + WINDOW_NS // 2, side="right")
    for row in np.flatnonzero(last - first >= 2):
        used = known[first[row] : last[row]]
        seconds = (times_ns[used] - times_ns[row]) / SECOND_NS
        away = seconds - seconds.mean()
        velocities[row] = away @ middles_m[used] / (away @ away)
    return velocities


def followed(times_ns: Sequence[int], places_m: Sequence[Floats], *, fastest_mps: float) -> list[list[int]]:
    """Number objects without ids so that one keeps its number from time to time.

    They are paired with where the objects so far should be, all at once with the smallest sum of distances. What is
    further away than the fastest could have gone since is a new object.

    Args:
        times_ns: increasing, each time once.
        places_m: of the objects at each time, (K, 3), m, world frame; NaN where unknown.
        fastest_mps: how fast such an object may be.

    Returns:
        For each time the number of each of its objects, from 0 on.
    """
    known: dict[int, tuple[int, Floats, Floats]] = {}  # when and where each was last seen, and how fast it was
    count = 0
    numbers: list[list[int]] = []
    for time_ns, places in zip(times_ns, places_m, strict=True):
        known = {number: last for number, last in known.items() if time_ns - last[0] <= LONGEST_GAP_NS}
        gaps_s = np.array([(time_ns - seen_ns) / SECOND_NS for seen_ns, _, _ in known.values()])
        last_m, last_mps = (np.array([last[i] for last in known.values()]).reshape(-1, 3) for i in (1, 2))
        away = cdist(places, last_m + last_mps * gaps_s[:, None]) / (JITTER_M + fastest_mps * gaps_s)
        away = np.minimum(np.nan_to_num(away, nan=1.0), 1.0)  # what is too far costs the same, and pushes nothing apart
        pairs = {int(a): int(b) for a, b in zip(*linear_sum_assignment(away), strict=True) if away[a, b] < 1.0}
        names, row = list(known), []
        for i, place_m in enumerate(places):
            number, velocity_mps = count, np.zeros(3)
            if (pair := pairs.get(i)) is not None:
                number, velocity_mps = names[pair], (place_m - last_m[pair]) / gaps_s[pair]
            count += number == count
            known[number] = time_ns, place_m, velocity_mps
            row.append(number)
        numbers.append(row)
    return numbers
