"""Annotation files <-> tracks, and what of a recording they cover.

They are a part of ASAM OpenLABEL 1.0. Objects carry their class in `type`. Each frame has its time, in nanoseconds, in
`frame_properties.timestamp`, and per object one shape and what is known of the motion, all in the vehicle frame at that
time:

- `cuboid` "shape": x, y, z, qx, qy, qz, qw, sx, sy, sz (centre, quaternion x, y, z, w, full sizes), or
- `poly2d` "ground_outline": x and y in turn, closed, with the `num`s "bottom_m" and "top_m", or
- `vec` "point_indices" with the `num` "sweep_timestamp_ns" that they count in;
- `vec` "velocity_mps" over the ground, `num` "yaw_rate_radps", `text` "category", `boolean` "unclear".
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from os.path import lexists
from pathlib import Path
from typing import Annotated as Of
from typing import Any, Generic, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, Field, field_validator, model_validator

from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.validation import FileModel, Measured, TimeNs, in_order, read_json
from bench.records.recording import (
    ALWAYS_NS,
    COMPLETELY,
    NOT_ANNOTATED,
    Annotated,
    Cuboid,
    GroundPolygon,
    MotionKind,
    ObjectShape,
    ObjectState,
    PointIndices,
    Track,
)
from bench.records.reference import ObjectClass
from bench.times import unit_hint

REVIEW_SUFFIX = ".review.json"  # of files beside the annotations, from which they are made
NOT_REVIEWED = "annotations: proposed, not reviewed"  # comment of a file of unreviewed proposals
COORDINATE_SYSTEM: Literal["vehicle"] = "vehicle"

MOST_CORNERS = 1000  # of an outline; one that crosses itself has as many crossings as their square

Stretch = Of[tuple[TimeNs | None, TimeNs | None], AfterValidator(in_order)]
Outline = Of[tuple[tuple[float, float], ...], Field(min_length=3, max_length=1000)]


class PartlyAnnotated(FileModel):
    """`annotated` of `recording.json` and of cards, where that is neither "none" nor "complete".

    Attributes:
        timestamps_ns: first and last time of each annotated stretch, null for open; all times without it.
        left_out_m: outlines on the ground, x and y in the vehicle frame, in which nothing is annotated.
    """

    timestamps_ns: tuple[Stretch, ...] = Field(default=((None, None),), min_length=1)
    left_out_m: tuple[Outline, ...] = ()


Statement = Literal["none", "complete"] | PartlyAnnotated


def annotated_as(statement: Statement) -> Annotated:
    """The times and areas that a statement of a file names."""
    if isinstance(statement, PartlyAnnotated):
        earliest_ns, latest_ns = ALWAYS_NS
        spans_ns = [
            (earliest_ns if first is None else first, latest_ns if last is None else last)
            for first, last in statement.timestamps_ns
        ]
        return Annotated(spans_ns=tuple(spans_ns), left_out_m=statement.left_out_m)
    return COMPLETELY if statement == "complete" else NOT_ANNOTATED


def annotation_file_in(folder: Path | None, recording: str) -> Path | None:
    """The file of a folder of annotations that stands in for a recording's own; None where there is none."""
    file = None if folder is None else folder / f"{recording}.json"
    return file if file is not None and lexists(file) else None  # what is there but no file is an error when it is read


# The files, key by key


class CuboidData(FileModel):
    """Centre, quaternion (x, y, z, w) and full sizes."""

    name: Literal["shape"]
    val: tuple[Measured, Measured, Measured, Measured, Measured, Measured, Measured, Measured, Measured, Measured]
    coordinate_system: Literal["vehicle"] = COORDINATE_SYSTEM

    @field_validator("val")
    @classmethod
    def _is_box(cls, val: tuple[float, ...]) -> tuple[float, ...]:
        if abs(sum(part * part for part in val[3:7]) ** 0.5 - 1.0) > 1e-3:
            raise ValueError("numbers 4 to 7 to be a quaternion x, y, z, w of length 1")
        if min(val[7:]) <= 0:
            raise ValueError("numbers 8 to 10 to be sizes above 0")
        return val


