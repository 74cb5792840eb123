"""`annotate`: from a raw drive, or from labels of other tools, to annotations."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from bench.cli.console import print_failures, say, show
from bench.cli.options import FAILURES, Dataset, Workers, group
from bench.cli.progress import progress_bar, resumable
from bench.errors import UsageError

if TYPE_CHECKING:
    from bench.api.annotate import ConvertedLabels

app = group("Make annotations of a drive that has none, or of labels of other tools; give them to other tools.")

Reviews = Annotated[
    Path | None,
    typer.Option(help="Folder of reviews; default: the card's annotations, or annotations/<data set>."),
]
FORMATS = "boxes, openlabel, cvat, kitti-tracklets or semantickitti"
LEFT_OUT = "none"
TimeUnit = Literal["ns", "us", "ms", "s"]
UNITS_NS = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000}
ClassPairs = Annotated[
    list[str] | None,
    typer.Option(
        "--class",
        metavar="TOOL=OURS",
        help="What a class of the tool is for us; unclear is not scored, none leaves it out; repeatable.",
    ),
]
FirstFrame = Annotated[
    int | None, typer.Option(help="Frames are counted, and this is the first sweep's number; default: by their names.")
]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace labels that a person made or changed; a copy of them stays.")
]
Chosen = Annotated[str | None, typer.Option("--recording", help="Recordings with commas in between; default: all.")]


@app.command("propose")
def propose(dataset: Dataset, recording: Chosen = None, workers: Workers = None, reviews: Reviews = None) -> None:
    """Find what moves in drives without labels, from sweeps, ego-motion and calibration.

    Drives whose proposals are there are passed over, and decisions on them kept.
    """
    from bench.api.annotate import annotations_folder, propose
    from bench.cli.request import rendered_card, worker_processes
    from bench.reporting.document import Table

    card = rendered_card(dataset, recording)
    folder, executor = annotations_folder(card, reviews), worker_processes(workers)
    with resumable(folder), progress_bar(f"proposing objects of {card.name}", "recordings") as progress:
        drives = propose(card, split=recording, reviews=folder, workers=executor, progress=progress)
    found = [drive for drive in drives if not drive.failure]
    rows = [[one.name, one.objects, one.doubted, "" if one.computed else "was there"] for one in found]
    show([Table(columns=["recording", "objects", "in doubt", ""], rows=rows)])
    say(str(folder))
    if failures := [f"{drive.name}: {drive.failure}" for drive in drives if drive.failure]:
        print_failures(failures, all_in="this command for one --recording")
        raise typer.Exit(FAILURES)


@app.command("evaluate")
def evaluate(
    dataset: Dataset,
    recording: Chosen = None,
    workers: Workers = None,
    reviews: Reviews = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of evaluate.html, .md and .csv files; default: none.")
    ] = None,
) -> None:
    """Compare proposals with annotations that exist: what is found and false, classes, boxes, speeds, worst tracks."""
    from bench.api.annotate import evaluate_proposals
    from bench.cli.request import rendered_card, worker_processes
    from bench.reporting.proposal_scores import scores_tables

    card, executor = rendered_card(dataset, recording), worker_processes(workers)
    with progress_bar(f"evaluating proposals of {card.name}", "recordings") as progress:
        scores = evaluate_proposals(
            card, split=recording, reviews=reviews, out=out, workers=executor, progress=progress
        )
    show(scores_tables(scores.table, scores.minutes, scores.confusion, scores.worst))
    for file in scores.files:
        say(str(file))


@app.command("review")
def review(
    dataset: Dataset,
    recording: Chosen = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="To listen on; 0 for any that is free.")] = 0,
    reviews: Reviews = None,
    reviewer: Annotated[str, typer.Option(envvar="USER", help="Who decides, for the log of decisions.")] = "reviewer",
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.")] = True,
) -> None:
    """Look at proposals in a page of this machine: accept, reject, correct, draw; ends with Ctrl-C.

    Every decision is stored when it is made. Nothing leaves the machine.
    """
    import webbrowser

    from bench.annotation.server import ReviewServer
    from bench.annotation.session import Session
    from bench.api.annotate import open_drives, open_unannotated
    from bench.cli.request import rendered_card

    card, handles, folder = open_drives(rendered_card(dataset, recording), split=recording, reviews=reviews)
    names = [handle.name for handle in handles]

    def open_session(name: str) -> Session:
        return Session(open_unannotated(card, name), dataset=card.name, folder=folder, reviewer=reviewer)

    with ReviewServer(names, open_session, port=port) as server:
        say(f"reviews: {folder}")
        say(f"open {server.url} in a browser; end with Ctrl-C")
        if browser:
            webbrowser.open(server.url)
        try:
            server.serve_forever(poll_interval=0.1)
        except KeyboardInterrupt:
            say("ended; every decision is stored")


@app.command("import")
def import_(
    format_: Annotated[str, typer.Argument(metavar="FORMAT", help=f"Of the tool's files: {FORMATS}.")],
    source: Annotated[Path, typer.Argument(help="The tool's file or folder.")],
    dataset: Annotated[str, typer.Option(help="A data-set card: its path, or a name, see `list datasets`.")],
    recording: Annotated[str, typer.Option(help="Name of the recording.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder of annotation files; default: the card's, or annotations/<data set>.")
    ] = None,
    class_: ClassPairs = None,
    frame: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TOOL=OURS",
            help="Which frame of ours a frame of the tool is: vehicle, lidar or world; without TOOL= that of boxes "
            "that name none; repeatable.",
        ),
    ] = None,
    first_frame: FirstFrame = None,
    time_unit: Annotated[TimeUnit, typer.Option(help="Of times that do not say their unit.")] = "ns",
    overwrite: Overwrite = False,
) -> None:
    """Write a tool's labels as <recording>.json; say what was read and what was lost."""
    from bench.annotation.formats import LabelOptions
    from bench.api.annotate import import_labels
    from bench.recordings import load_card

    card = load_card(dataset)
    frames = dict(_named(pair if "=" in pair else f"={pair}", "--frame") for pair in frame or ())
    options = LabelOptions(
        classes=parse_classes(class_), frames=frames, first_frame=first_frame, unit_ns=UNITS_NS[time_unit]
    )
    labels = import_labels(format_, source, card, recording, out=out, options=options, overwrite=overwrite)
    _print_labels(labels)
    assert labels.place is not None
    if card.annotations is None or card.annotations.resolve() != labels.place.parent.resolve():
        folder = os.path.relpath(labels.place.parent.resolve(), card.file.parent.resolve())  # as a card counts paths
        also = ", in place of `annotated: none`" if card.content.annotated == "none" else ""
        say(f"to use it, give the card {card.file} this line: annotations: {folder}{also}")


