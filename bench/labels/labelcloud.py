"""Label files of labelCloud: a JSON file for each point cloud, and `_classes.json` with the classes.

The tool knows boxes and no objects: a box has a class and no number. Boxes of one class are therefore followed from
frame to frame by proximity.

Source:
    labelCloud/io/labels and labelCloud/utils/math3d.py (`rotate_around_zyx`) of the tool.

The boxes of labelCloud in its three ways of writing them.

`centroid_abs` gives angles in degrees from 0 to 360, `centroid_rel` in radians from -pi to pi; both turn about x first,
then about the fixed y, then about the fixed z. `vertices` gives eight corners: 0 to 3 below and 4 to 7 above them, from
the corner of smallest x and y against the length (x), along the width (y): 0 (-, -), 1 (-, +), 2 (+, +), 3 (+, -).
"""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial.transform import Rotation

from bench.atomic import write_text
from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform
from bench.labels.formats import (
    LabelOptions,
    LabelSet,
    Length,
    ToolModel,
    Vector,
    is_ignored,
    left_out,
    map_classes,
    tool_class,
)
from bench.labels.frames import frame_files, frame_names, pair_with_sweeps, refuse_other_frames
from bench.labels.motion import (
    GroupedSweep,
    box_state,
    lidar_from_object,
    linked_groups,
    motion_lost,
    states_at_sweeps,
    with_motion,
)
from bench.recordings import OBJECT_CLASSES, Cuboid, ObjectState, Recording, SweepRef, Track
from bench.recordings.validation import located, read_json

Way = Literal["centroid_rel", "centroid_abs", "vertices"]
WAYS: tuple[Way, ...] = ("centroid_rel", "centroid_abs", "vertices")
CORNERS = np.array(
    [[-1, -1, -1], [-1, 1, -1], [1, 1, -1], [1, -1, -1], [-1, -1, 1], [-1, 1, 1], [1, 1, 1], [1, -1, 1]],
    dtype=np.float64,
)
LARGEST_SLANT = 1e-3  # of the edges of a box: labelCloud rounds to as few as three decimals where it is set to


class Dimensions(ToolModel):
    """Full sizes, m."""

    length: Length = Field(gt=0)
    width: Length = Field(gt=0)
    height: Length = Field(gt=0)


class CentroidObject(ToolModel):
    """A box by its middle, sizes and angles."""

    name: str = Field(min_length=1)
    centroid: Vector
    dimensions: Dimensions
    rotations: Vector


class VerticesObject(ToolModel):
    """A box by its corners."""

    name: str = Field(min_length=1)
    vertices: tuple[tuple[Length, Length, Length], ...] = Field(min_length=8, max_length=8)


CloudBox = tuple[RigidTransform, NDArray[np.float64]]  # cloud_from_object of the centre, x along the length; sizes, m


def box_of_centroid(found: CentroidObject, *, degrees: bool) -> CloudBox:
    """A box from its middle, sizes and angles.

    Raises:
        ShapeError: angles beyond what radians from -pi to pi, or degrees from 0 to 360, can be.
    """
    angles = found.rotations.numbers()
    if degrees and not all(-1e-9 <= angle <= 360 + 1e-9 for angle in angles):
        raise ShapeError(f"rotations: expected degrees from 0 to 360, got {angles}")
    if not degrees and max(map(abs, angles)) > np.pi + 1e-6:
        raise ShapeError(f"rotations: expected radians from -pi to pi, got {angles}")
    rotation = Rotation.from_euler("xyz", angles, degrees=degrees).as_matrix()
    sizes = found.dimensions
    size_m = np.array([sizes.length, sizes.width, sizes.height])
    return RigidTransform(rotation, np.array(found.centroid.numbers())), size_m


def box_of_vertices(found: VerticesObject) -> CloudBox:
    """A box from its corners.

    Raises:
        ShapeError: the corners are not those of a box.
    """
    corners = np.array(found.vertices)
    centre = corners.mean(axis=0)
    edges = (CORNERS.T @ (corners - centre)) / 8  # rows: half the length, width and height as vectors
    half_m = np.linalg.norm(edges, axis=1)
    slant_m = float(np.abs(CORNERS @ edges + centre - corners).max())
    if half_m.min() <= 0 or slant_m > LARGEST_SLANT * max(1.0, half_m.max()):
        raise ShapeError(f"vertices: expected the corners of a box in labelCloud's order, got some {slant_m:.3g} m off")
    left, _, right = np.linalg.svd((edges / half_m[:, None]).T)
    rotation = left @ right
    if np.linalg.det(rotation) < 0 or np.abs(rotation.T - edges / half_m[:, None]).max() > LARGEST_SLANT * 10:
        raise ShapeError("vertices: expected the corners of a box in labelCloud's order, got mirrored or slanted ones")
    return RigidTransform(rotation, centre), 2 * half_m


