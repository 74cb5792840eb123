"""Label formats: their contract, the registered ones, and the conversion to an annotation file and back."""

from __future__ import annotations

import math
import re
import shlex
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Protocol

import numpy as np
from pydantic import ConfigDict, Field

from bench.errors import DataError, UnknownNameError, UsageError
from bench.plug_ins import imported, known_targets
from bench.recordings import OBJECT_CLASSES, Cuboid, DatasetCard, Recording, Track, open_dataset, write_annotations
from bench.recordings.validation import FileModel

WELL_KNOWN = {  # names that need no explanation, in lower case; upper and lower case are one
    **{name: name for name in OBJECT_CLASSES},
    **dict.fromkeys(("person", "person (sitting)", "person_sitting", "adult", "child", "people"), "pedestrian"),
    **dict.fromkeys(("bicycle", "bicyclist", "bike", "motorbike", "motorcycle", "motorcyclist", "rider"), "cyclist"),
    **dict.fromkeys(("car", "van", "truck", "bus", "tram", "train", "trailer", "caravan"), "vehicle"),
}
IGNORED = ({"dontcare"}, {"dont", "care"}, {"ignore"}, {"ignored"}, {"ignore", "area"}, {"ignore", "region"})
CLASS_HINTS = {  # words, for proposals; the last word of a name says what a thing is
    **dict.fromkeys(
        ("cyclist", "bicyclist", "bicycle", "cycle", "bike", "biker", "rider", "scooter", "moped"), "cyclist"
    ),
    **dict.fromkeys(("motorbike", "motorcycle", "motorcyclist"), "cyclist"),
    **dict.fromkeys(("pedestrian", "person", "people", "human", "walker", "adult", "child"), "pedestrian"),
    **dict.fromkeys(("vehicle", "car", "truck", "lorry", "bus", "van", "tram", "train", "trailer", "taxi"), "vehicle"),
    **dict.fromkeys(("suv", "pickup", "minibus", "caravan"), "vehicle"),
    **dict.fromkeys(("animal", "dog", "deer", "horse", "cat", "cow", "sheep", "bird"), "animal"),
}
SHOWN_HINTS = 6
LARGEST_M = 1e8  # coordinates of any map are below
Length = Annotated[float, Field(ge=-LARGEST_M, le=LARGEST_M)]
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
    """Options of the user about a tool's files.

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
    """Translates between the files of a tool and a label set; without state.

    Attributes:
        name: as the registry knows it, for example "kitti-tracklets".
        description: one line, for the listing.
    """

    name: str
    description: str

    def read(self, source: Path, recording: Recording, options: LabelOptions) -> LabelSet:
        """Read a label set.

        Args:
            source: the tool's file or folder.
            recording: what was annotated; its own tracks are not looked at.
            options: what the user says about the files.

        Raises:
            DataError: not what the format asks for, frames that do not pair with the recording's, unknown classes.
        """
        ...

    def write(self, label_set: LabelSet, recording: Recording, out: Path, options: LabelOptions) -> tuple[str, ...]:
        """Write a label set, each file whole or not at all.

        Args:
            label_set: the annotations.
            recording: what they belong to.
            out: folder of this recording's files; made if missing, nothing is written outside.
            options: what the tool's files should look like.

        Returns:
            One line for each thing that the format cannot hold.

        Raises:
            DataError: frames that do not pair with the recording's.
        """
        ...


def map_classes(
    found: Iterable[str], options: LabelOptions, *, source: Path, known: Mapping[str, str | None] | None = None
) -> dict[str, str | None]:
    """Return our class for each of a tool's classes.

    Args:
        found: the classes of a source, as it spells them.
        options: the user's own map goes first; there, too, upper and lower case are one.
        source: the tool's file or folder, for messages.
        known: what a format knows beyond `WELL_KNOWN`, in lower case.

    Returns:
        Class as found -> one of `OBJECT_CLASSES`, or None for one that the user leaves out.

    Raises:
        DataError: unknown classes, all at once.
    """
    table: dict[str, str | None] = {**WELL_KNOWN, **(known or {})}
    classes = sorted(set(found))
    table |= {name.casefold(): "vehicle" for name in classes if is_ignored(name)}  # of any class: the format ignores it
    table |= {name.casefold(): ours for name, ours in options.classes.items()}
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
    asked = f"; CLASS is one of {', '.join(OBJECT_CLASSES)}, or none to leave the objects out"
    return f"map each of them: {options}{more}{asked if 'CLASS' in proposed.values() or more else ''}"


def _proposed_class(name: str) -> str:
    if name.casefold().startswith("ego"):  # the vehicle that carries the sensors is no object of its own scene
        return "none"
    for part in reversed(re.split(r"[./:]", name)):  # the finest category first
        words = class_words(part)
        if words and words[-1] in CLASS_HINTS:
            return CLASS_HINTS[words[-1]]
    return "CLASS"


def class_words(name: str) -> list[str]:
    """The words of a tool's class in order, in lower case and without the s of a plural."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name)
    return [re.sub(r"(?<=..[^s])s$", "", word) for word in re.split(r"[^a-z]+", apart.lower()) if word]


def is_ignored(name: str) -> bool:
    """Return True for a tool's class of areas in which nobody looked for objects."""
    return set(class_words(name)) in IGNORED


