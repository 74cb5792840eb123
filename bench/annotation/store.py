"""The file of a review: what was proposed, what was decided, and which sweeps were watched.

`<recording>.review.json` holds proposals as they were made and decisions as a log in the order in which they were made.
What is true now is never stored: `bench.annotation.decisions.applied` computes it from both. Positions are in the world
frame of the recording's trajectory.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AwareDatetime, Field, model_validator

from bench.atomic import read_regular, write_bytes
from bench.errors import DataError, UsageError
from bench.recordings.annotations import REVIEW_SUFFIX
from bench.recordings.validation import FileModel, TimeNs, parse_json
from bench.records.recording import MotionKind
from bench.records.reference import ObjectClass

Floats = NDArray[np.float64]

LARGEST_BYTES = 64_000_000

TrackId = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}(\.[0-9]{1,4}){0,8}$")]  # with what splits append
Position = Annotated[float, Field(ge=-1e7, le=1e7)]
Angle = Annotated[float, Field(ge=-1e4, le=1e4)]
Side = Annotated[float, Field(gt=0.0, le=100.0)]
Speed = Annotated[float, Field(ge=-200.0, le=200.0)]
Point = tuple[Position, Position, Position]
Size = tuple[Side, Side, Side]


class Doubt(FileModel):
    """A reason to look at a proposal twice.

    Attributes:
        reason: in words, such as "few returns".
        value: the number behind it.
    """

    reason: str = Field(min_length=1, max_length=200)
    value: float


class BoxState(FileModel):
    """A track's box at one time.

    Attributes:
        timestamp_ns: of the box.
        centre_m: the box's centre, world frame, m.
        yaw_rad: heading, from the world's x to its y axis; boxes stand upright.
        velocity_mps: over the ground along the world's x and y, m/s.
    """

    timestamp_ns: TimeNs
    centre_m: Point
    yaw_rad: Angle
    velocity_mps: tuple[Speed, Speed]


class StoredTrack(FileModel):
    """One object through the recording, as it was proposed or drawn.

    Attributes:
        id: unique in the file.
        object_class: what it is, or seems to be.
        category: its kind of motion where somebody says so; None leaves it to the reference.
        unclear: nobody could tell; it is ignored when scored.
        size_m: full length, width and height, m; one for all its states.
        doubts: reasons to look twice.
        points_median: returns in its box, the median over its states.
        states: by increasing time.
    """

    id: TrackId
    object_class: ObjectClass
    category: MotionKind | None = None
    unclear: bool = False
    size_m: Size
    doubts: tuple[Doubt, ...] = ()
    points_median: float = Field(default=0.0, ge=0.0)
    states: tuple[BoxState, ...] = Field(min_length=1)

    @property
    def reasons(self) -> set[str]:
        """Those of its doubts."""
        return {doubt.reason for doubt in self.doubts}

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        times_ns = [state.timestamp_ns for state in self.states]
        if any(b <= a for a, b in pairwise(times_ns)):
            raise ValueError("states by increasing time, each time once")
        return self


class Proposed(FileModel):
    """Digests of what the proposals were made from and by."""

    data: str = Field(max_length=200)
    code: str = Field(max_length=200)


class Decided(FileModel):
    """Part of every decision: when and by whom it was made."""

    made_at: AwareDatetime
    reviewer: str = Field(max_length=100)


Tracks = Annotated[tuple[TrackId, ...], Field(min_length=1, max_length=10_000)]


class Judge(Decided):
    """The tracks are right, or no objects that move, or neither is decided any more."""

    action: Literal["accept", "reject", "reopen"]
    tracks: Tracks


class SetClass(Decided):
    """The tracks are of this class."""

    action: Literal["set_class"] = "set_class"
    tracks: Tracks
    object_class: ObjectClass


class SetUnclear(Decided):
    """Nobody can tell what the tracks are, or somebody can after all."""

    action: Literal["set_unclear"] = "set_unclear"
    tracks: Tracks
    unclear: bool


class SetCategory(Decided):
    """The tracks move in this way; None leaves it to the reference."""

    action: Literal["set_category"] = "set_category"
    tracks: Tracks
    category: MotionKind | None


class Merge(Decided):
    """The tracks are one object, which keeps the first's id and class."""

    action: Literal["merge"] = "merge"
    tracks: Annotated[tuple[TrackId, ...], Field(min_length=2, max_length=1000)]


class SplitTime(Decided):
    """From this time on the track is another object."""

    action: Literal["split_time"] = "split_time"
    track: TrackId
    timestamp_ns: TimeNs


