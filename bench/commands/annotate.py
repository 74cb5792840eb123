"""`annotate`: from a raw drive, or from labels of other tools, to annotations."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from bench.commands.command import PATH, command_line, print_nothing
from bench.commands.console import print_blocks, print_failures, say
from bench.commands.options import FAILURES, Dataset, Workers, group
from bench.commands.progress import Report, progress_bar, resumable
from bench.errors import UnknownNameError, UsageError

if TYPE_CHECKING:
    import pandas as pd

    from bench.annotation.drives import ProposedDrive
    from bench.annotation.formats import LabelOptions, LabelSet
    from bench.execution import TaskExecutor
    from bench.recordings import DatasetCard, Recording, RecordingHandle

app = group("Make annotations of a drive that has none, or of labels of other tools; give them to other tools.")

Reviews = Annotated[
    str | Path | None,
    typer.Option(help="Folder of reviews; default: the card's annotations, or annotations/<data set>."),
    PATH,
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProposalScores:
    """Proposals against annotations.

    Attributes:
        table: a row for each range and group, with recall, precision, errors and false tracks; see
            `bench.annotation.proposal_scores`.
        minutes: how long the sweeps took.
        confusion: of classes; see `bench.annotation.class_confusion`.
        worst: tracks with which something is wrong; see `bench.annotation.worst_tracks`.
        files: that were written.
    """

    table: pd.DataFrame
    minutes: float
    confusion: pd.DataFrame
    worst: pd.DataFrame
    files: tuple[Path, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConvertedLabels:
    """Labels of a recording that were read from a tool's files, or written for others.

    Attributes:
        recording: that they are of.
        labels: what was read or written.
        place: file or folder that was written; None where nothing was proposed and nothing reviewed.
        lost: one line for each thing that the other side cannot hold.
        copies: of files that a person had made or changed, and that were replaced on request.
    """

    recording: Recording
    labels: LabelSet
    place: Path | None
    lost: tuple[str, ...] = ()
    copies: tuple[Path, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposals:
    """Proposals for recordings, stored as reviews.

    Attributes:
        folder: of the reviews.
        drives: each with `objects`, `doubted`, or a `failure`.
    """

    folder: Path
    drives: tuple[ProposedDrive, ...]


def propose(
    dataset: Dataset,
    *,
    split: Chosen = None,
    workers: Workers = 1,
    reviews: Reviews = None,
    progress: Report | None = None,
) -> Proposals:
    """Find what moves in drives without labels, from sweeps, ego-motion and calibration.

    Drives whose proposals are there are passed over, and decisions on them kept.

    Args:
        dataset: card, by path or by name.
        split: of the data set, or recordings with commas in between.
        workers: processes, or an executor.
        reviews: their folder.
        progress: called with the recordings done and their number.

    Raises:
        UnknownNameError: no data set or split of this name.
        OutputError: a file cannot be written.
    """
    from bench.annotation.drives import propose_drives
    from bench.commands.data import as_executor

    executor = as_executor(workers)
    card, handles, folder = open_drives(dataset, split=split, reviews=reviews, executor=executor)
    with resumable(folder), progress_bar(f"proposing objects of {card.name}", "recordings", progress) as report:
        drives = propose_drives(card.name, handles, folder, executor=executor, progress=report)
    return Proposals(folder=folder, drives=drives)


def show_proposals(proposals: Proposals) -> int:
    """Print what was found in each drive, and what failed."""
    from bench.reporting.document import Table

    rows = [
        [drive.name, drive.objects, drive.doubted, "" if drive.computed else "was there"]
        for drive in proposals.drives
        if not drive.failure
    ]
    print_blocks([Table(columns=["recording", "objects", "in doubt", ""], rows=rows)])
    say(str(proposals.folder))
    failures = [f"{drive.name}: {drive.failure}" for drive in proposals.drives if drive.failure]
    print_failures(failures, all_in="this command for one --recording")
    return FAILURES if failures else 0


def evaluate_proposals(
    dataset: Dataset,
    *,
    split: Chosen = None,
    workers: Workers = 1,
    reviews: Reviews = None,
    out: Annotated[
        str | Path | None, typer.Option(help="Folder of evaluate.html, .md and .csv files; default: none."), PATH
    ] = None,
    progress: Report | None = None,
) -> ProposalScores:
    """Compare proposals with annotations that exist: what is found and false, classes, boxes, speeds, worst tracks.

    Args:
        dataset: card, by path or by name.
        split: of the data set, or recordings with commas in between.
        workers: processes, or an executor.
        reviews: their folder.
        out: folder of the report.
        progress: called with the recordings done and their number.

    Raises:
        UnknownNameError: no data set or split of this name.
        DataError: proposals that are missing or damaged.
        UsageError: a recording without annotations.
    """
    from bench.annotation import class_confusion, proposal_scores, worst_tracks
    from bench.annotation.drives import evaluate_drives
    from bench.commands.data import as_executor
    from bench.reporting.proposal_scores import write_proposal_scores

    executor = as_executor(workers)
    card, handles, folder = open_drives(dataset, split=split, reviews=reviews, executor=executor)
    with progress_bar(f"evaluating proposals of {card.name}", "recordings", progress) as report:
        frames, minutes = evaluate_drives(handles, folder, executor=executor, progress=report)
    table, confusion, worst = proposal_scores(frames, minutes=minutes), class_confusion(frames), worst_tracks(frames)
    files: tuple[Path, ...] = ()
    if out is not None:
        names = [handle.name for handle in handles]
        files = write_proposal_scores(
            Path(out), table, minutes, confusion=confusion, worst=worst, dataset=card.name, recordings=names
        )
    return ProposalScores(table=table, minutes=minutes, confusion=confusion, worst=worst, files=files)


def show_scores(scores: ProposalScores) -> None:
    """Print the tables and the files."""
    from bench.reporting.proposal_scores import scores_tables

    print_blocks(scores_tables(scores.table, scores.minutes, scores.confusion, scores.worst))
    for file in scores.files:
        say(str(file))


def import_labels(
    format_name: str,
    source: str | Path,
    dataset: str | Path | DatasetCard,
    recording: str,
    *,
    out: str | Path | None = None,
    options: LabelOptions | None = None,
    overwrite: bool = False,
) -> ConvertedLabels:
    """Write a tool's labels as the annotations of a recording.

    Args:
        format_name: of the tool's files, such as "boxes".
        source: the tool's file or folder.
        dataset: card, by path or name.
        recording: name.
        out: folder of annotation files; None for the card's annotations, or `annotations/<data set>`.
        options: what the files do not say of classes, frames and times.
        overwrite: replace annotations that a person made or changed, and keep a copy of them.

    Raises:
        UnknownNameError: no such format, data set or recording.
        DataError: files that the format refuses, an object of two classes, or twice at one time.
        OutputError: annotations that a person made or changed are there, or they cannot be written.
    """
    from bench.annotation.formats import LabelOptions, label_format
    from bench.annotation.formats import import_labels as read_labels
    from bench.annotation.stored_labels import store_labels
    from bench.commands.data import as_card
    from bench.recordings.writing import annotation_text

    label_format(format_name)  # an unknown name is told before anything is opened
    card = as_card(dataset)
    folder, opened = annotations_folder(card, out), open_unannotated(card, recording)
    labels = read_labels(format_name, Path(source), opened, options or LabelOptions())
    file = folder / f"{recording}.json"
    text = annotation_text(file, labels.tracks, timestamps_ns=labels.timestamps_ns)
    copies = store_labels(folder, {file.name: text.encode()}, overwrite=overwrite)
    return ConvertedLabels(recording=opened, labels=labels, place=file, lost=labels.lost, copies=copies)


def export_labels(
    dataset: str | Path | DatasetCard,
    out: str | Path,
    *,
    format_name: str | None = None,
    annotated: bool = False,
    split: str | None = None,
    reviews: str | Path | None = None,
    unreviewed: bool = False,
    options: LabelOptions | None = None,
    overwrite: bool = False,
) -> tuple[ConvertedLabels, ...]:
    """Write accepted tracks, or annotations; of all drives, or of none.

    Args:
        dataset: as of `propose`.
        out: folder of the annotation files, <recording>.json; of a tool's files, each recording gets a folder in it.
        format_name: of a tool's files; None for annotation files.
        annotated: write the annotations of the data set instead of reviews; asks for a format.
        split: as of `propose`.
        reviews: as of `propose`.
        unreviewed: write what was proposed and not rejected instead; whatever uses it says so.
        options: classes as the tool calls them, and the number of its first frame.
        overwrite: replace labels that a person made or changed, and keep a copy of them.

    Raises:
        UnknownNameError: no data set, split or format of this name.
        UsageError: annotations without a format, or a format that is only read.
        DataError: a review is missing, damaged or of another drive, or leaves something undecided or not watched.
        OutputError: labels that a person made or changed are there, or they cannot be written.
    """
    from bench.annotation.formats import LabelOptions, LabelSet, writable_format
    from bench.annotation.formats import export_labels as write_labels
    from bench.annotation.stored_labels import store_labels
    from bench.recordings.writing import annotation_text

    if format_name is not None:
        writable_format(format_name)  # an unknown name is told before anything is opened
    elif annotated:
        raise UsageError("annotated: expected a format to write annotations in, got none; name one with --format")
    card, handles, folder = open_drives(dataset, split=split, reviews=reviews)
    files: dict[str, bytes] = {}
    written = []
    for handle in handles:
        recording = handle.open() if annotated else _reviewed(card, handle.name, folder, unreviewed=unreviewed)
        lost: tuple[str, ...] = ()
        place: Path | None = Path(out) / handle.name
        labels = LabelSet(tracks=recording.tracks, timestamps_ns=tuple(s.timestamp_ns for s in recording.sweeps))
        if unreviewed and not recording.tracks:
            place = None
        elif format_name is None:
            place = Path(out) / f"{handle.name}.json"
            text = annotation_text(place, labels.tracks, timestamps_ns=labels.timestamps_ns)
            files[place.name] = text.encode()
        else:
            labels, of_tool, lost = write_labels(format_name, recording, options or LabelOptions())
            files |= {f"{handle.name}/{name}": content for name, content in of_tool.items()}
        written.append(ConvertedLabels(recording=recording, labels=labels, place=place, lost=lost))
    copies = store_labels(Path(out), files, overwrite=overwrite) if files else ()
    return tuple(
        replace(drive, copies=tuple(c for c in copies if drive.place in (c.parent, c.with_suffix(""))))
        for drive in written
    )


def open_unannotated(card: DatasetCard, name: str) -> Recording:
    """Open a recording without its annotations, which may be missing, old or wrong.

    Args:
        card: the data set.
        name: of the recording.

    Raises:
        UnknownNameError: no such recording.
        DataError: the data set cannot be opened, or takes no annotations.
    """
    from bench.recordings import open_dataset, write_annotations

    with TemporaryDirectory() as folder:
        blank = replace(card, content=card.content.model_copy(update={"annotations": folder}))
        handles = {handle.name: handle for handle in open_dataset(blank)}
        if name not in handles:
            raise UnknownNameError("recording", name, handles)
        write_annotations(Path(folder) / f"{name}.json", ())
        return handles[name].open()


def open_drives(
    dataset: str | Path | DatasetCard,
    *,
    split: str | None = None,
    reviews: str | Path | None = None,
    executor: TaskExecutor | None = None,
) -> tuple[DatasetCard, tuple[RecordingHandle, ...], Path]:
    """The card of a data set, its recordings, rendered where they are missing, and the folder of their reviews."""
    from bench.commands.data import rendered_card
    from bench.recordings import open_dataset

    card = rendered_card(dataset, split, executor=executor)
    return card, open_dataset(card, split), annotations_folder(card, reviews)


def annotations_folder(card: DatasetCard, folder: str | Path | None = None) -> Path:
    """The folder of reviews and annotations that is named, else the card's, else one below the working folder."""
    return Path(folder) if folder is not None else card.annotations or Path("annotations") / card.name


def _reviewed(card: DatasetCard, name: str, folder: Path, *, unreviewed: bool) -> Recording:
    """A recording with the tracks that were accepted, or those that were proposed and not rejected."""
    from bench.annotation.export import refuse_unfinished, to_tracks
    from bench.annotation.store import read_review, review_file

    file = review_file(folder, name)
    review, opened = read_review(file), open_unannotated(card, name)
    if not unreviewed:
        refuse_unfinished(review, opened, file)
    return replace(opened, tracks=to_tracks(review, opened, unreviewed=unreviewed))


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

    card, handles, folder = open_drives(dataset, split=recording, reviews=reviews)
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

    options = LabelOptions(classes=parse_classes(class_), first_frame=first_frame)
    for labels in export_labels(
        dataset,
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


app.command("propose")(command_line(propose, show_proposals))
app.command("evaluate")(command_line(evaluate_proposals, show_scores))
app.command("review")(command_line(review, print_nothing))
app.command("import")(command_line(import_, print_nothing))
app.command("export")(command_line(export, print_nothing))
