"""The states of objects in an OpenLABEL file: times, boxes, and what is lost.

Times of the frames of an OpenLABEL file.

The standard leaves open what a timestamp is: a number or text, in any unit, since any epoch. A frame may state one of
its own, one of the lidar's stream, and one with each of its boxes (`timestamp` among their attributes). Taken are those
of the three, in the unit, by which most sweeps and images of the recording are met within a millisecond; a frame takes
the time of what it meets. Of a few frames that still share a time the last is read. Files without timestamps pair their
frames with sweeps: by what the lidar's stream says of the frame (time, file), else by the frame's number.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.labels.formats import LabelOptions, finite_number
from bench.labels.frames import pair_with_sweeps
from bench.labels.openlabel_calibration import Systems
from bench.labels.openlabel_file import (
    IMAGE_KINDS,
    OTHER_KINDS,
    Entry,
    LabelledFrame,
    LabelledObject,
    ObjectData,
    Root,
    Stamp,
    Stream,
)
from bench.recordings import MOTION_KINDS, Cuboid, ObjectState, Recording, openlabel
from bench.recordings.annotations import read_state
from bench.recordings.validation import LATEST_NS, validated

UNITS_NS = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000}
NEAR_NS = 1_000_000
STAMPS = ("frame", "lidar", "boxes")
BOX_TIME = "timestamp"
LONGEST_TEXT = 64


def frame_times(
    content: Root, recording: Recording, options: LabelOptions, file: Path, lost: Counter[str]
) -> dict[str, int]:
    """The time of each frame that is read, int64 ns.

    Args:
        content: of the file.
        recording: what was annotated.
        options: for `first_frame`.
        file: for messages.
        lost: takes the frames that share their time with a later one.

    Raises:
        DataError: no frames, some have timestamps and others not, no unit fits, half of them share their time, or
            frames that fit no sweep.
    """
    frames = content.frames
    if not frames:
        got = f"none, and {len(content.objects)} objects" if content.objects else "none"
        hint = "an annotation needs times; export the labels with frames"
        raise DataError(file, field="openlabel.frames", expected="frames, to pair with sweeps", got=got, hint=hint)
    ways = [way for way in map(partial(_stamps, content), STAMPS) if any(stamp is not None for stamp in way.values())]
    whole = [way for way in ways if all(stamp is not None for stamp in way.values())]
    if whole:
        parsed = [
            {number: _parsed(stamp, number, file) for number, stamp in way.items() if stamp is not None}
            for way in whole
        ]
        return _one_each(_in_best_unit(parsed, recording, file), lost, file)
    if ways:
        missing = next(number for number, stamp in ways[0].items() if stamp is None)
        field = f"openlabel.frames.{missing}.frame_properties.timestamp"
        raise DataError(file, field=field, expected="a time, as the other frames have", got="nothing")
    names = _names(content)
    sweeps = pair_with_sweeps(tuple(names.values()), recording, options, source=file)
    return _one_each({number: sweeps[name].timestamp_ns for number, name in names.items()}, lost, file)


def _stamps(content: Root, way: str) -> dict[str, Stamp | None]:
    """Statements of the frames in one of the three ways."""
    if way == "frame":
        return {number: frame.frame_properties.timestamp for number, frame in content.frames.items()}
    if way == "lidar":
        return {n: _lidar_stream(content, n).stream_properties.sync.timestamp for n in content.frames}
    return {number: _box_stamp(frame) for number, frame in content.frames.items()}


def _box_stamp(frame: LabelledFrame) -> Stamp | None:
    """The one number that all boxes of a frame state as their time; None where they state none or several."""
    boxes = [box for item in frame.objects.values() for box in item.object_data.cuboid]
    stamps = {finite_number(box.stated(BOX_TIME)) for box in boxes}
    return boxes[0].stated(BOX_TIME) if len(stamps) == 1 and None not in stamps else None


def _one_each(times_ns: dict[str, int], lost: Counter[str], file: Path) -> dict[str, int]:
    """Of frames that share a time the last.

    Raises:
        DataError: half of the frames or more share theirs, so that the times do not identify frames.
    """
    last = {time_ns: number for number, time_ns in times_ns.items()}
    kept = {number: time_ns for number, time_ns in times_ns.items() if last[time_ns] == number}
    if 2 * len(kept) <= len(times_ns) and len(kept) < len(times_ns):
        first = next(number for number in times_ns if number not in kept)
        got = f"{times_ns[first]} in frames {first} and {last[times_ns[first]]}"
        raise DataError(file, field=f"openlabel.frames.{first}", expected="one frame for each time", got=got)
    if len(kept) < len(times_ns):
        lost["frames of the same time as a later one, left out"] += len(times_ns) - len(kept)
    return kept


def _names(content: Root) -> dict[str, str]:
    """Keys that pair each frame with a sweep: the lidar's file, its own count, or the frame's number."""
    streams = {number: _lidar_stream(content, number) for number in content.frames}
    if all(stream.uri for stream in streams.values()):
        return {number: Path(str(stream.uri).replace("\\", "/")).stem for number, stream in streams.items()}
    counts = {number: stream.stream_properties.sync.frame_stream for number, stream in streams.items()}
    if all(count is not None for count in counts.values()):
        return {number: str(count) for number, count in counts.items()}
    return {number: str(int(number)) for number in content.frames}


def _lidar_stream(content: Root, number: str) -> Stream:
    """The lidar's stream of a frame; an empty one where the frame has none, or several."""
    streams = content.frames[number].frame_properties.streams
    lidars = [
        stream
        for name, stream in streams.items()
        if stream.type == "lidar" or (name in content.streams and content.streams[name].type == "lidar")
    ]
    return lidars[0] if len(lidars) == 1 else Stream()


