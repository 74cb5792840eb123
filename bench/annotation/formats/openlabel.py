"""ASAM OpenLABEL 1.0 as other tools write it, translated into the part of it that annotation files use.

Frames of coordinates: a system called "vehicle", "lidar" or "world" is ours of that name, and one with a stream of type
lidar is the lidar; the user says by `--frame` which others are. Boxes in any other system follow the poses of the file
to the nearest of these. Times are nanoseconds, or in the unit that the user gives; frames without times pair by number.

Source:
    ASAM OpenLABEL 1.0.0 and its JSON Schema.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field
from scipy.spatial.transform import Rotation

from bench.annotation.formats.contract import (
    OWN_FRAMES,
    Files,
    LabelOptions,
    LabelSet,
    Observation,
    ToolLabels,
    tool_class,
)
from bench.annotation.formats.sweeps import LARGEST, pair_with_sweeps, recording_times, refuse_large, vehicle_from_own
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings import MOTION_KINDS, Recording, openlabel
from bench.recordings.annotations import annotation_document, read_state
from bench.recordings.validation import LATEST_NS, FileModel, located, read_json, validated

FILE = "openlabel.json"
OWN_NAMES = {  # of data that annotation files have, too
    "num": ("bottom_m", "top_m", "yaw_rate_radps", "sweep_timestamp_ns"),
    "vec": ("velocity_mps", "point_indices"),
    "text": ("category",),
    "boolean": ("unclear",),
    "poly2d": ("ground_outline",),
}
MOTION_DATA = ("yaw_rate_radps", "velocity_mps", "category", "unclear")  # what belongs to a box as well
UPRIGHT = 0.5  # cosine to the vertical of a box's z, from which on the box is upright
UNIT_ERROR = 1e-3  # of the length of a quaternion
EULER_VALUES, QUATERNION_VALUES = 9, 10
LONGEST_TIME = 64  # characters


class _Part(FileModel):
    """Part of the file: keys that are not used are passed over."""

    model_config = ConfigDict(extra="ignore")


class _Pose(_Part):
    matrix4x4: list[float] | None = None
    quaternion: tuple[float, float, float, float] | None = None
    translation: tuple[float, float, float] | None = None


class _System(_Part):
    parent: str = ""
    pose_wrt_parent: _Pose | None = None


class _Transform(_Part):
    src: str
    dst: str
    transform_src_to_dst: _Pose


class _Entry(_Part):
    name: str = ""
    val: Any = None
    coordinate_system: str | None = None
    mode: str = ""
    closed: bool = False
    attributes: dict[str, Any] = Field(default_factory=dict)


class _Object(_Part):
    name: str = ""
    type: str = ""
    coordinate_system: str | None = None
    object_data: dict[str, tuple[_Entry, ...]] = Field(default_factory=dict)  # by kind


class _Stream(_Part):
    type: str = ""


class _Properties(_Part):
    timestamp: int | float | str | None = None  # whole numbers stay whole: nanoseconds have more digits than float
    transforms: dict[str, _Transform] = Field(default_factory=dict)


class _Frame(_Part):
    frame_properties: _Properties = _Properties()
    objects: dict[str, _Object] = Field(default_factory=dict)


class _Metadata(_Part):
    schema_version: Annotated[str, Field(pattern=r"^1\.")]


class _Root(_Part):
    model_config = ConfigDict(extra="allow")  # to say what was not read

    metadata: _Metadata
    coordinate_systems: dict[str, _System] = Field(default_factory=dict)
    streams: dict[str, _Stream] = Field(default_factory=dict)
    objects: dict[str, _Object] = Field(default_factory=dict)
    frames: dict[Annotated[str, Field(pattern=r"^[0-9]{1,18}$")], _Frame] = Field(default_factory=dict)
    frame_intervals: Any = None


class _File(_Part):
    openlabel: _Root


class OpenLabelFormat:
    """The standard's files."""

    name = "openlabel"
    description = "ASAM OpenLABEL 1.0 of any tool: cuboids in any coordinate system that the file places"

    def read(self, source: Path, recording: Recording, options: LabelOptions) -> ToolLabels:
        """Read a file; arguments and errors as in `LabelFormat`."""
        file = source / FILE if source.is_dir() else source
        refuse_large(file)
        content = read_json(_File, file).openlabel
        reader = _Reader(content, recording, options, file)
        observations = tuple(reader.observations())
        lost = [f"{count} {what}" for what, count in reader.lost.items()]
        lost += [f"{name[:40]}: no field for them" for name in content.model_extra or ()]
        return ToolLabels(observations=observations, timestamps_ns=tuple(reader.times_ns.values()), lost=tuple(lost))

    def write(self, label_set: LabelSet, recording: Recording, options: LabelOptions) -> tuple[Files, tuple[str, ...]]:
        """Write an annotation file whose objects have numbers, as the standard wants; arguments as in `LabelFormat`."""
        document = annotation_document(label_set.tracks, label_set.timestamps_ns)
        root = document["openlabel"]
        uids = {track.track_id: str(i) for i, track in enumerate(label_set.tracks)}
        for track in label_set.tracks:
            root["objects"][track.track_id]["type"] = tool_class(track.object_class, options)
        for part in (root, *root["frames"].values()):
            part["objects"] = {uids[name]: item for name, item in part["objects"].items()}
        w, *xyz = recording.vehicle_from_lidar.quaternion_wxyz.tolist()
        pose = {"quaternion": [*xyz, w], "translation": recording.vehicle_from_lidar.translation_m.tolist()}
        vehicle, systems = openlabel.COORDINATE_SYSTEM, root["coordinate_systems"]
        systems[vehicle]["children"] = ["lidar"]
        systems["lidar"] = {"type": "sensor_cs", "parent": vehicle, "children": [], "pose_wrt_parent": pose}
        if root["frames"]:
            root["frame_intervals"] = [{"frame_start": 0, "frame_end": len(root["frames"]) - 1}]
        return {FILE: (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()}, ()


class _Reader:
    """Translates objects, and counts in `lost` what has no field."""

    def __init__(self, content: _Root, recording: Recording, options: LabelOptions, file: Path) -> None:
        self._content, self._recording, self._file = content, recording, file
        self.lost: Counter[str] = Counter()
        self.times_ns = self._frame_times(options)
        lidars = {name: "lidar" for name, stream in content.streams.items() if stream.type == "lidar"}
        self._own = {**{name: name for name in OWN_FRAMES}, **lidars, **options.frames}
        self._edges = {
            (system.parent, name): self._pose(system.pose_wrt_parent, f"coordinate_systems.{name}.pose_wrt_parent")
            for name, system in content.coordinate_systems.items()
            if system.parent and system.pose_wrt_parent is not None
        }

    def _frame_times(self, options: LabelOptions) -> dict[str, int]:
        """The time of each frame: as it states, else of the sweep whose number it has."""
        frames = self._content.frames
        if not frames:
            hint = "an annotation needs times; export the labels with frames"
            raise self._fault("openlabel.frames", "frames, to pair with sweeps", "none", hint)
        stamps = [frame.frame_properties.timestamp for frame in frames.values()]
        if options.first_frame is not None or all(stamp is None for stamp in stamps):
            sweeps = pair_with_sweeps(list(frames), self._recording, options, source=self._file)
            return {number: sweep.timestamp_ns for number, sweep in sweeps.items()}
        stated_ns = []
        for number, stamp in zip(frames, stamps, strict=True):
            try:
                value = Decimal(str(stamp)[:LONGEST_TIME].strip())
            except InvalidOperation:
                value = Decimal("nan")
            if not value.is_finite() or value.copy_abs() > LATEST_NS:  # `abs` fails on exponents beyond its context
                field = f"openlabel.frames.{number}.frame_properties.timestamp"
                raise self._fault(field, "a number in each frame", repr(stamp)[:80])
            stated_ns.append(round(value * options.unit_ns))
        times_ns = recording_times(stated_ns, self._recording, source=self._file, field="openlabel.frames: timestamp")
        for time_ns, count in Counter(times_ns).items():
            if count > 1:
                hint = "--first-frame pairs frames by their numbers instead"
                got = f"{count} frames of {time_ns} ns"
                raise self._fault("openlabel.frames: timestamp", "one frame for each time", got, hint)
        return dict(zip(frames, times_ns, strict=True))

    def observations(self) -> Iterator[Observation]:
        """All objects at all times."""
        objects = self._content.objects
        names = [item.name for item in objects.values()]
        distinct = all(names) and len(set(names)) == len(names)
        instances: dict[str, int | None] = dict.fromkeys(objects)
        for uid, item in objects.items():
            for kind, entries in item.object_data.items():
                for entry in entries:
                    if (kind, entry.name) == ("num", "instance_id"):
                        values = {"name": entry.name, "val": entry.val}
                        instances[uid] = validated(openlabel.InstanceData, values, file=self._file).val
                    else:
                        self.lost[f"{kind[:40]} {entry.name[:40]!r} of objects that no frame has: not read"] += 1
        seen = set()
        for number, frame in self._content.frames.items():
            for uid, shown in frame.objects.items():
                field = f"openlabel.frames.{number}.objects.{uid}"
                if uid not in objects:
                    raise self._fault(field, "an object listed under openlabel.objects", repr(uid))
                data = self._data(shown, objects[uid], number, f"{field}.object_data")
                if not any(data[kind] for kind in ("cuboid", "poly2d", "vec")):
                    continue
                seen.add(uid)
                place = f"{field}.object_data"
                strict = validated(openlabel.FrameObjectData, _tupled(data), file=self._file, field=place)
                yield Observation(
                    track=objects[uid].name if distinct else uid,
                    label=objects[uid].type,
                    state=read_state(strict, self.times_ns[number], file=self._file, field=field),
                    instance_id=instances[uid],
                )
        if unseen := len(objects) - len(seen):
            self.lost["objects without any cuboid or outline in a frame, left out"] += unseen

    def _data(self, shown: _Object, item: _Object, number: str, field: str) -> dict[str, list[dict[str, Any]]]:
        """Data of an object in a frame as annotation files have it; everything else is counted."""
        data: dict[str, list[dict[str, Any]]] = {kind: [] for kind in ("cuboid", *OWN_NAMES)}
        for kind, entries in shown.object_data.items():
            for entry in entries:
                for attribute in entry.attributes:
                    self.lost[f"{attribute[:40]} attributes of {kind[:40]}: no field for them"] += 1
                value = {"name": entry.name, "val": entry.val}
                system = entry.coordinate_system or item.coordinate_system
                if kind == "cuboid" and not data["cuboid"] and entry.val is not None:
                    data["cuboid"].append(self._cuboid(entry.val, system or "", number, f"{field}.cuboid"))
                elif entry.name not in OWN_NAMES.get(kind, ()):
                    self.lost[f"{kind[:40]} {entry.name[:40]!r}: no field for it"] += 1
                elif entry.name == "category" and entry.val not in MOTION_KINDS:
                    self.lost["text 'category' that is no kind of motion: no field for it"] += 1
                elif kind == "poly2d":
                    more = {"mode": entry.mode, "closed": entry.closed}
                    data[kind].append(value | more | {"coordinate_system": system or openlabel.COORDINATE_SYSTEM})
                else:
                    data[kind].append(value)
        if data["cuboid"]:
            for kind in OWN_NAMES:
                data[kind] = [value for value in data[kind] if value["name"] in MOTION_DATA]
        return data

    def _cuboid(self, val: Any, system: str, number: str, field: str) -> dict[str, Any]:
        """A box in the vehicle frame: nine values turn about the fixed x, y and z in turn, ten have a quaternion."""
        listed = val if isinstance(val, list) and all(type(v) in {int, float} and abs(v) < LARGEST for v in val) else []
        numbers = np.array(listed, dtype=np.float64)
        if len(numbers) not in {EULER_VALUES, QUATERNION_VALUES}:
            raise self._fault(f"{field}.val", "9 or 10 finite numbers", repr(val)[:80])
        if len(numbers) == EULER_VALUES:
            rotation = Rotation.from_euler("xyz", numbers[3:6])
        else:
            rotation = self._rotation(numbers[3:7].tolist(), f"{field}.val")
        box = self._vehicle_from(system, number, field) @ RigidTransform(rotation.as_matrix(), numbers[:3])
        if box.rotation[2, 2] < UPRIGHT:
            got = f"one at {np.degrees(np.arccos(box.rotation[2, 2])):.0f} degrees"
            raise self._fault(f"{field}.val", "a box whose z points up", got)
        w, *xyz = box.quaternion_wxyz.tolist()
        return {"name": "shape", "val": [*box.translation_m.tolist(), *xyz, w, *numbers[-3:].tolist()]}

    def _vehicle_from(self, system: str, number: str, field: str) -> RigidTransform:
        """The vehicle frame from a system of the file, along the fewest poses to one that is ours."""
        edges = dict(self._edges)
        for key, moved in self._content.frames[number].frame_properties.transforms.items():
            edges.pop((moved.src, moved.dst), None)
            place = f"frames.{number}.frame_properties.transforms.{key}"
            edges[(moved.dst, moved.src)] = self._pose(moved.transform_src_to_dst, place)
        edges |= {(b, a): pose.inverse() for (a, b), pose in edges.items()}
        reached = {system: RigidTransform.identity()}
        for here in (queue := [system]):
            if here in self._own:
                own = vehicle_from_own(self._own[here], self.times_ns[number], self._recording)
                return own @ reached[here]
            for (parent, child), parent_from_child in edges.items():
                if child == here and parent not in reached:
                    reached[parent] = parent_from_child @ reached[here]
                    queue.append(parent)
        expected = f"a system that is, or has poses to, one of {', '.join(filter(None, self._own))}"
        hint = f"say what it is with --frame {system}=vehicle (or lidar, world)"
        raise self._fault(f"{field}.coordinate_system", expected, repr(system) if system else "none", hint)

    def _pose(self, pose: _Pose, place: str) -> RigidTransform:
        """A pose of the file: maps points of the source (the child) into the destination (the parent)."""
        field = f"openlabel.{place}"
        if pose.matrix4x4 is not None:
            matrix = np.array(pose.matrix4x4)
            if matrix.size != 16 or not np.allclose(matrix[12:], [0.0, 0.0, 0.0, 1.0]):
                expected = "16 numbers, the last of them 0, 0, 0, 1"
                raise self._fault(f"{field}.matrix4x4", expected, str(pose.matrix4x4))
            with located(self._file, f"{field}.matrix4x4"):
                return RigidTransform.from_matrix(matrix.reshape(4, 4))
        if pose.quaternion is None or pose.translation is None:
            raise self._fault(field, "a matrix4x4, or a quaternion with a translation", "neither")
        rotation = self._rotation(pose.quaternion, f"{field}.quaternion")
        return RigidTransform(rotation.as_matrix(), np.array(pose.translation))

    def _rotation(self, xyzw: Sequence[float], field: str) -> Rotation:
        if abs(np.linalg.norm(xyzw) - 1.0) > UNIT_ERROR:
            raise self._fault(field, "a quaternion x, y, z, w of length 1", str(list(xyzw)))
        return Rotation.from_quat(xyzw)

    def _fault(self, field: str, expected: str, got: str, hint: str = "") -> DataError:
        return DataError(self._file, field=field, expected=expected, got=got, hint=hint)


def _tupled(value: Any) -> Any:
    """Lists as tuples, which is what models of values take."""
    if isinstance(value, Mapping):
        return {key: _tupled(part) for key, part in value.items()}
    return tuple(_tupled(part) for part in value) if isinstance(value, list | tuple) else value
