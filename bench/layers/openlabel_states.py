"""States of the objects of an OpenLABEL file, in our vehicle frame; what has no place is counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from bench.errors import DataError
from bench.layers.openlabel_boxes import read_box, upright
from bench.layers.openlabel_file import IMAGE_KINDS, OTHER_KINDS, Entry, LabelledObject, ObjectData, Root
from bench.layers.openlabel_systems import Systems
from bench.recordings import MOTION_KINDS, Cuboid, ObjectState, openlabel
from bench.recordings.annotations import read_state
from bench.recordings.validation import validated

OWN_NUMBERS = ("bottom_m", "top_m", "yaw_rate_radps", "sweep_timestamp_ns")
OWN_VECTORS = ("velocity_mps", "point_indices")
OWN_OUTLINE, OWN_TEXT, OWN_BOOLEAN, OWN_INSTANCE = "ground_outline", "category", "unclear", "instance_id"


class StateReader:
    """Reads objects and counts what has no place.

    Args:
        content: of the file.
        systems: its coordinate systems.
        file: for messages.

    Attributes:
        lost: what had no place -> how often.
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
        standing = item.object_data if item.object_data.cuboid else None
        for number in times_ns:
            entry = self._content.frames[number].objects.get(uid)
            if entry is not None:
                self._count(entry.object_data, known_numbers=OWN_NUMBERS)
            if entry is not None and (entry.object_data.cuboid or standing is None):
                yield number, entry.object_data
            elif standing is not None and (entry is not None or _holds(item, int(number))):
                own = ObjectData() if entry is None else entry.object_data
                yield number, own.model_copy(update={"cuboid": standing.cuboid})

    def _state(
        self, data: ObjectData, item: LabelledObject, number: str, time_ns: int, field: str
    ) -> ObjectState | None:
        told = [entry for entry in data.text if entry.name == OWN_TEXT]
        values: dict[str, Any] = {
            "num": [_kept(entry) for entry in data.num if entry.name in OWN_NUMBERS],
            "vec": [_kept(entry) for entry in data.vec if entry.name in OWN_VECTORS],
            "text": [_kept(entry) for entry in told if entry.val in MOTION_KINDS],
            "boolean": [_kept(entry) for entry in data.boolean if entry.name == OWN_BOOLEAN],
        }
        self._add(f"text {OWN_TEXT!r} that is no kind of motion: no place for it", len(told) - len(values["text"]))
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
            self._add(f"{kind} of images: no place for them", len(getattr(data, kind)))
        for kind in OTHER_KINDS:
            self._add(f"{kind}: no place for them", len(getattr(data, kind)))
        self._add("poly2d of images: no place for them", sum(entry.name != OWN_OUTLINE for entry in data.poly2d))
        own = {"num": known_numbers, "vec": OWN_VECTORS, "text": (OWN_TEXT,), "boolean": (OWN_BOOLEAN,)}
        for kind, names in own.items():
            for entry in getattr(data, kind):
                if entry.name not in names:
                    self._add(f"{kind} {entry.name[:40]!r}: no place for it", 1)
        for entry in data.cuboid:
            for kind, listed in entry.attributes.items():
                for given in listed if isinstance(listed, list) else ():
                    name = given.get("name") if isinstance(given, dict) else None
                    self._add(f"{kind[:40]} {str(name)[:40]!r} of cuboids: no place for it", 1)

    def _add(self, what: str, count: int) -> None:
        if count:
            self.lost[what] += count

    def instance_id(self, uid: str, item: LabelledObject) -> int | None:
        """The object's number in truth images, where the file has it."""
        for entry in item.object_data.num:
            if entry.name == OWN_INSTANCE:
                field = f"openlabel.objects.{uid}.object_data.num"
                return validated(openlabel.InstanceData, _kept(entry), file=self._file, field=field).val
        return None


def _holds(item: LabelledObject, number: int) -> bool:
    intervals = item.frame_intervals
    return intervals is None or any(part.frame_start <= number <= part.frame_end for part in intervals)


def _kept(entry: Entry) -> dict[str, Any]:
    return {"name": entry.name, "val": entry.val}


def _tupled(value: Any) -> Any:
    """Lists as tuples, which is what models of values take."""
    if isinstance(value, dict):
        return {key: _tupled(part) for key, part in value.items()}
    return tuple(_tupled(part) for part in value) if isinstance(value, list | tuple) else value