class PolygonData(FileModel):
    """Outline on the ground: x and y in turn, the last point joined to the first."""

    name: Literal["ground_outline"]
    val: tuple[Measured, ...] = Field(min_length=6, max_length=2 * MOST_CORNERS)
    mode: Literal["MODE_POLY2D_ABSOLUTE"] = "MODE_POLY2D_ABSOLUTE"
    closed: Literal[True]
    coordinate_system: Literal["vehicle"] = COORDINATE_SYSTEM

    @field_validator("val")
    @classmethod
    def _has_pairs(cls, val: tuple[float, ...]) -> tuple[float, ...]:
        if len(val) % 2:
            raise ValueError("an even number of values, x and y in turn")
        return val


Name = TypeVar("Name", bound=str)
Value = TypeVar("Value")


class Named(FileModel, Generic[Name, Value]):
    """A value of an object."""

    name: Name
    val: Value


class LengthData(Named[Literal["bottom_m", "top_m"], Measured]):
    """Height span of an outline."""


class RateData(Named[Literal["yaw_rate_radps"], Measured]):
    """Turn of the object about its own centre, positive to the left."""


class SweepData(Named[Literal["sweep_timestamp_ns"], TimeNs]):
    """The sweep that point indices count in."""


class InstanceData(Named[Literal["instance_id"], Of[int, Field(ge=1, le=65535)]]):
    """The object's number in truth images."""


class VelocityData(Named[Literal["velocity_mps"], tuple[Measured, Measured, Measured]]):
    """Velocity over the ground along the vehicle's axes."""


class IndicesData(Named[Literal["point_indices"], tuple[Of[int, Field(ge=0, le=2**31 - 1)], ...]]):
    """Rows of the sweep's points."""


class CategoryData(Named[Literal["category"], MotionKind]):
    """Kind of motion."""


class UnclearData(Named[Literal["unclear"], bool]):
    """The annotator was not sure."""


FrameNumber = Of[LengthData | RateData | SweepData, Field(discriminator="name")]
FrameVector = Of[VelocityData | IndicesData, Field(discriminator="name")]


class FrameObjectData(FileModel):
    """State of one object in one frame."""

    cuboid: tuple[CuboidData, ...] = Field(default=(), max_length=1)
    poly2d: tuple[PolygonData, ...] = Field(default=(), max_length=1)
    num: tuple[FrameNumber, ...] = ()
    vec: tuple[FrameVector, ...] = ()
    text: tuple[CategoryData, ...] = Field(default=(), max_length=1)
    boolean: tuple[UnclearData, ...] = Field(default=(), max_length=1)

    @field_validator("num", "vec")
    @classmethod
    def _named_once(cls, entries: tuple[FrameNumber | FrameVector, ...]) -> tuple[FrameNumber | FrameVector, ...]:
        if len({entry.name for entry in entries}) < len(entries):
            raise ValueError("each name once")
        return entries

    @property
    def numbers(self) -> dict[str, float]:
        """Values of `num` by name."""
        return {entry.name: entry.val for entry in self.num}

    @property
    def vectors(self) -> dict[str, Any]:
        """Values of `vec` by name."""
        return {entry.name: entry.val for entry in self.vec}

    @model_validator(mode="after")
    def _is_one_shape(self) -> FrameObjectData:
        numbers = self.numbers
        if bool(self.cuboid) + bool(self.poly2d) + ("point_indices" in self.vectors) != 1:
            raise ValueError("one of cuboid, poly2d and vec point_indices")
        if self.poly2d and not numbers.get("bottom_m", math.inf) < numbers.get("top_m", -math.inf):
            raise ValueError("with a poly2d the numbers bottom_m and top_m, which is above it")
        if "point_indices" in self.vectors and "sweep_timestamp_ns" not in numbers:
            raise ValueError("with point_indices a number named sweep_timestamp_ns")
        return self


class FrameObject(FileModel):
    """One object in one frame."""

    object_data: FrameObjectData


class FrameProperties(FileModel):
    """Time of a frame, ns."""

    timestamp: TimeNs


class OpenLabelFrame(FileModel):
    """The objects at one time."""

    frame_properties: FrameProperties
    objects: dict[str, FrameObject] = Field(default_factory=dict)


class ObjectData(FileModel):
    """Properties of an object in every frame."""

    num: tuple[InstanceData, ...] = Field(default=(), max_length=1)


class AnnotatedObject(FileModel):
    """One object."""

    name: str
    type: ObjectClass
    object_data: ObjectData = ObjectData()


