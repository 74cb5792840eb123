"""The contract of label formats, and the conversion of a tool's files to tracks.

A frame is called as the file of its sweep, with or without leading zeros of a number, or as the sweep's time in
nanoseconds; all frames of a source in the same way. Frames that a tool counts by itself pair with sweeps only where the
user says which number the first sweep has, so that one sweep that is missing never shifts all others by one.

Velocities that files do not hold come from places; objects without ids are followed from time to time.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os.path import lexists
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from bench.atomic import write_bytes
from bench.egomotion.trajectory import Trajectory
from bench.errors import DataError, OutputError, UnknownNameError, UsageError
from bench.geometry import RigidTransform
from bench.plain_text import counted, listed
from bench.plug_ins import imported
from bench.recordings import Cuboid, ObjectState, Recording, SweepRef, Track
from bench.records.recording import world_velocities, world_yaw_rates
from bench.records.reference import OBJECT_CLASSES
from bench.times import SECOND_NS, unit_hint

Floats = NDArray[np.float64]
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
UNCLEAR = "unclear"  # in place of a class: nobody can tell what it is, so that its area is not scored
OWN_FRAMES = ("vehicle", "lidar", "world")
WELL_KNOWN: dict[str, str | None] = {  # names that need no explanation, in lower case; upper and lower case are one
    **{name: name for name in OBJECT_CLASSES},
    **dict.fromkeys(("person", "person (sitting)", "person_sitting", "adult", "child", "people"), "pedestrian"),
    **dict.fromkeys(("bicycle", "bicyclist", "bike", "motorbike", "motorcycle", "motorcyclist", "rider"), "cyclist"),
    **dict.fromkeys(
        ("car", "van", "truck", "bus", "tram", "train", "trailer", "caravan", "on-rails", "other-vehicle"), "vehicle"
    ),
    **dict.fromkeys(("dontcare", "don't care", "dont_care", "ignore"), UNCLEAR),
}
SHOWN = 5  # names that a message lists
LARGEST_BYTES = 500_000_000  # of one file
LONGEST_NUMBER = 19  # digits of a time in nanoseconds
NEAR_NS = 1_000_000  # a time so near to a sweep's is the sweep's: tools round
BEYOND_NS = 1_000_000_000  # times may be so far outside of the recording
Files = dict[str, bytes]  # name -> content


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Observation:
    """An object at one time, as a tool's files have it.

    Attributes:
        track: the object's id; empty where the files have none.
        label: the tool's class.
        state: a box or points, in the vehicle frame; without velocity where the files have none.
        middle_m: (3,) float64, m, world frame, mean of the object's points; None for boxes, NaN without ego-motion.
        seen_ns: mean time of these points.
    """

    track: str
    label: str
    state: ObjectState
    middle_m: Floats | None = None
    seen_ns: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolLabels:
    """Content of a tool's files.

    Attributes:
        observations: of all objects at all times, in any order.
        timestamps_ns: all annotated times, also those at which the scene held nothing.
        lost: one line for each thing that was not read.
    """

    observations: Sequence[Observation]
    timestamps_ns: Sequence[int]
    lost: Sequence[str] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelOptions:
    """What the user says about a tool's files.

    Attributes:
        classes: the tool's class -> one of `OBJECT_CLASSES`, "unclear", or None to leave its objects out.
        frames: name of a frame in the files -> "vehicle", "lidar" or "world"; "" for boxes that name none.
        first_frame: number of the first sweep in the tool's frames, which are then counted; None for frames that are
            called as the sweeps.
        unit_ns: of times that do not say their unit.

    Raises:
        UsageError: a class or frame that is none of ours.
    """

    classes: Mapping[str, str | None] = field(default_factory=dict)
    frames: Mapping[str, str] = field(default_factory=dict)
    first_frame: int | None = None
    unit_ns: int = 1

    def __post_init__(self) -> None:
        for kind, given, known in (
            ("class", self.classes, (*OBJECT_CLASSES, UNCLEAR, None)),
            ("frame", self.frames, OWN_FRAMES),
        ):
            for name, ours in given.items():
                if ours not in known:
                    named = ", ".join(filter(None, known))
                    raise UsageError(f"{kind} {name!r}: expected one of {named}, got {ours!r}")


class LabelFormat(ABC):
    """Translates the files of a tool; without state.

    Attributes:
        name: as the registry knows it, for example "openlabel".
        description: one line, for the listing.
    """

    name: str
    description: str

    @abstractmethod
    def read(self, source: Path, recording: Recording, options: LabelOptions) -> ToolLabels:
        """Read labels.

        Args:
            source: the tool's file or folder.
            recording: what was annotated; its own tracks are not looked at.
            options: what the user says about the files.

        Raises:
            DataError: not what the format asks for, or frames that do not pair with the recording's.
        """

    def write(self, recording: Recording) -> tuple[Files, list[str]]:  # noqa: ARG002
        """Return the annotations of a recording as a tool's files.

        Args:
            recording: with its annotations; all its sweeps count as annotated.

        Returns:
            files: name -> content.
            lost: one line for each thing that the format cannot hold.

        Raises:
            UsageError: a format that is only read.
        """
        raise UsageError(f"format {self.name!r}: expected one that can be written, got one that is only read")


def lost_lines(counts: Mapping[str, int]) -> list[str]:
    """Lines for things that were not read or cannot be written: what and why, and how many, if there are."""
    return [f"{what} ({count})" for what, count in counts.items() if count]


def map_classes(labels: Iterable[str], options: LabelOptions, *, source: Path) -> dict[str, str | None]:
    """Return our class for each of a tool's classes.

    Args:
        labels: the classes of a source, as it spells them.
        options: the user's own map goes first; there, too, upper and lower case are one.
        source: the tool's file or folder, for messages.

    Returns:
        Class as the source has it -> one of `OBJECT_CLASSES`, "unclear", or None for one that is left out.

    Raises:
        DataError: unknown classes, all at once.
    """
    table = WELL_KNOWN | {name.casefold(): ours for name, ours in options.classes.items()}
    classes = sorted(set(labels))
    unknown = [name for name in classes if name.casefold() not in table]
    if unknown:
        known = ", ".join(OBJECT_CLASSES)
        hint = f"map each of them, as --class '{unknown[0]}=CLASS'; CLASS is one of {known}, unclear (not scored "
        raise DataError(
            source,
            field="classes",
            expected=f"classes that map to one of {known}",
            got=", ".join(repr(name) for name in unknown),
            hint=f"{hint}there), or none to leave the objects out",
        )
    return {name: table[name.casefold()] for name in classes}


def pair_with_sweeps(
    names: Collection[str], recording: Recording, options: LabelOptions, *, source: Path
) -> dict[str, SweepRef]:
    """The sweep of each frame.

    Args:
        names: of the tool's frames: stems of files, or numbers as text.
        recording: what was annotated.
        options: for `first_frame`.
        source: the tool's file or folder, for messages.

    Returns:
        Name -> sweep, in the order of the sweeps.

    Raises:
        DataError: frames that fit no sweep, fit some only, or two frames of one sweep.
    """
    sweeps = recording.sweeps
    if not sweeps:
        raise DataError(source, expected=f"a recording with lidar sweeps, as {recording.name!r}", got="none")
    stems = [sweep.path.stem for sweep in sweeps]
    expected = f"frames named like the {len(sweeps)} sweeps, {stems[0]} to {stems[-1]}"
    hint = "name frames after the sweeps; or, where they are counted, say with --first-frame which the first is"
    ways = [stems, [_plain(stem) for stem in stems], [str(sweep.timestamp_ns) for sweep in sweeps]]
    if (first := options.first_frame) is not None:
        expected = f"frames from {first} to {first + len(sweeps) - 1}"
        hint = "--first-frame is the number of the recording's first sweep"
        ways = [[str(first + i) for i in range(len(sweeps))]]
    keyed = [dict(zip(way, sweeps, strict=True)) for way in ways]
    pairs = [{name: way[key] for name in names for key in (name, _plain(name)) if key in way} for way in keyed]
    paired = max(pairs, key=len)
    if unpaired := [name for name in names if name not in paired]:
        raise DataError(source, field="frames", expected=expected, got=listed(unpaired, SHOWN), hint=hint)
    frames: dict[int, str] = {}
    for name, sweep in paired.items():
        if (other := frames.setdefault(sweep.timestamp_ns, name)) != name:
            got = f"{other!r} and {name!r} of {sweep.path.name}"
            raise DataError(source, expected="one frame for each sweep", got=got)
    return dict(sorted(paired.items(), key=lambda item: item[1].timestamp_ns))


def _plain(name: str) -> str:
    """A number without leading zeros; anything else as it is."""
    return str(int(name)) if name.isascii() and name.isdigit() and len(name) <= LONGEST_NUMBER else name


def recording_times(times_ns: Sequence[int], recording: Recording, *, source: Path, field: str) -> list[int]:
    """Times of a file as times of the recording: within a millisecond of a sweep's they are the sweep's.

    Args:
        times_ns: int, since the epoch of the recording.
        recording: what was annotated.
        source: the file, for messages.
        field: of the times.

    Raises:
        DataError: a time more than a second outside of the recording.
    """
    sweeps_ns = sorted(sweep.timestamp_ns for sweep in recording.sweeps)
    images_ns = [image.timestamp_ns for images in recording.images.values() for image in images]
    first_ns, last_ns = min([*sweeps_ns, *images_ns], default=0), max([*sweeps_ns, *images_ns], default=0)
    paired = []
    for time_ns in times_ns:
        if not first_ns - BEYOND_NS <= time_ns <= last_ns + BEYOND_NS:
            expected = f"times of the recording, {first_ns} to {last_ns} ns"
            hint = "give the unit of the times with --time-unit, or the right recording"
            raise DataError(source, field=field, expected=expected, got=f"{time_ns} ns", hint=hint)
        place = bisect_left(sweeps_ns, time_ns)
        near = [t for t in sweeps_ns[max(place - 1, 0) : place + 1] if abs(t - time_ns) <= NEAR_NS]
        paired.append(min(near, key=lambda t: abs(t - time_ns), default=time_ns))
    return paired


def vehicle_from_tool(
    name: str, timestamp_ns: int, recording: Recording, options: LabelOptions, source: Path, field: str
) -> RigidTransform:
    """The vehicle frame at a time from a frame of a tool, which the file or the user says is one of `OWN_FRAMES`.

    Args:
        name: of the frame; empty where the file names none.
        timestamp_ns: of the boxes.
        recording: what was annotated.
        options: for `frames`.
        source: the file, for messages.
        field: of the frame.

    Raises:
        DataError: nobody says which it is, or "world" at a time without ego-motion.
    """
    frame = options.frames.get(name, name)
    if frame not in OWN_FRAMES:
        expected, hint = (
            f"one of {', '.join(OWN_FRAMES)}",
            f"say with --frame {f'{name}=' if name else ''}lidar (or vehicle, world)",
        )
        raise DataError(source, field=field, expected=expected, got=repr(name) if name else "none", hint=hint)
    if frame == "world":
        return recording.trajectory.world_from_vehicle(timestamp_ns).inverse()
    return recording.vehicle_from_lidar if frame == "lidar" else RigidTransform.identity()


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


def label_format(name: str) -> LabelFormat:
    """A format of labels.

    Raises:
        UnknownNameError: no such format.
    """
    if name not in LABEL_FORMATS:
        raise UnknownNameError("label format", name, LABEL_FORMATS)
    chosen: LabelFormat = imported(LABEL_FORMATS[name], expected=f"format {name!r}: expected a class")()
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
        DataError: files that the format refuses, times of another unit, unknown classes, an object of two classes, or
            twice at one time.
    """
    labels = label_format(format_name).read(source, recording, options)
    classes = map_classes((observation.label for observation in labels.observations), options, source=source)
    left_out = Counter(
        f"places of class {o.label!r}: left out as asked" for o in labels.observations if not classes[o.label]
    )
    lost = [*labels.lost, *lost_lines(left_out)]
    by_track = _by_track([o for o in labels.observations if classes[o.label]], classes, recording, lost)
    tracks = [_track(name, seen, classes, recording, source) for name, seen in by_track.items()]
    single = "objects that are seen once: their speed is unknown where the files do not say it"
    lost += lost_lines({single: sum(len(track.states) == 1 for track in tracks)})
    times_ns = set(labels.timestamps_ns)
    if missing := [sweep for sweep in recording.sweeps if sweep.timestamp_ns not in times_ns]:
        if len(missing) == len(recording.sweeps) and (hint := unit_hint([*times_ns])):
            got = f"{min(times_ns)} to {max(times_ns)}"
            raise DataError(source, field="times", expected="nanoseconds, as of the sweeps", got=got, hint=hint)
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
        objects = counted(1 + max(max(row) for row in numbers), "object")
        loose_places = f"places of {label} without an id: followed by nearness, {objects}"
        lost += lost_lines({loose_places: sum(map(len, by_time.values()))})
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


def store_labels(folder: Path, files: Mapping[str, bytes], *, overwrite: bool = False) -> tuple[Path, ...]:
    """Write label files, all or none.

    Args:
        folder: of the files; made where it is not there.
        files: name -> content.
        overwrite: replace also files of another content, and keep a copy of each, `<name>.1` and on.

    Returns:
        The copies.

    Raises:
        OutputError: a file of another content is in the way, or one cannot be written.
    """
    others = [name for name in files if (folder / name).is_file() and (folder / name).read_bytes() != files[name]]
    if others and not overwrite:
        hint = "give another folder; or --overwrite, which keeps a copy of them"
        raise OutputError(folder / others[0], got="other labels that are there", hint=hint)
    copies = []
    for name in others:
        copies.append(next(path for i in itertools.count(1) if not lexists(path := folder / f"{name}.{i}")))
        write_bytes(copies[-1], (folder / name).read_bytes())
    for name, content in files.items():
        write_bytes(folder / name, content)
    return tuple(copies)
