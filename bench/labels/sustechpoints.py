"""Label files of SUSTechPOINTS: a JSON file for each frame, boxes in the frame of the lidar.

A box has its centre, its full sizes along its own axes, x forward, and three angles in radians that turn about its own
x, then its own y, then its own z. `obj_attr` is free text with commas; the tool itself offers "static" there. The kind
of motion and "unclear" travel in it too.

Source:
    doc/data-format.md and public/js/util.js (`euler_angle_to_rotate_matrix`) of the tool.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict, Field, RootModel, model_validator
from scipy.spatial.transform import Rotation

from bench.atomic import write_text
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.labels.formats import LabelOptions, LabelSet, Length, ToolModel, Vector, left_out, map_classes, tool_class
from bench.labels.frames import frame_files, frame_names, pair_with_sweeps, refuse_other_frames
from bench.labels.motion import box_state, lidar_from_object, motion_lost, states_at_sweeps, with_motion
from bench.recordings import MOTION_KINDS, Cuboid, ObjectState, Recording, SweepRef, Track
from bench.recordings.validation import read_json

_VEHICLES = ("policecar", "tourcar", "longvehicle", "concretetruck", "excavator", "forklift", "crane", "roadroller",
             "bulldozer", "trimotorcycle", "freighttricycle")  # fmt: skip
_CYCLISTS = ("scooterrider", "bicyclerider", "motorcyclerider", "motorcylerider", "motorcyclist", "scooter", "motor",
             "bicyclegroup")  # fmt: skip
_THINGS = ("cone", "firehydrant", "saftytriangle", "roadbarrel", "trafficbarrier", "trashcan")
DOUBTFUL = ("babycart", "cart", "platformcart", "constructioncart", "dontcare", "misc", "unknown", "unknown1",
             "unknown2", "unknown3", "unknown4", "unknown5")  # fmt: skip
CLASSES: dict[str, str | None] = {
    **dict.fromkeys(("roadworker", "child"), "pedestrian"),
    **dict.fromkeys(_VEHICLES, "vehicle"),
    **dict.fromkeys(_CYCLISTS, "cyclist"),
    **dict.fromkeys(_THINGS),  # they do not move by themselves
    **dict.fromkeys(DOUBTFUL, "vehicle"),  # of unknown kind: they become unclear
}


class _Scale(Vector):
    x: Length = Field(gt=0)
    y: Length = Field(gt=0)
    z: Length = Field(gt=0)


class _Psr(ToolModel):
    position: Vector
    scale: _Scale
    rotation: Vector


class Box(ToolModel):
    """One object of one frame."""

    psr: _Psr
    obj_type: str = Field(min_length=1)
    obj_id: str | int | None = None
    obj_attr: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _is_of_today(cls, values: Any) -> Any:
        if isinstance(values, dict) and "vertices" in values:
            raise ValueError("no `vertices`: boxes of the tool's early versions, which have them, face along y")
        return values

    @property
    def name(self) -> str:
        """The object's id; empty where it has none."""
        return "" if self.obj_id is None else str(self.obj_id).strip()

    @property
    def attributes(self) -> tuple[str, ...]:
        """The words of `obj_attr`."""
        return tuple(word.strip() for word in (self.obj_attr or "").split(",") if word.strip())


class _BoxFile(RootModel[tuple[Box, ...]]):
    """A label file: a list of boxes."""

    model_config = ConfigDict(allow_inf_nan=False, frozen=True)


class _WrappedBoxFile(ToolModel):
    """A label file of the tool's later versions."""

    objs: tuple[Box, ...]


def read_boxes(file: Path) -> tuple[Box, ...]:
    """Read a label file, as a list of boxes or wrapped in `objs`.

    Raises:
        DataError: not such a file, or an object twice.
    """
    wrapped = file.read_bytes().lstrip()[:1] == b"{"
    boxes = read_json(_WrappedBoxFile, file).objs if wrapped else read_json(_BoxFile, file).root
    seen: set[str] = set()
    for row, box in enumerate(boxes):
        if box.name and box.name in seen:
            raise DataError(
                file, field=f"{row}.obj_id", expected="each object once in a frame", got=f"{box.name!r} twice"
            )
        seen.add(box.name)
    return boxes


FOLDER = "label"
STATIC, UNCLEAR = "static", "unclear"
WRITTEN = {"pedestrian": "Pedestrian", "cyclist": "BicycleRider", "vehicle": "Car", "animal": "Animal"}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Found:
    """A box with its frame."""

    file: Path
    row: int
    timestamp_ns: int
    box: Box


