"""The boxes of a label file of SUSTechPOINTS, and the classes that the tool offers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ConfigDict, Field, RootModel, model_validator

from bench.errors import DataError
from bench.layers.tool_model import Length, ToolModel, Vector
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
    **dict.fromkeys(DOUBTFUL, "vehicle"),  # what they are is not told: they become unclear
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