def tool_class(object_class: str, options: LabelOptions, defaults: Mapping[str, str] | None = None) -> str:
    """Return a tool's name for one of our classes: as the user says, else as the format does.

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


class ToolModel(FileModel):
    """Part of a file of another tool: keys that are not used are passed over."""

    model_config = ConfigDict(extra="ignore")


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


def known_formats() -> dict[str, str]:
    """Name -> "module:Class" of the package's formats and of those that installed packages add."""
    return known_targets(ENTRY_POINTS, LABEL_FORMATS)


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


def describe_labels(label_set: LabelSet, recording: Recording) -> list[str]:
    """Describe a label set in lines: its objects and sweeps, and each class with its middle box.

    The length, width and height of the middle box show swapped axes at once.
    """
    states = sum(len(track.states) for track in label_set.tracks)
    annotated = len({sweep.timestamp_ns for sweep in recording.sweeps} & set(label_set.timestamps_ns))
    lines = [
        f"{recording.name}: {len(label_set.tracks)} objects in {states} places, "
        f"{annotated} of {len(recording.sweeps)} sweeps annotated"
    ]
    by_class: dict[str, list[Track]] = {}
    for track in label_set.tracks:
        by_class.setdefault(track.object_class, []).append(track)
    for object_class, tracks in by_class.items():
        shapes = [state.shape for track in tracks for state in track.states]
        sizes_m = [shape.size_m for shape in shapes if isinstance(shape, Cuboid)]
        middle = ": the middle box is {:.2f} m long, {:.2f} m wide, {:.2f} m high"
        size = middle.format(*np.median(sizes_m, axis=0)) if sizes_m else ""
        lines.append(f"  {len(tracks)} {object_class}{size}")
    return lines


def open_unannotated(card: DatasetCard, name: str) -> Recording:
    """Open a recording without its annotations, which may be missing, old or wrong.

    Args:
        card: the data set.
        name: of the recording.

    Raises:
        UnknownNameError: no such recording.
        DataError: the data set cannot be opened, or takes no annotations.
    """
    with TemporaryDirectory() as folder:
        blank = replace(card, content=card.content.model_copy(update={"annotations": folder}))
        handles = {handle.name: handle for handle in open_dataset(blank)}
        if name not in handles:
            raise UnknownNameError("recording", name, handles)
        write_annotations(Path(folder) / f"{name}.json", ())
        return handles[name].open()


def import_labels(
    format_name: str, source: Path, recording: Recording, options: LabelOptions, *, file: Path
) -> LabelSet:
    """Read a tool's files and write them as an annotation file.

    Args:
        format_name: of the tool's files.
        source: the tool's file or folder.
        recording: what was annotated.
        options: what the user says about the files.
        file: the annotation file.

    Returns:
        What was written, with one more line where sweeps have no frame.

    Raises:
        UnknownNameError: no such format.
        DataError: files that the format refuses, an object twice, or twice at one time.
    """
    label_set = label_format(format_name).read(source, recording, options)
    _refuse_twice(label_set, source)
    write_annotations(file, label_set.tracks, timestamps_ns=label_set.timestamps_ns)
    if once := sum(_is_unknown(track) for track in label_set.tracks):
        line = (
            f"{once} of {len(label_set.tracks)} objects are seen once: nothing tells their velocity, and none is scored"
        )
        label_set = replace(label_set, lost=(*label_set.lost, line))
    annotated = set(label_set.timestamps_ns)
    missing = [sweep for sweep in recording.sweeps if sweep.timestamp_ns not in annotated]
    if not missing:
        return label_set
    line = (
        f"{len(missing)} of {len(recording.sweeps)} sweeps have no frame in the source, first {missing[0].path.name}: "
        f"their images count as annotated and empty unless the card excludes them"
    )
    return replace(label_set, lost=(*label_set.lost, line))


def _is_unknown(track: Track) -> bool:
    return len(track.states) == 1 and not np.isfinite(track.states[0].velocity_mps).all()


def export_labels(
    format_name: str, recording: Recording, out: Path, options: LabelOptions
) -> tuple[LabelSet, tuple[str, ...]]:
    """Write a recording's annotations as a tool's files.

    Args:
        format_name: of the tool's files.
        recording: with its annotations; all its sweeps count as looked at.
        out: folder of the tool's files.
        options: what the files should look like.

    Returns:
        label_set: what was handed to the format.
        lost: one line for each thing that it cannot hold.

    Raises:
        UnknownNameError: no such format.
        DataError: a recording without sweeps.
    """
    chosen = label_format(format_name)
    if not recording.sweeps:
        raise DataError(recording.root, expected="lidar sweeps, which tools label", got=f"none in {recording.name!r}")
    times_ns = {sweep.timestamp_ns for sweep in recording.sweeps}
    times_ns |= {state.timestamp_ns for track in recording.tracks for state in track.states}
    label_set = LabelSet(tracks=recording.tracks, timestamps_ns=tuple(sorted(times_ns)))
    return label_set, chosen.write(label_set, recording, out, options)


def _refuse_twice(label_set: LabelSet, source: Path) -> None:
    for track_id, count in Counter(track.track_id for track in label_set.tracks).items():
        if count > 1:
            raise DataError(source, field=f"object {track_id!r}", expected="each object once", got="it twice")
    for track in label_set.tracks:
        for time_ns, count in Counter(state.timestamp_ns for state in track.states).items():
            if count > 1:
                field = f"object {track.track_id!r}"
                raise DataError(source, field=field, expected="one state at each time", got=f"two at {time_ns}")
