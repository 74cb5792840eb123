"""Annotation files <-> tracks, and what of a recording they cover."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from os.path import lexists
from pathlib import Path
from typing import Annotated as Of
from typing import Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from bench.errors import DataError
from bench.geometry import RigidTransform, quaternions_wxyz
from bench.recordings import openlabel
from bench.recordings.validation import FileModel, TimeNs, in_order, read_json
from bench.records.recording import (
    ALWAYS_NS,
    COMPLETELY,
    NOT_ANNOTATED,
    Annotated,
    Cuboid,
    GroundPolygon,
    ObjectShape,
    ObjectState,
    PointIndices,
    Track,
)
from bench.times import unit_hint

REVIEW_SUFFIX = ".review.json"  # of files beside the annotations, from which they are made

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


def read_annotations(file: Path) -> tuple[Track, ...]:
    """Read an annotation file.

    Returns:
        Tracks in the order of the file; objects that no frame mentions have no states.

    Raises:
        DataError: missing, not of the OpenLABEL subset, or objects and frames that do not fit together.
    """
    content = read_json(openlabel.AnnotationFile, file).openlabel
    states = _states(content, file)
    return tuple(
        Track(
            track_id=uid,
            object_class=item.type,
            states=tuple(states[uid]),
            instance_id=item.object_data.num[0].val if item.object_data.num else None,
            reviewed=content.metadata.comment != openlabel.NOT_REVIEWED,
        )
        for uid, item in content.objects.items()
    )


def _states(content: openlabel.OpenLabel, file: Path) -> dict[str, list[ObjectState]]:
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
        for state, xyzw in zip(track.states, _quaternions_xyzw(track), strict=True):
            frames[state.timestamp_ns]["objects"][track.track_id] = {"object_data": _state_data(state, xyzw)}
    comment = {} if all(track.reviewed for track in tracks) else {"comment": openlabel.NOT_REVIEWED}
    return {
        "openlabel": {
            "metadata": {"schema_version": openlabel.VERSION, **comment},
            "coordinate_systems": {openlabel.COORDINATE_SYSTEM: {"type": "local_cs", "parent": "", "children": []}},
            "objects": {track.track_id: _object(track) for track in tracks},
            "frames": {str(i): frames[time_ns] for i, time_ns in enumerate(times_ns)},
        }
    }


def _state(data: openlabel.FrameObjectData, timestamp_ns: int) -> ObjectState:
    numbers, vectors = data.numbers, data.vectors
    return ObjectState(
        timestamp_ns=timestamp_ns,
        shape=_shape(data, numbers, vectors),
        velocity_mps=np.array(vectors.get("velocity_mps", (np.nan,) * 3), dtype=np.float64),
        yaw_rate_radps=float(numbers.get("yaw_rate_radps", 0.0)),
        category=data.text[0].val if data.text else None,
        unclear=data.boolean[0].val if data.boolean else False,
    )


def _shape(data: openlabel.FrameObjectData, numbers: dict[str, Any], vectors: dict[str, Any]) -> ObjectShape:
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


def _quaternions_xyzw(track: Track) -> list[list[float]]:
    """Of each state's box; without numbers where it is none."""
    boxes = [state.shape.vehicle_from_object for state in track.states if isinstance(state.shape, Cuboid)]
    if not boxes:
        return [[] for _ in track.states]
    quaternions = iter(np.roll(quaternions_wxyz(np.stack([box.rotation for box in boxes])), -1, axis=1).tolist())
    return [next(quaternions) if isinstance(state.shape, Cuboid) else [] for state in track.states]


def _state_data(state: ObjectState, quaternion_xyzw: list[float]) -> dict[str, Any]:
    data: dict[str, Any] = {}
    numbers: dict[str, float] = {}
    vectors: dict[str, list[Any]] = {}
    match state.shape:
        case Cuboid(vehicle_from_object=pose, size_m=size_m):
            val = [*pose.translation_m.tolist(), *quaternion_xyzw, *np.asarray(size_m, dtype=np.float64).tolist()]
            data["cuboid"] = [{"name": "shape", "coordinate_system": openlabel.COORDINATE_SYSTEM, "val": val}]
        case GroundPolygon(outline_m=outline_m, bottom_m=bottom_m, top_m=top_m):
            data["poly2d"] = [
                {
                    "name": "ground_outline",
                    "coordinate_system": openlabel.COORDINATE_SYSTEM,
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
    data |= {kind: _named(entries) for kind, entries in (("num", numbers), ("vec", vectors)) if entries}
    if state.category is not None:
        data["text"] = [{"name": "category", "val": str(state.category)}]
    if state.unclear:
        data["boolean"] = [{"name": "unclear", "val": True}]
    return data


def _named(entries: dict[str, Any]) -> list[dict[str, Any]]:
    return [{"name": name, "val": val} for name, val in entries.items()]