def _parsed(stamp: float | str | None, number: str, file: Path) -> Decimal | int:
    """A number in an unknown unit, or ns of a written date."""
    field = f"openlabel.frames.{number}.frame_properties.timestamp"
    text = str(stamp).strip()
    if len(text) > LONGEST_TEXT:
        raise DataError(file, field=field, expected="a time", got=repr(text[:LONGEST_TEXT]))
    try:
        value = Decimal(text)
    except InvalidOperation:
        value = None
    if value is not None:
        if not value.is_finite() or value.copy_abs() > LATEST_NS:  # `abs` fails on exponents beyond its context
            raise DataError(file, field=field, expected="a time", got=text)
        return value
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise DataError(file, field=field, expected="a number, or a date and time", got=repr(text)) from None
    moment = moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)
    whole = int(moment.replace(microsecond=0).timestamp()) * UNITS_NS["s"]
    return whole + moment.microsecond * UNITS_NS["us"]


def _in_best_unit(ways: Sequence[Mapping[str, Decimal | int]], recording: Recording, file: Path) -> dict[str, int]:
    known = sorted(
        {sweep.timestamp_ns for sweep in recording.sweeps}
        | {image.timestamp_ns for images in recording.images.values() for image in images}
    )
    best, values = dict[str, int](), ways[0]
    most = 0
    for way, unit_ns in product(ways, UNITS_NS.values()):
        times_ns: dict[str, int] = {}
        met: set[int] = set()
        for number, value in way.items():
            exact = value if isinstance(value, int) else int((value * unit_ns).to_integral_value())
            nearest = _nearest(exact, known)
            met |= set() if nearest is None else {nearest}
            times_ns[number] = exact if nearest is None else nearest
        if len(met) > most:
            best, most, values = times_ns, len(met), way
    if not most:
        first = next(iter(values))
        raise DataError(
            file,
            field=f"openlabel.frames.{first}.frame_properties.timestamp",
            expected=f"times of the recording, {known[0]} to {known[-1]} ns, in ns, us, ms or s" if known else "a time",
            got=str(values[first]),
        )
    for number, time_ns in best.items():
        if abs(time_ns) > LATEST_NS:
            field = f"openlabel.frames.{number}.frame_properties.timestamp"
            expected = "a time of this recording, in the unit of the other frames"
            raise DataError(file, field=field, expected=expected, got=str(values[number]))
    return best


def _nearest(time_ns: int, known: list[int]) -> int | None:
    place = bisect_left(known, time_ns)
    near = [t for t in known[max(place - 1, 0) : place + 1] if abs(t - time_ns) <= NEAR_NS]
    return min(near, key=lambda t: abs(t - time_ns), default=None)


EULER, QUATERNION = 9, 10