def written(name: str, pose: RigidTransform, size_m: NDArray[np.float64], way: Way) -> dict[str, Any]:
    """A box as labelCloud writes it; numbers are not rounded."""
    sizes = np.asarray(size_m, dtype=np.float64)
    if way == "vertices":
        return {"name": name, "vertices": pose.apply(CORNERS * sizes / 2).tolist()}
    degrees = way == "centroid_abs"
    angles = Rotation.from_matrix(pose.rotation).as_euler("xyz", degrees=degrees)
    if degrees:
        angles = angles % 360.0
    return {
        "name": name,
        "centroid": dict(zip("xyz", pose.translation_m.tolist(), strict=True)),
        "dimensions": dict(zip(("length", "width", "height"), sizes.tolist(), strict=True)),
        "rotations": dict(zip("xyz", angles.tolist(), strict=True)),
    }


FOLDER, CLASS_FILE = "labels", "_classes.json"
CLOUD_FOLDER = "pointclouds"
COLOURS = ("#FF6363", "#FFAB76", "#63A1FF", "#9DA2AB")  # of our classes, in their order


class _ClassFile(ToolModel):
    """Keys of `_classes.json` that say how to read the rest."""

    type: str
    format: str


class _CentroidFile(ToolModel):
    objects: tuple[CentroidObject, ...]


class _VerticesFile(ToolModel):
    objects: tuple[VerticesObject, ...]


class LabelCloud:
    """One of labelCloud's ways of writing boxes."""

    way: ClassVar[Way]
    name: str
    description: str

    def read(self, source: Path, recording: Recording, options: LabelOptions) -> LabelSet:
        """Read a folder of labels; see `LabelFormat.read`."""
        files = {file.stem: file for file in frame_files(source, ".json", folders=(FOLDER,), without=(CLASS_FILE,))}
        self._refuse_other_way(next(iter(files.values())).parent / CLASS_FILE)
        frames = pair_with_sweeps(files, recording, options, source=source)
        found = [one for name, sweep in frames.items() for one in self._boxes(files[name], sweep, recording)]
        counts = Counter(name for name, _ in found)
        classes = map_classes(counts, options, source=source)
        tracks = _tracks(found, classes, recording)
        lost = list(left_out(classes, counts))
        if tracks:
            kept = sum(len(track.states) for track in tracks)
            lost.append(f"labelCloud numbers no objects: {kept} boxes followed by proximity make {len(tracks)} objects")
        times_ns = tuple(sweep.timestamp_ns for sweep in frames.values())
        return LabelSet(tracks=tracks, timestamps_ns=times_ns, lost=tuple(lost))

    def write(self, label_set: LabelSet, recording: Recording, out: Path, options: LabelOptions) -> tuple[str, ...]:
        """Write the folder labels/ with its class definition; see `LabelFormat.write`."""
        states, lost = states_at_sweeps(label_set, recording, (Cuboid,))
        names = frame_names(recording, options)
        sweeps = {sweep.timestamp_ns: sweep for sweep in recording.sweeps}
        tool_names = {ours: tool_class(ours, options) for ours in OBJECT_CLASSES}
        refuse_other_frames(out / FOLDER, ".json", map(names.__getitem__, states), without=(CLASS_FILE,))
        for time_ns, objects in states.items():
            cloud = names[time_ns] + sweeps[time_ns].path.suffix
            boxes = [
                written(tool_names[track.object_class], lidar_from_object(box, recording), box.size_m, self.way)
                for track, state in objects
                if isinstance(box := state.shape, Cuboid)
            ]
            head = {"folder": CLOUD_FOLDER, "filename": cloud, "path": f"{CLOUD_FOLDER}/{cloud}"}
            write_text(out / FOLDER / f"{names[time_ns]}.json", _json({**head, "objects": boxes}))
        self._write_classes(out / FOLDER / CLASS_FILE, tuple(dict.fromkeys(tool_names.values())))
        held = len({id(track) for objects in states.values() for track, _ in objects})
        numbers = [f"which boxes are one object: labelCloud numbers none of the {held}"] if held else []
        return (*lost, *numbers, *motion_lost(label_set.tracks))

    def _refuse_other_way(self, file: Path) -> None:
        if not file.is_file():
            return
        stated = read_json(_ClassFile, file)
        if stated.type != "object_detection":
            raise DataError(file, field="type", expected="object_detection, labels of boxes", got=stated.type)
        if stated.format != self.way:
            other = f"read it as labelcloud-{stated.format.replace('_', '-')}"
            hint = other if stated.format in WAYS else "export the labels from labelCloud in one of its JSON formats"
            raise DataError(file, field="format", expected=f"{self.way}, as asked for", got=stated.format, hint=hint)

    def _boxes(self, file: Path, sweep: SweepRef, recording: Recording) -> list[tuple[str, ObjectState]]:
        """Class and state of each box."""
        found = []
        for row, one in enumerate(self._objects(file)):
            with located(file, f"objects.{row}"):
                box = (
                    box_of_vertices(one)
                    if isinstance(one, VerticesObject)
                    else box_of_centroid(one, degrees=self.way == "centroid_abs")
                )
            state = box_state(recording, sweep.timestamp_ns, *box, unclear=is_ignored(one.name))
            found.append((one.name, state))
        return found

    def _objects(self, file: Path) -> Sequence[VerticesObject | CentroidObject]:
        return (
            read_json(_VerticesFile, file).objects if self.way == "vertices" else read_json(_CentroidFile, file).objects
        )

    def _write_classes(self, file: Path, names: Sequence[str]) -> None:
        classes = [
            {"name": name, "id": number, "color": COLOURS[number % len(COLOURS)]} for number, name in enumerate(names)
        ]
        write_text(file, _json({"classes": classes, "default": 0, "type": "object_detection", "format": self.way}))


