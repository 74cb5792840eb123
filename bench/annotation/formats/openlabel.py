"""Cuboids of ASAM OpenLABEL 1.0 as other tools write it, and annotations as files of the standard.

A system of coordinates called "vehicle", "lidar" or "world" is ours of that name; the user says by `--frame` which
others are. Times are nanoseconds, or in the unit that the user gives; frames without times pair by number.

Source:
    ASAM OpenLABEL 1.0.0 and its JSON Schema.
"""

from __future__ import annotations

import json
from collections import Counter
from decimal import Decimal
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field
from scipy.spatial.transform import Rotation

from bench.annotation.formats.conversion import (
    Files,
    LabelFormat,
    LabelOptions,
    Observation,
    ToolLabels,
    lost_lines,
    pair_with_sweeps,
    recording_times,
    vehicle_from_tool,
)
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings import Recording
from bench.recordings.annotations import COORDINATE_SYSTEM, annotation_document, box_state
from bench.recordings.validation import LATEST_NS, FileModel, Measured, read_json

FILE = "openlabel.json"
UPRIGHT = 0.5  # cosine to the vertical of a box's z, from which on the box is upright
UNIT_ERROR = 1e-3  # of the length of a quaternion
EULER_VALUES, QUATERNION_VALUES = 9, 10
Time = Annotated[Decimal, Field(ge=-LATEST_NS, le=LATEST_NS)]  # nanoseconds have more digits than float


class _Lenient(FileModel):
    """Keys that are not read may be there."""

    model_config = ConfigDict(extra="allow")


class _Cuboid(_Lenient):
    val: tuple[Measured, ...] = Field(min_length=EULER_VALUES, max_length=QUATERNION_VALUES)
    coordinate_system: str | None = None


class _ObjectData(_Lenient):
    __pydantic_extra__: dict[str, list[Any]]

    cuboid: tuple[_Cuboid, ...] = ()


class _Object(_Lenient):
    name: str = ""
    type: str = ""
    coordinate_system: str | None = None
    object_data: _ObjectData = _ObjectData()


class _Properties(_Lenient):
    timestamp: Time | None = None


class _Frame(_Lenient):
    frame_properties: _Properties = _Properties()
    objects: dict[str, _Object] = Field(default_factory=dict)


class _Metadata(_Lenient):
    schema_version: Annotated[str, Field(pattern=r"^1\.")]


class _Root(_Lenient):
    metadata: _Metadata
    coordinate_systems: Any = None
    objects: dict[str, _Object] = Field(default_factory=dict)
    frames: dict[Annotated[str, Field(pattern=r"^[0-9]{1,18}$")], _Frame] = Field(default_factory=dict, min_length=1)
    frame_intervals: Any = None


class _File(_Lenient):
    openlabel: _Root


