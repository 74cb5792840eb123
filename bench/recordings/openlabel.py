"""The part of ASAM OpenLABEL 1.0 that annotations use, key by key.

Objects carry their class in `type`. Each frame has its time, in nanoseconds, in `frame_properties.timestamp`, and per
object one shape and what is known of the motion, all in the vehicle frame at that time:

- `cuboid` "shape": x, y, z, qx, qy, qz, qw, sx, sy, sz (centre, quaternion x, y, z, w, full sizes), or
- `poly2d` "ground_outline": x and y in turn, closed, with the `num`s "bottom_m" and "top_m", or
- `vec` "point_indices" with the `num` "sweep_timestamp_ns" that they count in;
- `vec` "velocity_mps" over the ground, `num` "yaw_rate_radps", `text` "category", `boolean` "unclear".
"""

from __future__ import annotations

import json
import math
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from bench.recordings.validation import FileModel, Measured, TimeNs
from bench.records.recording import MotionKind
from bench.records.reference import ObjectClass

VERSION = "1.0.0"
NOT_REVIEWED = "annotations: proposed, not reviewed"  # the comment of a file whose objects nobody has looked at
COORDINATE_SYSTEM: Literal["vehicle"] = "vehicle"

MOST_CORNERS = 1000  # of an outline; one that crosses itself has as many crossings as their square


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


class LengthData(FileModel):
    """Height span of an outline."""

    name: Literal["bottom_m", "top_m"]
    val: Measured


class RateData(FileModel):
    """Turn of the object about its own centre, positive to the left."""

    name: Literal["yaw_rate_radps"]
    val: Measured


class SweepData(FileModel):
    """The sweep that point indices count in."""

    name: Literal["sweep_timestamp_ns"]
    val: TimeNs


class InstanceData(FileModel):
    """The object's number in truth images."""

    name: Literal["instance_id"]
    val: int = Field(ge=1, le=65535)


class VelocityData(FileModel):
    """Velocity over the ground along the vehicle's axes."""

    name: Literal["velocity_mps"]
    val: tuple[Measured, Measured, Measured]


class IndicesData(FileModel):
    """Rows of the sweep's points."""

    name: Literal["point_indices"]
    val: tuple[Annotated[int, Field(ge=0, le=2**31 - 1)], ...]


class CategoryData(FileModel):
    """Kind of motion."""

    name: Literal["category"]
    val: MotionKind


class UnclearData(FileModel):
    """The annotator was not sure."""

    name: Literal["unclear"]
    val: bool


FrameNumber = Annotated[LengthData | RateData | SweepData, Field(discriminator="name")]
FrameVector = Annotated[VelocityData | IndicesData, Field(discriminator="name")]


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
    frames: dict[Annotated[str, Field(pattern=r"^[0-9]+$")], OpenLabelFrame] = Field(default_factory=dict)


class AnnotationFile(FileModel):
    """`annotations.json`."""

    openlabel: OpenLabel


def schema_text() -> str:
    """The JSON Schema of annotation files, as it stands in `annotations/openlabel-subset.schema.json`."""
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Annotations of fisheye-bench: a subset of ASAM OpenLABEL 1.0",
        **{key: value for key, value in AnnotationFile.model_json_schema().items() if key != "title"},
    }
    return json.dumps(schema, indent=1) + "\n"
