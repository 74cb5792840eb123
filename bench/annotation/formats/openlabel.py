"""Cuboids of ASAM OpenLABEL 1.0 as other tools write it, and annotations as files of the standard.

Frames of coordinates: a system called "vehicle", "lidar" or "world" is ours of that name; the user says by `--frame`
which others are. Boxes in any other system follow the poses of the file to the nearest of these. Times are nanoseconds,
or in the unit that the user gives; frames without times pair by number.

Source:
    ASAM OpenLABEL 1.0.0 and its JSON Schema.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field
from scipy.spatial.transform import Rotation

from bench.annotation.formats.contract import (
    OWN_FRAMES,
    Files,
    LabelFormat,
    LabelOptions,
    Observation,
    ToolLabels,
    box_state,
    pair_with_sweeps,
    recording_times,
    tool_class,
    vehicle_from_own,
)
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings import ObjectState, Recording, openlabel
from bench.recordings.annotations import annotation_document
from bench.recordings.validation import LATEST_NS, FileModel, Measured, located, read_json

FILE = "openlabel.json"
UPRIGHT = 0.5  # cosine to the vertical of a box's z, from which on the box is upright
UNIT_ERROR = 1e-3  # of the length of a quaternion
EULER_VALUES, QUATERNION_VALUES = 9, 10
Time = Annotated[Decimal, Field(ge=-LATEST_NS, le=LATEST_NS)]  # nanoseconds have more digits than float


class _Lenient(FileModel):
    """Keys that are not read may be there."""

    model_config = ConfigDict(extra="allow")


class _Pose(_Lenient):
    matrix4x4: list[float] | None = None
    quaternion: tuple[float, float, float, float] | None = None
    translation: tuple[float, float, float] | None = None


class _System(_Lenient):
    parent: str = ""
    pose_wrt_parent: _Pose | None = None


class _Transform(_Lenient):
    src: str
    dst: str
    transform_src_to_dst: _Pose


class _Cuboid(_Lenient):
    val: tuple[Measured, ...] = Field(min_length=EULER_VALUES, max_length=QUATERNION_VALUES)
    coordinate_system: str | None = None


class _ObjectData(_Lenient):
    cuboid: tuple[_Cuboid, ...] = ()


class _Object(_Lenient):
    name: str = ""
    type: str = ""
    coordinate_system: str | None = None
    object_data: _ObjectData = _ObjectData()


class _Properties(_Lenient):
    timestamp: Time | None = None
    transforms: dict[str, _Transform] = Field(default_factory=dict)


class _Frame(_Lenient):
    frame_properties: _Properties = _Properties()
    objects: dict[str, _Object] = Field(default_factory=dict)


class _Metadata(_Lenient):
    schema_version: Annotated[str, Field(pattern=r"^1\.")]


class _Root(_Lenient):
    metadata: _Metadata
    coordinate_systems: dict[str, _System] = Field(default_factory=dict)
    objects: dict[str, _Object] = Field(default_factory=dict)
    frames: dict[Annotated[str, Field(pattern=r"^[0-9]{1,18}$")], _Frame] = Field(default_factory=dict, min_length=1)
    frame_intervals: Any = None


class _File(_Lenient):
    openlabel: _Root


class OpenLabelFormat(LabelFormat):
    """The standard's files."""

    name = "openlabel"
    description = "ASAM OpenLABEL 1.0 of any tool: cuboids in any coordinate system that the file places"

    def read(self, source: Path, recording: Recording, options: LabelOptions) -> ToolLabels:
        """Read the cuboids of a file; arguments and errors as in `LabelFormat`."""
        file = source / FILE if source.is_dir() else source
        reader = _Reader(read_json(_File, file).openlabel, recording, options, file)
        observations = list(reader.observations())
        lost = [f"{count} {what}" for what, count in reader.lost.items()]
        return ToolLabels(observations=observations, timestamps_ns=list(reader.times_ns.values()), lost=lost)

    def write(self, recording: Recording, options: LabelOptions) -> tuple[Files, list[str]]:
        """Write an annotation file whose objects have numbers, as the standard wants; arguments as in `LabelFormat`."""
        document = annotation_document(recording.tracks, [sweep.timestamp_ns for sweep in recording.sweeps])
        root = document["openlabel"]
        for track in recording.tracks:
            root["objects"][track.track_id]["type"] = tool_class(track.object_class, options)
        uids = {track.track_id: str(i) for i, track in enumerate(recording.tracks)}
        for part in (root, *root["frames"].values()):
            part["objects"] = {uids[name]: item for name, item in part["objects"].items()}
        w, *xyz = recording.vehicle_from_lidar.quaternion_wxyz.tolist()
        pose = {"quaternion": [*xyz, w], "translation": recording.vehicle_from_lidar.translation_m.tolist()}
        vehicle, systems = openlabel.COORDINATE_SYSTEM, root["coordinate_systems"]
        systems[vehicle]["children"] = ["lidar"]
        systems["lidar"] = {"type": "sensor_cs", "parent": vehicle, "children": [], "pose_wrt_parent": pose}
        if root["frames"]:
            root["frame_intervals"] = [{"frame_start": 0, "frame_end": len(root["frames"]) - 1}]
        return {FILE: (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()}, []


class _Reader:
    """Translates cuboids, and counts in `lost` what is not read."""

    def __init__(self, content: _Root, recording: Recording, options: LabelOptions, file: Path) -> None:
        self._content, self._recording, self._file = content, recording, file
        self.lost: Counter[str] = Counter({f"{key[:40]}: no field for them": 1 for key in content.model_extra or ()})
        self.times_ns = self._frame_times(options)
        self._own = {name: name for name in OWN_FRAMES} | dict(options.frames)
        self._edges = {
            (system.parent, name): self._pose(system.pose_wrt_parent, f"coordinate_systems.{name}.pose_wrt_parent")
            for name, system in content.coordinate_systems.items()
            if system.parent and system.pose_wrt_parent is not None
        }

    def _frame_times(self, options: LabelOptions) -> dict[str, int]:
        """The time of each frame: as it states, else of the sweep whose number it has."""
        frames = self._content.frames
        stamps = [frame.frame_properties.timestamp for frame in frames.values()]
        if options.first_frame is not None or all(stamp is None for stamp in stamps):
            sweeps = pair_with_sweeps(list(frames), self._recording, options, source=self._file)
            return {number: sweep.timestamp_ns for number, sweep in sweeps.items()}
        stated_ns = []
        for number, stamp in zip(frames, stamps, strict=True):
            if stamp is None:
                field = f"openlabel.frames.{number}.frame_properties.timestamp"
                raise self._fault(field, "a time in each frame", "none")
            stated_ns.append(round(stamp * options.unit_ns))
        times_ns = recording_times(stated_ns, self._recording, source=self._file, field="openlabel.frames: timestamp")
        return dict(zip(frames, times_ns, strict=True))

    def observations(self) -> Iterator[Observation]:
        """All objects at all times."""
        objects = self._content.objects
        names = [item.name for item in objects.values()]
        distinct = all(names) and len(set(names)) == len(names)
        seen = set()
        for item in objects.values():
            self._count_lost(item.object_data)
        for number, frame in self._content.frames.items():
            for uid, shown in frame.objects.items():
                field = f"openlabel.frames.{number}.objects.{uid}"
                if uid not in objects:
                    raise self._fault(field, "an object listed under openlabel.objects", repr(uid))
                self._count_lost(shown.object_data)
                for cuboid in shown.object_data.cuboid[:1]:
                    system = cuboid.coordinate_system or shown.coordinate_system or objects[uid].coordinate_system
                    seen.add(uid)
                    yield Observation(
                        track=objects[uid].name if distinct else uid,
                        label=objects[uid].type,
                        state=self._box(cuboid, system or "", number, f"{field}.object_data.cuboid"),
                    )
        if unseen := len(objects) - len(seen):
            self.lost["objects without any cuboid in a frame, left out"] += unseen

    def _count_lost(self, data: _ObjectData) -> None:
        for kind, entries in (data.model_extra or {}).items():
            self.lost[f"{kind[:40]}: no field for them"] += len(entries) if isinstance(entries, list) else 1
        if len(data.cuboid) > 1:
            self.lost["further cuboids of an object at one time"] += len(data.cuboid) - 1
        if any("attributes" in (cuboid.model_extra or {}) for cuboid in data.cuboid):
            self.lost["cuboids with attributes: no field for them"] += 1

    def _box(self, cuboid: _Cuboid, system: str, number: str, field: str) -> ObjectState:
        """A box in the vehicle frame: nine values turn about the fixed x, y and z in turn, ten have a quaternion."""
        numbers = np.array(cuboid.val)
        if len(numbers) == EULER_VALUES:
            rotation = Rotation.from_euler("xyz", numbers[3:6])
        else:
            rotation = self._rotation(cuboid.val[3:7], f"{field}.val")
        box = self._vehicle_from(system, number, field) @ RigidTransform(rotation.as_matrix(), numbers[:3])
        if box.rotation[2, 2] < UPRIGHT:
            got = f"one at {np.degrees(np.arccos(box.rotation[2, 2])):.0f} degrees"
            raise self._fault(f"{field}.val", "a box whose z points up", got)
        if min(size_m := cuboid.val[-3:]) <= 0:
            raise self._fault(f"{field}.val", "sizes above 0", str(size_m))
        return box_state(self.times_ns[number], box, size_m)

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