class LabelCloudCentroidAbs(LabelCloud):
    """Centre, sizes, angles in degrees: labelCloud's default."""

    way = "centroid_abs"
    name = "labelcloud-centroid-abs"
    description = "labelCloud centroid_abs: a folder of JSON files of boxes, angles in degrees; the tool's default"


class LabelCloudCentroidRel(LabelCloud):
    """Centre, sizes, angles in radians."""

    way = "centroid_rel"
    name = "labelcloud-centroid-rel"
    description = "labelCloud centroid_rel: a folder of JSON files of boxes, angles in radians"


class LabelCloudVertices(LabelCloud):
    """Eight corners."""

    way = "vertices"
    name = "labelcloud-vertices"
    description = "labelCloud vertices: a folder of JSON files of boxes by their eight corners"


def _tracks(
    found: Sequence[tuple[str, ObjectState]], classes: Mapping[str, str | None], recording: Recording
) -> tuple[Track, ...]:
    """Boxes of each class, followed from frame to frame."""
    tracks: list[Track] = []
    for name, ours in classes.items():
        if ours is None:
            continue
        states: dict[int, list[ObjectState]] = defaultdict(list)
        for found_name, state in found:
            if found_name == name:
                states[state.timestamp_ns].append(state)
        objects: dict[int, list[ObjectState]] = defaultdict(list)
        grouped = [_grouped(time_ns, states[time_ns], recording) for time_ns in sorted(states)]
        for sweep, numbers in zip(grouped, linked_groups(grouped), strict=True):
            for state, number in zip(states[sweep.timestamp_ns], numbers, strict=True):
                objects[number].append(state)
        tracks += [
            with_motion(
                Track(track_id=f"{name}-{number + 1}", object_class=ours, states=tuple(objects[number])),
                recording.trajectory,
            )
            for number in sorted(objects)
        ]
    return tuple(tracks)


def _grouped(time_ns: int, states: Sequence[ObjectState], recording: Recording) -> GroupedSweep:
    """Poses of a frame's boxes in the world."""
    world_from_vehicle = recording.trajectory.world_from_vehicle(time_ns)
    centres = [s.shape.vehicle_from_object.translation_m for s in states if isinstance(s.shape, Cuboid)]
    return GroupedSweep(timestamp_ns=time_ns, middles_m=world_from_vehicle.apply(np.array(centres)))


def _json(values: object) -> str:
    return json.dumps(values, indent=1, allow_nan=False) + "\n"