class SustechPoints:
    """The scenes of SUSTechPOINTS."""

    name = "sustechpoints"
    description = "SUSTechPOINTS: a scene folder, or its folder label/ with one JSON file of boxes for each frame"

    def read(self, source: Path, recording: Recording, options: LabelOptions) -> LabelSet:
        """Read a scene's labels; see `LabelFormat.read`."""
        files = {file.stem: file for file in frame_files(source, ".json", folders=(FOLDER,))}
        frames = pair_with_sweeps(files, recording, options, source=source)
        found = [one for name, sweep in frames.items() for one in _frame(files[name], sweep)]
        types = Counter(one.box.obj_type for one in found)
        classes = map_classes(types, options, source=source, known=CLASSES)
        doubtful = {
            name for name in types if name.casefold() in DOUBTFUL and name.casefold() not in _named_classes(options)
        }
        kept = [one for one in found if classes[one.box.obj_type] is not None]
        tracks = tuple(
            with_motion(_track(name, boxes, classes, doubtful, recording), recording.trajectory)
            for name, boxes in _by_object(kept).items()
        )
        return LabelSet(
            tracks=tracks,
            timestamps_ns=tuple(sweep.timestamp_ns for sweep in frames.values()),
            lost=(*_not_taken(classes, types, options), *_read_loss(kept, doubtful)),
        )

    def write(self, label_set: LabelSet, recording: Recording, out: Path, options: LabelOptions) -> tuple[str, ...]:
        """Write a scene's folder label/; see `LabelFormat.write`."""
        states, lost = states_at_sweeps(label_set, recording, (Cuboid,))
        names = frame_names(recording, options)
        refuse_other_frames(out / FOLDER, ".json", map(names.__getitem__, states))
        for time_ns, objects in states.items():
            boxes = [_written(track, state, recording, options) for track, state in objects]
            write_text(out / FOLDER / f"{names[time_ns]}.json", json.dumps(boxes, allow_nan=False))
        return (*lost, *motion_lost([_without_marks(track) for track in label_set.tracks]))


def _named_classes(options: LabelOptions) -> set[str]:
    return {name.casefold() for name in options.classes}


def _frame(file: Path, sweep: SweepRef) -> list[_Found]:
    return [
        _Found(file=file, row=row, timestamp_ns=sweep.timestamp_ns, box=box) for row, box in enumerate(read_boxes(file))
    ]


def _by_object(found: Sequence[_Found]) -> dict[str, list[_Found]]:
    """Boxes by their object; those without an id are objects of their own."""
    objects: dict[str, list[_Found]] = {}
    for one in found:
        objects.setdefault(one.box.name or f"unnamed-{one.file.stem}-{one.row}", []).append(one)
    return objects


def _track(
    name: str, found: Sequence[_Found], classes: Mapping[str, str | None], doubtful: set[str], recording: Recording
) -> Track:
    ours = classes[found[0].box.obj_type]
    assert ours is not None
    for one in found:
        if classes[one.box.obj_type] != ours:
            expected = f"{name!r} to stay {found[0].box.obj_type}, as in {found[0].file.name}"
            raise DataError(one.file, field=f"{one.row}.obj_type", expected=expected, got=one.box.obj_type)
    states = tuple(_state(one, one.box.obj_type in doubtful, recording) for one in found)
    return Track(track_id=name, object_class=ours, states=states)


def _state(found: _Found, doubtful: bool, recording: Recording) -> ObjectState:
    box = found.box
    rotation = Rotation.from_euler("XYZ", box.psr.rotation.numbers()).as_matrix()
    lidar_from_box = RigidTransform(rotation, np.array(box.psr.position.numbers()))
    motions = [word for word in box.attributes if word in MOTION_KINDS]
    if len(motions) > 1:
        expected = "one kind of motion"
        raise DataError(found.file, field=f"{found.row}.obj_attr", expected=expected, got=" and ".join(motions))
    state = box_state(
        recording,
        found.timestamp_ns,
        lidar_from_box,
        np.array(box.psr.scale.numbers()),
        category=motions[0] if motions else None,
        unclear=doubtful or UNCLEAR in box.attributes,
    )
    return replace(state, velocity_mps=np.zeros(3)) if STATIC in box.attributes else state


def _not_taken(classes: Mapping[str, str | None], types: Mapping[str, int], options: LabelOptions) -> list[str]:
    asked = {name: ours for name, ours in classes.items() if name.casefold() in _named_classes(options)}
    things = [name for name, ours in classes.items() if ours is None and name not in asked]
    immobile = [f"{types[name]} boxes of class {name!r}, which does not move by itself: left out" for name in things]
    return [*left_out(asked, types), *immobile]


def _read_loss(found: Sequence[_Found], doubtful: set[str]) -> list[str]:
    lost = []
    if nameless := sum(not one.box.name for one in found):
        lost.append(f"{nameless} boxes without obj_id: each one is an object of its own, seen once")
    for name in sorted(doubtful):
        count = sum(one.box.obj_type == name for one in found)
        lost.append(f"{count} boxes of class {name!r}, which does not say what they are: unclear, so not scored")
    words = Counter(
        word for one in found for word in one.box.attributes if word not in {*MOTION_KINDS, STATIC, UNCLEAR}
    )
    lost += [f"{count} attributes {word!r}: no field for them here" for word, count in sorted(words.items())]
    return lost


def _without_marks(track: Track) -> Track:
    """The track without what `obj_attr` holds."""
    return replace(track, states=tuple(replace(state, category=None, unclear=False) for state in track.states))


def _written(track: Track, state: ObjectState, recording: Recording, options: LabelOptions) -> dict[str, Any]:
    assert isinstance(state.shape, Cuboid)
    pose = lidar_from_object(state.shape, recording)
    vectors = {
        "position": pose.translation_m.tolist(),
        "scale": np.asarray(state.shape.size_m, dtype=np.float64).tolist(),
        "rotation": Rotation.from_matrix(pose.rotation).as_euler("XYZ").tolist(),
    }
    box: dict[str, Any] = {
        "obj_id": track.track_id,
        "obj_type": tool_class(track.object_class, options, WRITTEN),
        "psr": {name: dict(zip("xyz", vector, strict=True)) for name, vector in vectors.items()},
    }
    words = [word for word in (state.category, UNCLEAR if state.unclear else None) if word]
    return box | ({"obj_attr": ",".join(words)} if words else {})