def read_box(val: object, file: Path, field: str) -> tuple[RigidTransform, NDArray[np.float64]]:
    """Pose and size of a cuboid.

    Args:
        val: nine values, with angles about the fixed x, y and z in turn, or ten, with a quaternion x, y, z, w.
        file: for messages.
        field: of the values in the file.

    Raises:
        DataError: another number of values, a size that is not above 0, a quaternion of another length than 1.
    """
    numbers = [finite_number(number) for number in val] if isinstance(val, list | tuple) else []
    if len(numbers) not in {EULER, QUATERNION} or None in numbers:
        raise DataError(file, field=f"{field}.val", expected="9 or 10 finite numbers", got=repr(val)[:80])
    values = np.array(numbers, dtype=np.float64)
    place_m, size_m = values[:3], values[-3:]
    if size_m.min() <= 0:
        got = str(size_m.tolist())
        raise DataError(file, field=f"{field}.val", expected="a box of sizes above 0", got=got)
    if len(values) == EULER:
        return RigidTransform(Rotation.from_euler("xyz", values[3:6]).as_matrix(), place_m), size_m
    x, y, z, w = values[3:7].tolist()
    if abs(float(np.linalg.norm(values[3:7])) - 1.0) > 1e-3:
        got = str([x, y, z, w])
        raise DataError(file, field=f"{field}.val", expected="a quaternion x, y, z, w of length 1", got=got)
    return RigidTransform.from_quaternion((w, x, y, z), place_m), size_m


def upright(
    vehicle_from_box: RigidTransform, size_m: NDArray[np.float64]
) -> tuple[RigidTransform, NDArray[np.float64]]:
    """The same box with z up and x forward; tools that label in camera axes have its height along y."""
    up = vehicle_from_box.rotation[2]
    height = int(np.argmax(np.abs(up)))
    if height == 2 and up[2] > 0:
        return vehicle_from_box, size_m
    z_axis = np.eye(3)[height] * np.sign(up[height])
    x_axis = np.eye(3)[1 if height == 0 else 0]
    box_from_upright = np.stack([x_axis, np.cross(z_axis, x_axis), z_axis], axis=1)
    rotated = RigidTransform(vehicle_from_box.rotation @ box_from_upright, vehicle_from_box.translation_m)
    return rotated, np.abs(box_from_upright.T) @ size_m


OWN_NUMBERS = ("bottom_m", "top_m", "yaw_rate_radps", "sweep_timestamp_ns")
OWN_VECTORS = ("velocity_mps", "point_indices")
OWN_OUTLINE, OWN_TEXT, OWN_BOOLEAN, OWN_INSTANCE = "ground_outline", "category", "unclear", "instance_id"


