"""A tool's classes <-> ours."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from bench.errors import DataError
from bench.layers.layer import LayerOptions
from bench.recordings import OBJECT_CLASSES

WELL_KNOWN = {
    **{name: name for name in OBJECT_CLASSES},
    **dict.fromkeys(("person", "person (sitting)", "person_sitting", "adult", "child", "people"), "pedestrian"),
    **dict.fromkeys(("bicycle", "bicyclist", "bike", "motorbike", "motorcycle", "motorcyclist", "rider"), "cyclist"),
    **dict.fromkeys(("car", "van", "truck", "bus", "tram", "train", "trailer", "caravan"), "vehicle"),
}
"""Names that need no explanation, in lower case; upper and lower case are one."""


def map_classes(
    found: Iterable[str],
    options: LayerOptions,
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


def tool_class(object_class: str, options: LayerOptions, defaults: Mapping[str, str] | None = None) -> str:
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
