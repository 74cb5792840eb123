"""Frames, times and coordinate frames of a tool's files <-> sweeps, times and frames of the recording.

A frame is called as the file of its sweep, with or without leading zeros of a number, or as the sweep's time in
nanoseconds; all frames of a source in the same way. Frames that a tool counts by itself pair with sweeps only where the
user says which number the first sweep has, so that one sweep that is missing never shifts all others by one.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from bench.annotation.formats.contract import OWN_FRAMES, LabelOptions, LabelSet
from bench.atomic import refuse_escape
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.plain_text import listed
from bench.recordings import Cuboid, GroundPolygon, ObjectState, PointIndices, Recording, SweepRef, Track

LARGEST_BYTES = 500_000_000  # of one file
SHOWN = 5  # names that a message lists
LONGEST_NUMBER = 19  # digits of a time in nanoseconds
LARGEST = 1e8  # m; coordinates of any map are below
NEAR_NS = 1_000_000  # a time so near to a sweep's is the sweep's: tools round
BEYOND_NS = 1_000_000_000  # times may be so far outside of the recording


def refuse_large(file: Path) -> None:
    """Refuse a file that would not fit into memory.

    Raises:
        DataError: it is too large.
    """
    if file.is_file() and file.stat().st_size > LARGEST_BYTES:
        raise DataError(file, expected=f"at most {LARGEST_BYTES} bytes", got=str(file.stat().st_size))


def frame_files(source: Path, suffix: str, *, folders: tuple[str, ...]) -> list[Path]:
    """The files of a tool's frames, by name.

    Args:
        source: their folder, or one that holds it.
        suffix: of the files, with its dot.
        folders: names that the folder can have in `source`.

    Raises:
        DataError: no such files, more than one of the folders, a link that leads out of `source`, a file that is
            too large.
    """
    if not source.is_dir():
        raise DataError(source, expected=f"a folder of {suffix} files", got="a file" if source.exists() else "nothing")
    inner = [source / name for name in folders if (source / name).is_dir()]
    if len(inner) > 1:
        got = " and ".join(path.name for path in inner)
        raise DataError(source, expected="one folder of labels", got=got, hint="give the one that is meant")
    folder = inner[0] if inner else source
    files = sorted(path for path in folder.iterdir() if path.suffix == suffix and not path.name.startswith("."))
    if not files:
        also = "".join(f" or {name}/" for name in folders)
        raise DataError(folder, expected=f"files <frame>{suffix}, here{also}", got="none")
    for file in files:
        refuse_escape(source, file, file=file)
        if not file.is_file():
            raise DataError(file, expected="a file", got="a folder or nothing behind a link")
        refuse_large(file)
    return files


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
    found = [{name: way[key] for name in names for key in (name, _plain(name)) if key in way} for way in keyed]
    paired = max(found, key=len)
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


def vehicle_from_own(frame: str, timestamp_ns: int, recording: Recording) -> RigidTransform:
    """The vehicle frame at a time from one of `OWN_FRAMES`.

    Raises:
        DataError: "world" at a time without ego-motion.
    """
    if frame == "world":
        return recording.trajectory.world_from_vehicle(timestamp_ns).inverse()
    return recording.vehicle_from_lidar if frame == "lidar" else RigidTransform.identity()


def own_frame(name: str, options: LabelOptions, *, source: Path, field: str) -> str:
    """The frame of ours that the user or the file means by a name.

    Raises:
        DataError: nobody says.
    """
    meant = options.frames.get(name, name)
    if meant not in OWN_FRAMES:
        expected, hint = f"one of {', '.join(OWN_FRAMES)}", f"say with --frame {name}=lidar (or vehicle, world)"
        raise DataError(source, field=field, expected=expected, got=repr(name) if name else "none", hint=hint)
    return meant


def box_state(timestamp_ns: int, vehicle_from_box: RigidTransform, size_m: object) -> ObjectState:
    """A box whose velocity is unknown."""
    shape = Cuboid(vehicle_from_object=vehicle_from_box, size_m=np.asarray(size_m, dtype=np.float64))
    return ObjectState(timestamp_ns=timestamp_ns, shape=shape, velocity_mps=np.full(3, np.nan))


def boxes_at_sweeps(label_set: LabelSet, recording: Recording) -> tuple[dict[str, list[tuple[int, Cuboid]]], list[str]]:
    """Select the boxes that a tool can hold that draws them into sweeps.

    Returns:
        boxes: track -> sweep's time and box.
        lost: a line for states between sweeps, if there are some.
    """
    sweeps_ns = {sweep.timestamp_ns for sweep in recording.sweeps}
    boxes = {
        track.track_id: [
            (state.timestamp_ns, state.shape)
            for state in track.states
            if state.timestamp_ns in sweeps_ns and isinstance(state.shape, Cuboid)
        ]
        for track in label_set.tracks
    }
    between = sum(state.timestamp_ns not in sweeps_ns for track in label_set.tracks for state in track.states)
    return boxes, [f"{between} states at times at which there is no sweep"] if between else []


def data_lost(tracks: Sequence[Track], *, kept: Collection[str]) -> list[str]:
    """Lines for what a format has no place for.

    Args:
        tracks: that are written.
        kept: what the format has, of the names here.
    """
    states = [state for track in tracks for state in track.states]
    counts = {
        "boxes": sum(isinstance(state.shape, Cuboid) for state in states),
        "ground outlines": sum(isinstance(state.shape, GroundPolygon) for state in states),
        "places that are given by points": sum(isinstance(state.shape, PointIndices) for state in states),
        "velocities": sum(bool(np.isfinite(state.velocity_mps).all()) for state in states),
        "yaw rates": sum(bool(state.yaw_rate_radps) for state in states),
        "kinds of motion (category)": sum(state.category is not None for state in states),
        "marks of unclear objects": sum(state.unclear for state in states),
        "numbers in truth images (instance_id)": sum(track.instance_id is not None for track in tracks),
    }
    return [f"{count} {what}: no field for them" for what, count in counts.items() if count and what not in kept]