class Metadata(FileModel):
    """About the file."""

    schema_version: Literal["1.0.0"]
    annotator: str = ""
    comment: str = ""
    name: str = ""


class CoordinateSystem(FileModel):
    """The vehicle frame; named so that other OpenLABEL tools find it."""

    type: Literal["local_cs"] = "local_cs"
    parent: Literal[""] = ""
    children: tuple[str, ...] = ()


class OpenLabel(FileModel):
    """The content of the file."""

    metadata: Metadata
    coordinate_systems: dict[Literal["vehicle"], CoordinateSystem] = Field(default_factory=dict)
    objects: dict[str, AnnotatedObject] = Field(default_factory=dict)
    frames: dict[Of[str, Field(pattern=r"^[0-9]+$")], OpenLabelFrame] = Field(default_factory=dict)


class AnnotationFile(FileModel):
    """Annotations of a recording, a subset of ASAM OpenLABEL 1.0."""

    openlabel: OpenLabel


# From and to tracks


def box_state(
    timestamp_ns: int,
    vehicle_from_box: RigidTransform,
    size_m: ArrayLike,
    velocity_mps: ArrayLike = (np.nan,) * 3,
    yaw_rate_radps: float = 0.0,
    *,
    unclear: bool = False,
) -> ObjectState:
    """A box in the vehicle frame: its full size (3,), m, its velocity over the ground (3,), m/s, and its turn."""
    return ObjectState(
        timestamp_ns=int(timestamp_ns),
        shape=Cuboid(vehicle_from_object=vehicle_from_box, size_m=np.asarray(size_m, dtype=np.float64)),
        velocity_mps=np.asarray(velocity_mps, dtype=np.float64),
        yaw_rate_radps=float(yaw_rate_radps),
        unclear=unclear,
    )


def read_annotations(file: Path) -> tuple[Track, ...]:
    """Read an annotation file.

    Returns:
        Tracks in the order of the file; objects that no frame mentions have no states.

    Raises:
        DataError: missing, not of the OpenLABEL subset, or objects and frames that do not fit together.
    """
    content = read_json(AnnotationFile, file).openlabel
    states = _states(content, file)
    return tuple(
        Track(
            track_id=uid,
            object_class=item.type,
            states=tuple(states[uid]),
            instance_id=item.object_data.num[0].val if item.object_data.num else None,
            reviewed=content.metadata.comment != NOT_REVIEWED,
        )
        for uid, item in content.objects.items()
    )


def _states(content: OpenLabel, file: Path) -> dict[str, list[ObjectState]]:
    """The states of each object, by time."""
    states: dict[str, list[ObjectState]] = {uid: [] for uid in content.objects}
    times_ns = [frame.frame_properties.timestamp for frame in content.frames.values()]
    if len(set(times_ns)) < len(times_ns) and (hint := unit_hint(times_ns)):
        expected, got = "nanoseconds, each time once", f"{len(times_ns)} frames at {len(set(times_ns))} times"
        raise DataError(file, field="openlabel.frames: timestamp", expected=expected, got=got, hint=hint)
    last_ns: dict[str, int] = {}
    for number, frame in sorted(content.frames.items(), key=lambda item: item[1].frame_properties.timestamp):
        timestamp_ns = frame.frame_properties.timestamp
        for uid, entry in frame.objects.items():
            field = f"openlabel.frames.{number}.objects.{uid}"
            if uid not in content.objects:
                expected = "an object listed under openlabel.objects"
                raise DataError(file, field=field, expected=expected, got=repr(uid))
            if last_ns.get(uid) == timestamp_ns:
                got = f"{timestamp_ns} twice"
                raise DataError(file, field=field, expected="one frame for each time", got=got)
            last_ns[uid] = timestamp_ns
            states[uid].append(_state(entry.object_data, timestamp_ns))
    return states


