"""`annotations`: label formats of other tools: list, import, export."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli.console import say, show, write_out
from bench.cli.options import Recording, group
from bench.errors import UsageError

if TYPE_CHECKING:
    from bench.api.annotate import ConvertedLabels

LEFT_OUT = "none"

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
    from bench.plug_ins import described
    from bench.reporting.document import Table

    rows = described(known_formats(), lambda name, _: label_format(name).description)
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
    from bench.api.annotate import import_labels
    from bench.recordings import load_card

    card = load_card(dataset)
    found = import_labels(
        format_, source, card, recording, out=out, classes=parse_classes(class_), first_frame=first_frame
    )
    _print_labels(found)
    if card.annotations is None or card.annotations.resolve() != found.place.parent.resolve():
        folder = os.path.relpath(found.place.parent.resolve(), card.file.parent.resolve())  # as a card counts paths
        say(f"to use it, give the card {card.file} this line: annotations: {folder}")


@app.command("export")
def export(
    format_: FormatName,
    dataset: Card,
    out: Annotated[Path, typer.Option(help="Folder; each recording gets one in it.")],
    recording: Recording = None,
    class_: ClassPairs = None,
    first_frame: FirstFrame = 0,
) -> None:
    """Write annotations as a tool's files; say what it cannot hold."""
    from bench.api.annotate import export_labels

    classes = parse_classes(class_)
    for found in export_labels(format_, dataset, out, recording=recording, classes=classes, first_frame=first_frame):
        _print_labels(found)


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


def parse_classes(pairs: Sequence[str] | None) -> dict[str, str | None]:
    """Parse `--class Tram=vehicle`; `--class Misc=none` leaves objects out.

    Raises:
        UsageError: no `=`, or a class twice.
    """
    parsed: dict[str, str | None] = {}
    for pair in pairs or ():
        name, equals, ours = pair.rpartition("=")
        if not (equals and name):
            raise UsageError(f"--class: expected TOOL'S=OURS, got {pair!r}")
        if name in parsed:
            raise UsageError(f"--class {name}: expected once, got twice")
        parsed[name] = None if ours == LEFT_OUT else ours
    return parsed


def _print_labels(found: ConvertedLabels) -> None:
    from bench.labels import describe_labels

    for line in describe_labels(found.labels, found.recording):
        say(line)
    for line in found.lost:
        say(f"  lost: {line}", style="yellow")
    say(str(found.place))
