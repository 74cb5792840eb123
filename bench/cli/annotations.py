"""`annotations`: label formats of other tools: list, import, export."""

from __future__ import annotations

import os
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli.console import say, show, write_out
from bench.cli.options import group
from bench.errors import UnknownNameError, UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from bench.labels import LabelSet
    from bench.recordings import DatasetCard, Recording

LEFT_OUT = "none"
DEFAULT_FOLDER = Path("annotations")

app = group("Bring annotations of other tools into annotations/, and back.")

FormatName = Annotated[str, typer.Argument(metavar="FORMAT", help="A format; see `annotations formats`.")]
Card = Annotated[str, typer.Option("--dataset", help="A data-set card: its path, or a name that `datasets` lists.")]
ClassPairs = Annotated[
    list[str] | None,
    typer.Option(
        "--class", metavar="TOOL=OURS", help="What a class of the tool is for us; none leaves it out; repeatable."
    ),
]
FirstFrame = Annotated[int, typer.Option(help="Number of the first sweep in the tool's frames.")]


@app.command("formats")
def formats() -> None:
    """List the formats that can be imported and exported."""
    from bench.labels import known_formats, label_format
    from bench.reporting.document import Table

    rows = []
    for name, place in known_formats().items():
        try:
            about = label_format(name).description
        except UsageError as error:  # of another package; the list of the others is still wanted
            about = str(error)
        rows.append([name, about if place.startswith("bench.") else f"{about} ({place})"])
    show([Table(columns=["name", "what it is"], rows=rows, words=2)])


@app.command("import")
def import_(
    format_: FormatName,
    source: Annotated[Path, typer.Argument(help="The tool's file or folder.")],
    dataset: Card,
    recording: Annotated[str, typer.Option(help="Name of the recording.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder of annotation files; default: the card's, or annotations/<data set>.")
    ] = None,
    class_: ClassPairs = None,
    first_frame: FirstFrame = 0,
) -> None:
    """Write a tool's annotations as <recording>.json; say what was read and what was lost."""
    from bench.labels import LabelOptions, import_labels, label_format, open_unannotated
    from bench.recordings import load_card

    options = LabelOptions(classes=parse_classes(class_ or []), first_frame=first_frame)
    label_format(format_)  # an unknown name is told before anything is opened
    card = load_card(dataset)
    file = (out or card.annotations or DEFAULT_FOLDER / card.name) / f"{recording}.json"
    opened = open_unannotated(card, recording)
    label_set = import_labels(format_, source, opened, options, file=file)
    _print_label_set(label_set, opened)
    _print_lost(label_set.lost)
    say(str(file))
    if not _stands_in(card, file.parent):
        folder = os.path.relpath(file.parent.resolve(), card.file.parent.resolve())  # as a card counts paths
        say(f"to use it, give the card {card.file} this line: annotations: {folder}")


@app.command("export")
def export(
    format_: FormatName,
    dataset: Card,
    out: Annotated[Path, typer.Option(help="Folder; each recording gets one in it.")],
    recording: Annotated[str | None, typer.Option(help="Name of the recording; default: all.")] = None,
    class_: ClassPairs = None,
    first_frame: FirstFrame = 0,
) -> None:
    """Write annotations as a tool's files; say what it cannot hold."""
    from bench.labels import LabelOptions, export_labels, label_format
    from bench.recordings import load_card, open_dataset

    options = LabelOptions(classes=parse_classes(class_ or []), first_frame=first_frame)
    label_format(format_)
    handles = {handle.name: handle for handle in open_dataset(load_card(dataset))}
    if recording is not None and recording not in handles:
        raise UnknownNameError("recording", recording, handles)
    for name in handles if recording is None else (recording,):
        opened = handles[name].open()
        label_set, lost = export_labels(format_, opened, out / name, options)
        _print_label_set(label_set, opened)
        _print_lost(lost)
        say(str(out / name))


@app.command("calibration")
def calibration(
    file: Annotated[Path, typer.Argument(help="An OpenLABEL file with streams.")],
    out: Annotated[Path | None, typer.Option(help="The file; default: printed.")] = None,
) -> None:
    """Give lenses and mountings of an OpenLABEL file as `cameras` and `lidar` of a recording.json."""
    from bench.atomic import write_text
    from bench.labels import calibration_text

    text = calibration_text(file)
    if out is None:
        write_out(text)
        return
    write_text(out, text)
    say(str(out))


def parse_classes(pairs: Sequence[str]) -> dict[str, str | None]:
    """Parse `--class Tram=vehicle`; `--class Misc=none` leaves objects out.

    Raises:
        UsageError: no `=`, or a class twice.
    """
    parsed: dict[str, str | None] = {}
    for pair in pairs:
        name, equals, ours = pair.rpartition("=")
        if not (equals and name):
            raise UsageError(f"--class: expected TOOL'S=OURS, got {pair!r}")
        if name in parsed:
            raise UsageError(f"--class {name}: expected once, got twice")
        parsed[name] = None if ours == LEFT_OUT else ours
    return parsed


def _stands_in(card: DatasetCard, folder: Path) -> bool:
    return card.annotations is not None and card.annotations.resolve() == folder.resolve()


def _print_label_set(label_set: LabelSet, recording: Recording) -> None:
    states = sum(len(track.states) for track in label_set.tracks)
    annotated = len({sweep.timestamp_ns for sweep in recording.sweeps} & set(label_set.timestamps_ns))
    say(
        f"{recording.name}: {len(label_set.tracks)} objects in {states} places, "
        f"{annotated} of {len(recording.sweeps)} sweeps annotated"
    )
    counts = Counter(track.object_class for track in label_set.tracks)
    for object_class, size in _middle_sizes(label_set).items():
        say(f"  {counts.pop(object_class)} {object_class}: {size}")
    for object_class, count in counts.items():
        say(f"  {count} {object_class}")


def _middle_sizes(label_set: LabelSet) -> Mapping[str, str]:
    """Class -> length, width and height of its middle box, by which swapped axes are seen at once."""
    import numpy as np

    from bench.recordings import Cuboid

    sizes: dict[str, list[NDArray[np.float64]]] = defaultdict(list)
    for track in label_set.tracks:
        sizes[track.object_class] += [state.shape.size_m for state in track.states if isinstance(state.shape, Cuboid)]
    return {
        object_class: "the middle box is {:.2f} m long, {:.2f} m wide, {:.2f} m high".format(*np.median(found, axis=0))
        for object_class, found in sizes.items()
        if found
    }


def _print_lost(lost: Sequence[str]) -> None:
    for line in lost:
        say(f"  lost: {line}", style="yellow")
