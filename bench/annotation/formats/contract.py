"""The contract of label formats: what one reads, what it writes, and what the user says about the files."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError, UsageError
from bench.recordings import OBJECT_CLASSES, ObjectState, Recording, Track

UNCLEAR = "unclear"  # in place of a class: nobody can tell what it is, so that its area is not scored
OWN_FRAMES = ("vehicle", "lidar", "world")
WELL_KNOWN: dict[str, str | None] = {  # names that need no explanation, in lower case; upper and lower case are one
    **{name: name for name in OBJECT_CLASSES},
    **dict.fromkeys(("person", "person (sitting)", "person_sitting", "adult", "child", "people"), "pedestrian"),
    **dict.fromkeys(("bicycle", "bicyclist", "bike", "motorbike", "motorcycle", "motorcyclist", "rider"), "cyclist"),
    **dict.fromkeys(
        ("car", "van", "truck", "bus", "tram", "train", "trailer", "caravan", "on-rails", "other-vehicle"), "vehicle"
    ),
    **dict.fromkeys(("dontcare", "don't care", "dont_care", "ignore"), UNCLEAR),
}
CLASS_HINTS = {  # whole words of names, for proposals; the first that fits
    "none": ("ego", "egocar", "stop", "sign", "lane", "cone", "barrier"),
    "cyclist": ("cyclist", "bicyclist", "motorcyclist", "bicycle", "motorcycle", "bike", "motorbike", "rider"),
    "pedestrian": ("pedestrian", "person", "people", "human", "adult", "child", "walker"),
    "vehicle": ("vehicle", "car", "truck", "lorry", "bus", "van", "tram", "trailer"),
    "animal": ("animal", "dog", "deer", "horse", "cat"),
}
SHOWN_HINTS = 6
Files = dict[str, bytes]  # name -> content


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Observation:
    """An object at one time, as a tool's files have it.

    Attributes:
        track: the object's id; empty where the files have none.
        label: the tool's class.
        state: in the vehicle frame; without velocity where the files have none.
        middle_m: (3,) float64, m, world frame, mean of the object's points; None for shapes, NaN without ego-motion.
        seen_ns: mean time of these points.
        instance_id: the object's number in truth images, where the files have it.
    """

    track: str
    label: str
    state: ObjectState
    middle_m: NDArray[np.float64] | None = None
    seen_ns: int = 0
    instance_id: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolLabels:
    """Content of a tool's files.

    Attributes:
        observations: of all objects at all times, in any order.
        timestamps_ns: all annotated times, also those at which the scene held nothing.
        lost: one line for each thing that was not read.
    """

    observations: tuple[Observation, ...]
    timestamps_ns: tuple[int, ...]
    lost: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LabelSet:
    """Annotations of one recording, and when the scene was annotated.

    Attributes:
        tracks: objects; their states are in the vehicle frame at each state's time.
        timestamps_ns: all annotated times, also those at which the scene held nothing, increasing.
        lost: one line for each thing that the source does not hold or that was lost in the translation.
    """

    tracks: tuple[Track, ...]
    timestamps_ns: tuple[int, ...]
    lost: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelOptions:
    """What the user says about a tool's files.

    Attributes:
        classes: the tool's class -> one of `OBJECT_CLASSES`, "unclear", or None to leave its objects out.
        frames: name of a frame in the files -> "vehicle", "lidar" or "world"; "" for boxes that name none.
        first_frame: number of the first sweep in the tool's frames, which are then counted; None for frames that are
            called as the sweeps.
        unit_ns: of times that do not say their unit.

    Raises:
        UsageError: a class or frame that is none of ours.
    """

    classes: Mapping[str, str | None] = field(default_factory=dict)
    frames: Mapping[str, str] = field(default_factory=dict)
    first_frame: int | None = None
    unit_ns: int = 1

    def __post_init__(self) -> None:
        for kind, given, known in (
            ("class", self.classes, (*OBJECT_CLASSES, UNCLEAR, None)),
            ("frame", self.frames, OWN_FRAMES),
        ):
            for name, ours in given.items():
                if ours not in known:
                    named = ", ".join(filter(None, known))
                    raise UsageError(f"{kind} {name!r}: expected one of {named}, got {ours!r}")


class LabelFormat(Protocol):
    """Translates the files of a tool to observations; without state.

    Attributes:
        name: as the registry knows it, for example "openlabel".
        description: one line, for the listing.
    """

    name: str
    description: str

    def read(self, source: Path, recording: Recording, options: LabelOptions) -> ToolLabels:
        """Read labels.

        Args:
            source: the tool's file or folder.
            recording: what was annotated; its own tracks are not looked at.
            options: what the user says about the files.

        Raises:
            DataError: not what the format asks for, or frames that do not pair with the recording's.
        """
        ...


@runtime_checkable
class WritableFormat(LabelFormat, Protocol):
    """A format that can be written, too."""

    def write(self, label_set: LabelSet, recording: Recording, options: LabelOptions) -> tuple[Files, tuple[str, ...]]:
        """Return the files that hold a label set.

        Args:
            label_set: the annotations.
            recording: what they belong to.
            options: what the files should look like.

        Returns:
            files: name -> content.
            lost: one line for each thing that the format cannot hold.
        """
        ...


def map_classes(labels: Iterable[str], options: LabelOptions, *, source: Path) -> dict[str, str | None]:
    """Return our class for each of a tool's classes.

    Args:
        labels: the classes of a source, as it spells them.
        options: the user's own map goes first; there, too, upper and lower case are one.
        source: the tool's file or folder, for messages.

    Returns:
        Class as the source has it -> one of `OBJECT_CLASSES`, "unclear", or None for one that is left out.

    Raises:
        DataError: unknown classes, all at once.
    """
    table = WELL_KNOWN | {name.casefold(): ours for name, ours in options.classes.items()}
    classes = sorted(set(labels))
    unknown = [name for name in classes if name.casefold() not in table]
    if unknown:
        raise DataError(
            source,
            field="classes",
            expected=f"classes that map to one of {', '.join(OBJECT_CLASSES)}",
            got=", ".join(repr(name) for name in unknown),
            hint=_class_hint(unknown),
        )
    return {name: table[name.casefold()] for name in classes}


def _class_hint(unknown: Sequence[str]) -> str:
    """Options that map the classes, with a proposal for those with a telling name."""
    proposed = {name: _proposed_class(name) for name in unknown[:SHOWN_HINTS]}
    options = " ".join(f"--class {shlex.quote(f'{name}={ours}')}" for name, ours in proposed.items())
    more = " and so on" if len(unknown) > SHOWN_HINTS else ""
    known = f"{', '.join(OBJECT_CLASSES)}, unclear (not scored there), or none to leave the objects out"
    asked = f"; CLASS is one of {known}" if "CLASS" in proposed.values() or more else ""
    return f"map each of them: {options}{more}{asked}"


def _proposed_class(name: str) -> str:
    words = {word.casefold() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)}
    return next((ours for ours, known in CLASS_HINTS.items() if words & set(known)), "CLASS")


def tool_class(object_class: str, options: LabelOptions, defaults: Mapping[str, str] | None = None) -> str:
    """Return a tool's name for one of our classes: as the user says, else as the format does.

    Args:
        object_class: one of `OBJECT_CLASSES`.
        options: the first class that the user maps to ours.
        defaults: ours -> the tool's; None where the tool takes any name, and so ours.
    """
    default = object_class if defaults is None else defaults[object_class]
    return next((name for name, ours in options.classes.items() if ours == object_class), default)