class StateReader:
    """Reads objects and counts what has no field.

    Args:
        content: of the file.
        systems: its coordinate systems.
        file: for messages.

    Attributes:
        lost: what had no field -> how often.
    """

    def __init__(self, content: Root, systems: Systems, file: Path) -> None:
        self._content, self._systems, self._file = content, systems, file
        self.lost: Counter[str] = Counter()

    def states(self, uid: str, item: LabelledObject, times_ns: dict[str, int]) -> tuple[ObjectState, ...]:
        """An object's states by time; a box of the head holds in every frame of the object that has none of its own.

        Raises:
            DataError: data that is not what its kind or name asks for.
        """
        self._count(item.object_data, known_numbers=(OWN_INSTANCE,))
        states = []
        for number, data in self._frames(uid, item, times_ns):
            state = self._state(data, item, number, times_ns[number], f"openlabel.frames.{number}.objects.{uid}")
            if state is not None:
                states.append(state)
        return tuple(sorted(states, key=lambda state: state.timestamp_ns))

    def _frames(self, uid: str, item: LabelledObject, times_ns: dict[str, int]) -> Iterator[tuple[str, ObjectData]]:
        constant = item.object_data if item.object_data.cuboid else None
        for number in times_ns:
            entry = self._content.frames[number].objects.get(uid)
            if entry is not None:
                self._count(entry.object_data, known_numbers=OWN_NUMBERS)
            if entry is not None and (entry.object_data.cuboid or constant is None):
                yield number, entry.object_data
            elif constant is not None and (entry is not None or _holds(item, int(number))):
                own = ObjectData() if entry is None else entry.object_data
                yield number, own.model_copy(update={"cuboid": constant.cuboid})

    def _state(
        self, data: ObjectData, item: LabelledObject, number: str, time_ns: int, field: str
    ) -> ObjectState | None:
        categories = [entry for entry in data.text if entry.name == OWN_TEXT]
        values: dict[str, Any] = {
            "num": [_name_and_value(entry) for entry in data.num if entry.name in OWN_NUMBERS],
            "vec": [_name_and_value(entry) for entry in data.vec if entry.name in OWN_VECTORS],
            "text": [_name_and_value(entry) for entry in categories if entry.val in MOTION_KINDS],
            "boolean": [_name_and_value(entry) for entry in data.boolean if entry.name == OWN_BOOLEAN],
        }
        self._add(
            f"text {OWN_TEXT!r} that is no kind of motion: no field for it", len(categories) - len(values["text"])
        )
        shape: Cuboid | None = None
        boxes = [entry for entry in data.cuboid if entry.val is not None]
        self._add("cuboids without numbers, left out", len(data.cuboid) - len(boxes))
        outlines = [entry for entry in data.poly2d if entry.name == OWN_OUTLINE]
        indexed = any(entry["name"] == "point_indices" for entry in values["vec"])
        if boxes:
            self._add("further cuboids of an object in a frame: the first is read", len(boxes) - 1)
            shape = self._cuboid(boxes[0], item, number, f"{field}.object_data.cuboid")
            values["num"] = [entry for entry in values["num"] if entry["name"] == "yaw_rate_radps"]
            values["vec"] = [entry for entry in values["vec"] if entry["name"] == "velocity_mps"]
        elif outlines:
            values["poly2d"] = [self._outline(entry, item, field) for entry in outlines]
        elif not indexed:
            return None
        strict = validated(openlabel.FrameObjectData, _tupled(values), file=self._file, field=f"{field}.object_data")
        return read_state(strict, time_ns, file=self._file, field=field, shape=shape)

    def _cuboid(self, entry: Entry, item: LabelledObject, number: str, field: str) -> Cuboid:
        system_from_box, size_m = read_box(entry.val, self._file, field)
        system = entry.coordinate_system or item.coordinate_system
        vehicle_from_box = self._systems.vehicle_from(system, number) @ system_from_box
        vehicle_from_upright, size_m = upright(vehicle_from_box, size_m)
        if vehicle_from_upright is not vehicle_from_box:
            self._add("boxes whose height is not along their own z: their axes are renamed", 1)
        return Cuboid(vehicle_from_object=vehicle_from_upright, size_m=size_m)

    def _outline(self, entry: Entry, item: LabelledObject, field: str) -> dict[str, Any]:
        system = entry.coordinate_system or item.coordinate_system
        if system not in {None, openlabel.COORDINATE_SYSTEM}:
            place = f"{field}.object_data.poly2d.coordinate_system"
            raise DataError(self._file, field=place, expected=f"{openlabel.COORDINATE_SYSTEM!r}", got=repr(system)[:80])
        return {"name": entry.name, "val": entry.val, "mode": entry.mode, "closed": entry.closed}

    def _count(self, data: ObjectData, *, known_numbers: Sequence[str]) -> None:
        for kind in IMAGE_KINDS:
            self._add(f"{kind} of images: no field for them", len(getattr(data, kind)))
        for kind in OTHER_KINDS:
            self._add(f"{kind}: no field for them", len(getattr(data, kind)))
        self._add("poly2d of images: no field for them", sum(entry.name != OWN_OUTLINE for entry in data.poly2d))
        own = {"num": known_numbers, "vec": OWN_VECTORS, "text": (OWN_TEXT,), "boolean": (OWN_BOOLEAN,)}
        for kind, names in own.items():
            for entry in getattr(data, kind):
                if entry.name not in names:
                    self._add(f"{kind} {entry.name[:40]!r}: no field for it", 1)
        for entry in data.cuboid:
            for kind, listed in entry.attributes.items():
                for given in listed if isinstance(listed, list) else ():
                    name = given.get("name") if isinstance(given, dict) else None
                    self._add(f"{kind[:40]} {str(name)[:40]!r} of cuboids: no field for it", 1)

    def _add(self, what: str, count: int) -> None:
        if count:
            self.lost[what] += count

    def instance_id(self, uid: str, item: LabelledObject) -> int | None:
        """The object's number in truth images, where the file has it."""
        for entry in item.object_data.num:
            if entry.name == OWN_INSTANCE:
                field = f"openlabel.objects.{uid}.object_data.num"
                return validated(openlabel.InstanceData, _name_and_value(entry), file=self._file, field=field).val
        return None


def _holds(item: LabelledObject, number: int) -> bool:
    intervals = item.frame_intervals
    return intervals is None or any(part.frame_start <= number <= part.frame_end for part in intervals)


def _name_and_value(entry: Entry) -> dict[str, Any]:
    return {"name": entry.name, "val": entry.val}


def _tupled(value: Any) -> Any:
    """Lists as tuples, which is what models of values take."""
    if isinstance(value, dict):
        return {key: _tupled(part) for key, part in value.items()}
    return tuple(_tupled(part) for part in value) if isinstance(value, list | tuple) else value
