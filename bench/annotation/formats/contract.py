"""The contract of label formats, and how classes, frames and times of a tool's files become those of a recording.

A frame is called as the file of its sweep, with or without leading zeros of a number, or as the sweep's time in
nanoseconds; all frames of a source in the same way. Frames that a tool counts by itself pair with sweeps only where the
user says which number the first sweep has, so that one sweep that is missing never shifts all others by one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.errors import DataError, UsageError
from bench.geometry import RigidTransform
from bench.plain_text import listed
from bench.recordings import (
    OBJECT_CLASSES,
    Cuboid,
    GroundPolygon,
    ObjectState,
    PointIndices,
    Recording,
    SweepRef,
    Track,
)

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
    middle_m: NDArray[np.float64] | None = None
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


def box_state(
    timestamp_ns: int, vehicle_from_box: RigidTransform, size_m: ArrayLike, velocity_mps: ArrayLike = (np.nan,) * 3
) -> ObjectState:
    """A box in the vehicle frame, its full size (3,), m, and its velocity over the ground (3,), m/s, where known."""
    shape = Cuboid(vehicle_from_object=vehicle_from_box, size_m=np.asarray(size_m, dtype=np.float64))
    velocity = np.asarray(velocity_mps, dtype=np.float64)
    return ObjectState(timestamp_ns=timestamp_ns, shape=shape, velocity_mps=velocity)


def data_lost(tracks: Sequence[Track], *, velocities: bool) -> list[str]:
    """Lines for what boxes alone cannot hold.

    Args:
        tracks: that are written.
        velocities: whether the format has a place for them.
    """
    states = [state for track in tracks for state in track.states]
    counts = {
        "ground outlines": sum(isinstance(state.shape, GroundPolygon) for state in states),
        "places that are given by points": sum(isinstance(state.shape, PointIndices) for state in states),
        "velocities": sum(bool(np.isfinite(state.velocity_mps).all()) for state in states if not velocities),
        "yaw rates": sum(bool(state.yaw_rate_radps) for state in states),
        "kinds of motion (category)": sum(state.category is not None for state in states),
        "marks of unclear objects": sum(state.unclear for state in states),
        "numbers in truth images (instance_id)": sum(track.instance_id is not None for track in tracks),
    }
    return [f"{count} {what}: no field for them" for what, count in counts.items() if count]