class SplitSpace(Decided):
    """The box holds two objects, on both sides of a line.

    Attributes:
        track: the track.
        timestamp_ns: when the line was drawn; it then moves with the box.
        line_m: two points of the line, x and y in the world, m.
    """

    action: Literal["split_space"] = "split_space"
    track: TrackId
    timestamp_ns: TimeNs
    line_m: tuple[tuple[Position, Position], tuple[Position, Position]]


class SetBox(Decided):
    """A key frame: where the box is at one time, and its size at all times.

    Between key frames the correction is interpolated along the motion that was found. A key frame before the first or
    after the last state carries the track on to there.
    """

    action: Literal["set_box"] = "set_box"
    track: TrackId
    timestamp_ns: TimeNs
    centre_m: Point
    yaw_rad: Angle
    size_m: Size


class Draw(Decided):
    """An object that was not proposed."""

    action: Literal["draw"] = "draw"
    drawn: StoredTrack


class Undo(Decided):
    """Takes back the latest decision in force."""

    action: Literal["undo"] = "undo"


class Redo(Decided):
    """Makes the decision again that was taken back last, if none was made since."""

    action: Literal["redo"] = "redo"


Decision = Annotated[
    Judge | SetClass | SetUnclear | SetCategory | Merge | SplitTime | SplitSpace | SetBox | Draw | Undo | Redo,
    Field(discriminator="action"),
]


class Review(FileModel):
    """The content of the file.

    Attributes:
        schema_version: of the format.
        dataset: name of the data set.
        recording: name of the recording.
        proposed: what the proposals were made from; None where all tracks are drawn.
        tracks: proposals.
        decisions: in the order in which they were made.
        watched_ns: times of the sweeps that were played.
    """

    schema_version: Literal[1] = 1
    dataset: str = Field(max_length=1000)
    recording: str = Field(max_length=1000)
    proposed: Proposed | None = None
    tracks: tuple[StoredTrack, ...] = ()
    decisions: tuple[Decision, ...] = ()
    watched_ns: tuple[TimeNs, ...] = ()

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        if len({track.id for track in self.tracks}) < len(self.tracks):
            raise ValueError("each id of a track once")
        return self

    def watched(self, times_ns: Iterable[int]) -> Review:
        """The same file, of which more sweeps were played."""
        return self.model_copy(update={"watched_ns": tuple(sorted({*self.watched_ns, *times_ns}))})


def review_file(folder: Path, recording: str) -> Path:
    """The file of a recording's review in a folder of annotations."""
    return folder / f"{recording}{REVIEW_SUFFIX}"


def read_review(file: Path) -> Review:
    """Read a review; its file is called after its recording.

    Raises:
        DataError: missing, larger than 64 MB, not what the format asks for, or a copy of another recording's.
    """
    try:
        content = read_regular(file, largest_bytes=LARGEST_BYTES)
    except OSError as error:
        hint = "make it with `fisheye-bench annotate propose`" if not file.exists() else ""
        raise DataError(file, expected="a readable review", got=error.strerror or str(error), hint=hint) from error
    review = parse_json(Review, content, file)
    if review_file(file.parent, review.recording) != file:
        expected, hint = repr(file.name.removesuffix(REVIEW_SUFFIX)), "it is a copy of another drive's: take it away"
        raise DataError(file, field="recording", expected=expected, got=repr(review.recording), hint=hint)
    return review


def write_review(file: Path, review: Review) -> None:
    """Write a review, whole or not at all.

    Raises:
        UsageError: it would be larger than what can be read back.
        OutputError: it cannot be written.
    """
    content = (review.model_dump_json() + "\n").encode()
    if len(content) > LARGEST_BYTES:
        raise UsageError(f"{file}: expected a review of at most {LARGEST_BYTES} bytes, got {len(content)}")
    write_bytes(file, content)


def box_states(
    times_ns: NDArray[np.int64], centres_m: Floats, yaws_rad: Floats, velocities_mps: Floats
) -> tuple[BoxState, ...]:
    """Arrays as states of a file: (N,) times, (N, 3) centres, (N,) headings and (N, 2) velocities, world frame."""
    rows = zip(*(values.tolist() for values in (times_ns, centres_m, yaws_rad, velocities_mps)), strict=True)
    return tuple(
        BoxState(timestamp_ns=time_ns, centre_m=centre_m, yaw_rad=yaw_rad, velocity_mps=velocity_mps)
        for time_ns, centre_m, yaw_rad, velocity_mps in rows
    )