def annotation_document(tracks: Sequence[Track], timestamps_ns: Iterable[int] = ()) -> dict[str, Any]:
    """The content of an annotation file, as JSON values.

    Args:
        tracks: objects with their states.
        timestamps_ns: further times at which the scene was annotated, also where it held nothing.
    """
    times_ns = sorted({state.timestamp_ns for track in tracks for state in track.states} | set(timestamps_ns))
    frames: dict[int, dict[str, Any]] = {
        time_ns: {"frame_properties": {"timestamp": int(time_ns)}, "objects": {}} for time_ns in times_ns
    }
    for track in tracks:
        for state in track.states:
            frames[state.timestamp_ns]["objects"][track.track_id] = {"object_data": _state_data(state)}
    comment = {} if all(track.reviewed for track in tracks) else {"comment": NOT_REVIEWED}
    return {
        "openlabel": {
            "metadata": {"schema_version": "1.0.0", **comment},
            "coordinate_systems": {COORDINATE_SYSTEM: {"type": "local_cs", "parent": "", "children": []}},
            "objects": {track.track_id: _object(track) for track in tracks},
            "frames": {str(i): frames[time_ns] for i, time_ns in enumerate(times_ns)},
        }
    }


def _state(data: FrameObjectData, timestamp_ns: int) -> ObjectState:
    numbers, vectors = data.numbers, data.vectors
    return ObjectState(
        timestamp_ns=timestamp_ns,
        shape=_shape(data, numbers, vectors),
        velocity_mps=np.array(vectors.get("velocity_mps", (np.nan,) * 3), dtype=np.float64),
        yaw_rate_radps=float(numbers.get("yaw_rate_radps", 0.0)),
        category=data.text[0].val if data.text else None,
        unclear=data.boolean[0].val if data.boolean else False,
    )


def _shape(data: FrameObjectData, numbers: dict[str, Any], vectors: dict[str, Any]) -> ObjectShape:
    if data.cuboid:
        x, y, z, qx, qy, qz, qw, *size_m = data.cuboid[0].val
        pose = RigidTransform.from_quaternion((qw, qx, qy, qz), (x, y, z))
        return Cuboid(vehicle_from_object=pose, size_m=np.array(size_m))
    if data.poly2d:
        outline_m = np.array(data.poly2d[0].val, dtype=np.float64).reshape(-1, 2)
        return GroundPolygon(outline_m=outline_m, bottom_m=float(numbers["bottom_m"]), top_m=float(numbers["top_m"]))
    return PointIndices(
        indices=np.array(vectors["point_indices"], dtype=np.int64), sweep_timestamp_ns=numbers["sweep_timestamp_ns"]
    )


def _object(track: Track) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": track.track_id, "type": track.object_class}
    if track.instance_id is not None:
        entry["object_data"] = {"num": [{"name": "instance_id", "val": int(track.instance_id)}]}
    return entry


def _state_data(state: ObjectState) -> dict[str, Any]:
    data: dict[str, Any] = {}
    numbers: dict[str, float] = {}
    vectors: dict[str, list[Any]] = {}
    match state.shape:
        case Cuboid(vehicle_from_object=pose, size_m=size_m):
            w, *xyz = pose.quaternion_wxyz.tolist()
            val = [*pose.translation_m.tolist(), *xyz, w, *np.asarray(size_m, dtype=np.float64).tolist()]
            data["cuboid"] = [{"name": "shape", "coordinate_system": COORDINATE_SYSTEM, "val": val}]
        case GroundPolygon(outline_m=outline_m, bottom_m=bottom_m, top_m=top_m):
            data["poly2d"] = [
                {
                    "name": "ground_outline",
                    "coordinate_system": COORDINATE_SYSTEM,
                    "mode": "MODE_POLY2D_ABSOLUTE",
                    "closed": True,
                    "val": np.asarray(outline_m, dtype=np.float64).ravel().tolist(),
                }
            ]
            numbers |= {"bottom_m": float(bottom_m), "top_m": float(top_m)}
        case PointIndices(indices=indices, sweep_timestamp_ns=sweep_ns):
            vectors["point_indices"] = indices.tolist()
            numbers["sweep_timestamp_ns"] = int(sweep_ns)
    if np.isfinite(state.velocity_mps).all():
        vectors["velocity_mps"] = np.asarray(state.velocity_mps, dtype=np.float64).tolist()
    if state.yaw_rate_radps:
        numbers["yaw_rate_radps"] = float(state.yaw_rate_radps)
    for kind, entries in (("num", numbers), ("vec", vectors)):
        if entries:
            data[kind] = [{"name": name, "val": val} for name, val in entries.items()]
    if state.category is not None:
        data["text"] = [{"name": "category", "val": str(state.category)}]
    if state.unclear:
        data["boolean"] = [{"name": "unclear", "val": True}]
    return data