@app.command("export")
def export(
    dataset: Dataset,
    out: Annotated[Path, typer.Option(help="Folder of <recording>.json; of a format, each recording gets a folder.")],
    recording: Chosen = None,
    reviews: Reviews = None,
    unreviewed: Annotated[
        bool, typer.Option("--unreviewed", help="Write what was proposed and not rejected; whatever uses it says so.")
    ] = False,
    format_: Annotated[
        str | None, typer.Option("--format", help="Write files of a tool instead: boxes, openlabel or cvat.")
    ] = None,
    annotated: Annotated[
        bool, typer.Option("--annotated", help="With --format: write the annotations of the data set, not reviews.")
    ] = False,
    class_: ClassPairs = None,
    first_frame: FirstFrame = None,
    overwrite: Overwrite = False,
) -> None:
    """Write accepted tracks as annotations; refuse drives of which something is undecided or not watched."""
    from bench.annotation.formats import LabelOptions
    from bench.api.annotate import export_labels
    from bench.cli.request import rendered_card

    options = LabelOptions(classes=parse_classes(class_), first_frame=first_frame)
    for labels in export_labels(
        rendered_card(dataset, recording),
        out,
        format_name=format_,
        annotated=annotated,
        split=recording,
        reviews=reviews,
        unreviewed=unreviewed,
        options=options,
        overwrite=overwrite,
    ):
        if labels.place is None:
            nothing = "nothing was proposed, and nobody has looked: no annotations are written"
            say(f"{labels.recording.name}: {nothing}", style="yellow")
        else:
            _print_labels(labels)
    if format_ is None:
        say(f"To score by them, the card says where they are, `annotations: {out}`, and no longer `annotated: none`.")


def parse_classes(pairs: Sequence[str] | None) -> dict[str, str | None]:
    """Parse `--class Tram=vehicle`; `--class Misc=none` leaves objects out.

    Raises:
        UsageError: no `=`, or a class twice.
    """
    parsed: dict[str, str | None] = {}
    for name, ours in (_named(pair, "--class") for pair in pairs or ()):
        if not name:
            raise UsageError(f"--class: expected TOOL'S=OURS, got {f'={ours}'!r}")
        if name in parsed:
            raise UsageError(f"--class {name}: expected once, got twice")
        parsed[name] = None if ours == LEFT_OUT else ours
    return parsed


def _named(pair: str, option: str) -> tuple[str, str]:
    name, equals, ours = pair.rpartition("=")
    if not equals:
        raise UsageError(f"{option}: expected TOOL'S=OURS, got {pair!r}")
    return name, ours


def _print_labels(written: ConvertedLabels) -> None:
    """Print a label set: its objects and sweeps, and each class with its middle box, which shows swapped axes."""
    import numpy as np

    from bench.recordings import Cuboid

    labels, recording = written.labels, written.recording
    states = [(track.object_class, state.shape) for track in labels.tracks for state in track.states]
    annotated = len({sweep.timestamp_ns for sweep in recording.sweeps} & set(labels.timestamps_ns))
    objects = f"{recording.name}: {len(labels.tracks)} objects in {len(states)} places"
    say(f"{objects}, {annotated} of {len(recording.sweeps)} sweeps annotated")
    for object_class in dict.fromkeys(track.object_class for track in labels.tracks):
        sizes_m = [shape.size_m for name, shape in states if name == object_class and isinstance(shape, Cuboid)]
        middle = ": the middle box is {:.2f} m long, {:.2f} m wide, {:.2f} m high"
        size = middle.format(*np.median(sizes_m, axis=0)) if sizes_m else ""
        say(f"  {sum(track.object_class == object_class for track in labels.tracks)} {object_class}{size}")
    for line in written.lost:
        say(f"  lost: {line}", style="yellow")
    for copy in written.copies:
        say(f"  what was there is kept as {copy}", style="yellow")
    say(str(written.place))
