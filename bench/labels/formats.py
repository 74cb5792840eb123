"""What a label format is, which there are, and what its classes are for us."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Protocol

from pydantic import ConfigDict, Field

from bench.errors import DataError, UnknownNameError, UsageError
from bench.plug_ins import imported, known_places
from bench.recordings import OBJECT_CLASSES, Recording, Track
from bench.recordings.validation import FileModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layer:
    """Annotations of one recording, and when the scene was annotated.

    Attributes:
        tracks: objects; their states are in the vehicle frame at each state's time.
        timestamps_ns: all annotated times, also those at which the scene held nothing, increasing.
        lost: one line for each thing that the source did not tell or that did not survive the translation.
    """

    tracks: tuple[Track, ...]
    timestamps_ns: tuple[int, ...]
    lost: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelOptions:
    """What the user says about a tool's files.

    Attributes:
        classes: the tool's class -> one of `OBJECT_CLASSES`, or None to leave its objects out on purpose; on top of
            what a format knows by itself.
        first_frame: number of the first sweep in the tool's frames; see `bench.labels.frames`.

    Raises:
        UsageError: a class that is none of ours.
    """

    classes: Mapping[str, str | None] = field(default_factory=dict)
    first_frame: int = 0

    def __post_init__(self) -> None:
        for tool_class, ours in self.classes.items():
            if ours is not None and ours not in OBJECT_CLASSES:
                raise UsageError(f"class {tool_class!r}: expected one of {', '.join(OBJECT_CLASSES)}, got {ours!r}")


class LabelFormat(Protocol):
    """Translates between the files of a tool and a layer; without state.

    Attributes:
        name: as the registry knows it, for example "kitti-tracklets".
        description: one line, for the listing.
    """

    name: str
    description: str

    def read(self, source: Path, recording: Recording, options: LabelOptions) -> Layer:
        """Read a layer.

        Args:
            source: the tool's file or folder.
            recording: what was annotated; its own tracks are not looked at.
            options: what the user says about the files.

        Raises:
            DataError: not what the format asks for, frames that do not pair with the recording's, unknown classes.
        """
        ...

    def write(self, layer: Layer, recording: Recording, out: Path, options: LabelOptions) -> tuple[str, ...]:
        """Write a layer, each file whole or not at all.

        Args:
            layer: the annotations.
            recording: what they belong to.
            out: folder of this recording's files; made if missing, nothing is written outside.
            options: what the tool's files should look like.

        Returns:
            One line for each thing that the format cannot hold.

        Raises:
            DataError: frames that do not pair with the recording's.
        """
        ...


WELL_KNOWN = {
    **{name: name for name in OBJECT_CLASSES},
    **dict.fromkeys(("person", "person (sitting)", "person_sitting", "adult", "child", "people"), "pedestrian"),
    **dict.fromkeys(("bicycle", "bicyclist", "bike", "motorbike", "motorcycle", "motorcyclist", "rider"), "cyclist"),
    **dict.fromkeys(("car", "van", "truck", "bus", "tram", "train", "trailer", "caravan"), "vehicle"),
}
"""Names that need no explanation, in lower case; upper and lower case are one."""


def map_classes(
    found: Iterable[str],
    options: LabelOptions,
    *,
    source: Path,
    known: Mapping[str, str | None] | None = None,
) -> dict[str, str | None]:
    """What each of a tool's classes is for us.

    Args:
        found: the classes of a source, as it spells them.
        options: the user's own map goes first; there, too, upper and lower case are one.
        source: the tool's file or folder, for messages.
        known: what a format knows beyond `WELL_KNOWN`, in lower case.

    Returns:
        Class as found -> one of `OBJECT_CLASSES`, or None for one that the user leaves out.

    Raises:
        DataError: classes that nobody knows, all of them at once.
    """
    table: dict[str, str | None] = {**WELL_KNOWN, **(known or {})}
    table |= {name.casefold(): ours for name, ours in options.classes.items()}
    classes = sorted(set(found))
    unknown = [name for name in classes if name.casefold() not in table]
    if unknown:
        raise DataError(
            source,
            field="classes",
            expected=f"classes that can be told as {', '.join(OBJECT_CLASSES)}",
            got=", ".join(repr(name) for name in unknown),
            do=f"give each, for example --class '{unknown[0]}=vehicle', or '{unknown[0]}=none' to leave it out",
        )
    return {name: table[name.casefold()] for name in classes}


def tool_class(object_class: str, options: LabelOptions, defaults: Mapping[str, str] | None = None) -> str:
    """What a tool calls one of our classes: as the user says, else as the format does.

    Args:
        object_class: one of `OBJECT_CLASSES`.
        options: the first class that the user maps to ours.
        defaults: ours -> the tool's; None where the tool takes any name, and so ours.
    """
    default = object_class if defaults is None else defaults[object_class]
    return next((name for name, ours in options.classes.items() if ours == object_class), default)


def left_out(classes: Mapping[str, str | None], counts: Mapping[str, int]) -> tuple[str, ...]:
    """One line for each class that the user leaves out.

    Args:
        classes: as `map_classes` returns them.
        counts: objects of each class in the source.
    """
    return tuple(
        f"{counts.get(name, 0)} objects of class {name!r}, left out as asked"
        for name, ours in classes.items()
        if ours is None
    )


LARGEST_M = 1e8  # coordinates of any map are below


class ToolModel(FileModel):
    """Part of a file of another tool: keys that are not used are passed over."""

    model_config = ConfigDict(extra="ignore")


Length = Annotated[float, Field(ge=-LARGEST_M, le=LARGEST_M)]


class Vector(ToolModel):
    """Three numbers along or about x, y and z."""

    x: Length
    y: Length
    z: Length

    def numbers(self) -> tuple[float, float, float]:
        """x, y and z."""
        return self.x, self.y, self.z


def finite_number(value: object) -> float | None:
    """A number of a file as float; None for anything else, also NaN, infinity and what float cannot hold."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


ENTRY_POINTS = "fisheye_bench.labels"

LABEL_FORMATS = {
    "openlabel": "bench.labels.openlabel_format:OpenLabelFormat",
    "kitti-tracklets": "bench.labels.kitti_tracklets:KittiTracklets",
    "cvat-tracklets": "bench.labels.kitti_tracklets:CvatTracklets",
    "sustechpoints": "bench.labels.sustechpoints:SustechPoints",
    "labelcloud-centroid-abs": "bench.labels.labelcloud:LabelCloudCentroidAbs",
    "labelcloud-centroid-rel": "bench.labels.labelcloud:LabelCloudCentroidRel",
    "labelcloud-vertices": "bench.labels.labelcloud:LabelCloudVertices",
    "semantickitti": "bench.labels.semantickitti:SemanticKitti",
}


def known_formats() -> dict[str, str]:
    """Name -> "module:Class" of the package's formats and of those that installed packages add."""
    return known_places(ENTRY_POINTS, LABEL_FORMATS)


def label_format(name: str) -> LabelFormat:
    """A format of labels.

    Raises:
        UnknownNameError: no such format.
        UsageError: nothing to import where an installed package says that it is.
    """
    known = known_formats()
    if name not in known:
        raise UnknownNameError("format of annotations", name, known)
    found: LabelFormat = imported(known[name], expected=f"format {name!r}: expected a class")()
    return found