class OpenLabelFormat(LabelFormat):
    """The standard's files."""

    name = "openlabel"
    description = "ASAM OpenLABEL 1.0 of any tool: cuboids in the frame of the vehicle, the lidar or the world"

    def read(self, source: Path, recording: Recording, options: LabelOptions) -> ToolLabels:
        """Read the cuboids of a file; arguments and errors as in `LabelFormat`."""
        file = source / FILE if source.is_dir() else source
        content = read_json(_File, file).openlabel
        times_ns = _frame_times(content, recording, options, file)
        lost: Counter[str] = Counter({f"{key[:40]}: no field for them": 1 for key in content.model_extra or ()})
        for known in content.objects.values():
            lost += _not_read(known.object_data)
        names = [known.name for known in content.objects.values()]
        distinct = all(names) and len(set(names)) == len(names)
        unseen = set(content.objects)
        observations = []
        shown_objects = ((n, uid, shown) for n, frame in content.frames.items() for uid, shown in frame.objects.items())
        for number, uid, shown in shown_objects:
            field = f"openlabel.frames.{number}.objects.{uid}"
            if (item := content.objects.get(uid)) is None:
                expected = "an object listed under openlabel.objects"
                raise DataError(file, field=field, expected=expected, got=repr(uid))
            lost += _not_read(shown.object_data)
            for cuboid in shown.object_data.cuboid[:1]:
                unseen.discard(uid)
                system = cuboid.coordinate_system or shown.coordinate_system or item.coordinate_system or ""
                field += ".object_data.cuboid"
                vehicle_from_system = vehicle_from_tool(
                    system, times_ns[number], recording, options, file, f"{field}.coordinate_system"
                )
                box = vehicle_from_system @ _pose(cuboid, file, field)
                if box.rotation[2, 2] < UPRIGHT:
                    got = f"one at {np.degrees(np.arccos(box.rotation[2, 2])):.0f} degrees"
                    raise DataError(file, field=f"{field}.val", expected="a box whose z points up", got=got)
                state = box_state(times_ns[number], box, cuboid.val[-3:])
                observations.append(Observation(track=item.name if distinct else uid, label=item.type, state=state))
        lost["objects without any cuboid in a frame: left out"] = len(unseen)
        return ToolLabels(observations=observations, timestamps_ns=list(times_ns.values()), lost=lost_lines(lost))

    def write(self, recording: Recording) -> tuple[Files, list[str]]:
        """Write an annotation file whose objects have numbers, as the standard wants; arguments as in `LabelFormat`."""
        document = annotation_document(recording.tracks, [sweep.timestamp_ns for sweep in recording.sweeps])
        root = document["openlabel"]
        uids = {track.track_id: str(i) for i, track in enumerate(recording.tracks)}
        for part in (root, *root["frames"].values()):
            part["objects"] = {uids[name]: item for name, item in part["objects"].items()}
        w, *xyz = recording.vehicle_from_lidar.quaternion_wxyz.tolist()
        pose = {"quaternion": [*xyz, w], "translation": recording.vehicle_from_lidar.translation_m.tolist()}
        systems = root["coordinate_systems"]
        systems[COORDINATE_SYSTEM]["children"] = ["lidar"]
        systems["lidar"] = {"type": "sensor_cs", "parent": COORDINATE_SYSTEM, "children": [], "pose_wrt_parent": pose}
        if root["frames"]:
            root["frame_intervals"] = [{"frame_start": 0, "frame_end": len(root["frames"]) - 1}]
        return {FILE: (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()}, []


def _frame_times(content: _Root, recording: Recording, options: LabelOptions, file: Path) -> dict[str, int]:
    """The time of each frame: as it states, else of the sweep whose number it has."""
    stamps = {number: frame.frame_properties.timestamp for number, frame in content.frames.items()}
    if options.first_frame is not None or not any(stamp is not None for stamp in stamps.values()):
        sweeps = pair_with_sweeps(stamps, recording, options, source=file)
        return {number: sweep.timestamp_ns for number, sweep in sweeps.items()}
    stated_ns = []
    for number, stamp in stamps.items():
        if stamp is None:
            field = f"openlabel.frames.{number}.frame_properties.timestamp"
            raise DataError(file, field=field, expected="a time in each frame", got="none")
        stated_ns.append(round(stamp * options.unit_ns))
    times_ns = recording_times(stated_ns, recording, source=file, field="openlabel.frames: timestamp")
    return dict(zip(stamps, times_ns, strict=True))


def _not_read(data: _ObjectData) -> Counter[str]:
    counts = {f"{kind[:40]}: no field for them": len(entries) for kind, entries in (data.model_extra or {}).items()}
    counts["further cuboids of an object at one time"] = max(len(data.cuboid) - 1, 0)
    attributes = [cuboid for cuboid in data.cuboid if "attributes" in (cuboid.model_extra or {})]
    return Counter(counts | {"cuboids with attributes: no field for them": len(attributes)})


def _pose(cuboid: _Cuboid, file: Path, field: str) -> RigidTransform:
    """A box in its system: nine values turn about the fixed x, y and z in turn, ten have a quaternion."""
    numbers = np.array(cuboid.val)
    if min(size_m := cuboid.val[-3:]) <= 0:
        raise DataError(file, field=f"{field}.val", expected="sizes above 0", got=str(size_m))
    if len(numbers) == EULER_VALUES:
        rotation = Rotation.from_euler("xyz", numbers[3:6])
    elif abs(np.linalg.norm(numbers[3:7]) - 1.0) < UNIT_ERROR:
        rotation = Rotation.from_quat(numbers[3:7])
    else:
        expected, got = "a quaternion x, y, z, w of length 1", str(list(cuboid.val[3:7]))
        raise DataError(file, field=f"{field}.val", expected=expected, got=got)
    return RigidTransform(rotation.as_matrix(), numbers[:3])
