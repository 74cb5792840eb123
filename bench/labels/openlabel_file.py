"""The full ASAM OpenLABEL 1.0 as other tools write it: what of it can become annotations, everything else passed over.

Names of objects and of data are free in the standard; only what this file lists is looked at. Two spellings of the
fisheye lens are in use: the schema's, and that of the library that most files come from.

Source:
    ASAM OpenLABEL 1.0.0 and its JSON Schema.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, field_validator

from bench.errors import DataError
from bench.labels.formats import ToolModel
from bench.recordings.validation import read_json

LARGEST_BYTES = 500_000_000
IMAGE_KINDS = ("bbox", "rbbox", "image", "binary", "point2d", "line_reference", "area_reference")
OTHER_KINDS = ("poly3d", "point3d", "mat", "mesh")
ELEMENTS = ("actions", "events", "relations", "contexts", "tags")

Stamp = int | float | str  # whole numbers stay whole: nanoseconds have more digits than float
Numbers = list[float]  # a tuple would refuse the list that a validator hands on


class TransformData(ToolModel):
    """A pose: a matrix, a quaternion (x, y, z, w) or three angles, each but the matrix with a translation."""

    matrix4x4: Numbers | None = None
    quaternion: Numbers | None = None
    translation: Numbers | None = None
    euler_angles: Numbers | None = None
    sequence: str = "ZYX"


class System(ToolModel):
    """A coordinate system; its pose maps its points into its parent."""

    type: str = ""
    parent: str = ""
    pose_wrt_parent: TransformData | None = None

    @field_validator("pose_wrt_parent", mode="before")
    @classmethod
    def _from_list(cls, value: object) -> object:
        """Files of the draft have the matrix alone."""
        return {"matrix4x4": value} if isinstance(value, list) else value


class Transform(ToolModel):
    """A pose that holds in one frame: maps points of `src` into `dst`."""

    src: str
    dst: str
    transform_src_to_dst: TransformData


class Entry(ToolModel):
    """A piece of data of an object; what `val` must be depends on its kind and name."""

    name: str = ""
    val: Any = None
    coordinate_system: str | None = None
    mode: str = ""
    closed: bool = False
    attributes: dict[str, Any] = Field(default_factory=dict)

    def stated(self, name: str) -> Any:
        """The value of an attribute of any kind; None where there is none of the name."""
        listed = (entry for kind in self.attributes.values() if isinstance(kind, list) for entry in kind)
        return next((e.get("val") for e in listed if isinstance(e, dict) and e.get("name") == name), None)


class ObjectData(ToolModel):
    """All data of an object, by kind."""

    cuboid: tuple[Entry, ...] = ()
    poly2d: tuple[Entry, ...] = ()
    num: tuple[Entry, ...] = ()
    vec: tuple[Entry, ...] = ()
    text: tuple[Entry, ...] = ()
    boolean: tuple[Entry, ...] = ()
    bbox: tuple[Any, ...] = ()
    rbbox: tuple[Any, ...] = ()
    image: tuple[Any, ...] = ()
    binary: tuple[Any, ...] = ()
    point2d: tuple[Any, ...] = ()
    line_reference: tuple[Any, ...] = ()
    area_reference: tuple[Any, ...] = ()
    poly3d: tuple[Any, ...] = ()
    point3d: tuple[Any, ...] = ()
    mat: tuple[Any, ...] = ()
    mesh: tuple[Any, ...] = ()


class Interval(ToolModel):
    """Frames from one to another, both included."""

    frame_start: int
    frame_end: int


class LabelledObject(ToolModel):
    """An object, with the data that holds in all of its frames."""

    name: str = ""
    type: str
    coordinate_system: str | None = None
    frame_intervals: tuple[Interval, ...] | None = None
    object_data: ObjectData = ObjectData()


class FrameObject(ToolModel):
    """An object in one frame."""

    object_data: ObjectData = ObjectData()


class Sync(ToolModel):
    """Time and frame number by a stream."""

    timestamp: Stamp | None = None
    frame_stream: int | None = None


class StreamProperties(ToolModel):
    """A sensor's calibration, or its part of a frame."""

    sync: Sync = Sync()
    intrinsics_pinhole: dict[str, Any] | None = None
    intrinsics_fisheye: dict[str, Any] | None = None
    intrinsics_custom: dict[str, Any] | None = None


class Stream(ToolModel):
    """A sensor, in the head or in a frame."""

    type: str = ""
    uri: str | None = None
    stream_properties: StreamProperties = StreamProperties()


class FrameProperties(ToolModel):
    """Time, streams and poses of a frame."""

    timestamp: Stamp | None = None
    streams: dict[str, Stream] = Field(default_factory=dict)
    transforms: dict[str, Transform] = Field(default_factory=dict)


class LabelledFrame(ToolModel):
    """A frame."""

    frame_properties: FrameProperties = FrameProperties()
    objects: dict[str, FrameObject] = Field(default_factory=dict)


class Root(ToolModel):
    """The content of the file."""

    metadata: dict[str, Any]
    coordinate_systems: dict[str, System] = Field(default_factory=dict)
    streams: dict[str, Stream] = Field(default_factory=dict)
    objects: dict[str, LabelledObject] = Field(default_factory=dict)
    frames: dict[Annotated[str, Field(pattern=r"^[0-9]{1,18}$")], LabelledFrame] = Field(default_factory=dict)
    actions: dict[str, Any] = Field(default_factory=dict)
    events: dict[str, Any] = Field(default_factory=dict)
    relations: dict[str, Any] = Field(default_factory=dict)
    contexts: dict[str, Any] = Field(default_factory=dict)
    tags: dict[str, Any] = Field(default_factory=dict)


class LabelFile(ToolModel):
    """The file."""

    openlabel: Root


def read_label_file(file: Path) -> Root:
    """Read a file.

    Raises:
        DataError: missing, too large, not JSON, not OpenLABEL, or an object in a frame that the file does not list.
    """
    if file.is_file() and file.stat().st_size > LARGEST_BYTES:
        raise DataError(file, expected=f"at most {LARGEST_BYTES} bytes", got=str(file.stat().st_size))
    content = read_json(LabelFile, file).openlabel
    version = content.metadata.get("schema_version")
    if not isinstance(version, str) or not version.startswith("1."):
        field = "openlabel.metadata.schema_version"
        raise DataError(
            file, field=field, expected="1.0.0", got=repr(version)[:80], hint="convert the file to OpenLABEL 1.0.0"
        )
    for number, frame in content.frames.items():
        for uid in frame.objects:
            if uid not in content.objects:
                field = f"openlabel.frames.{number}.objects.{uid}"
                raise DataError(file, field=field, expected="an object listed under openlabel.objects", got=repr(uid))
    return content
