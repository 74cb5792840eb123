"""`annotate`: from a raw drive, or from labels of other tools, to annotations."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from bench.commands.command import TEXT, Flag, Place, Words, add_command, group
from bench.commands.console import FAILURES, Report, print_blocks, print_failures, progress_bar, resumable, say
from bench.commands.options import Dataset, Split, Workers, as_card, as_executor, rendered_card
from bench.errors import UnknownNameError, UsageError
from bench.plain_text import counted

if TYPE_CHECKING:
    import pandas as pd

    from bench.annotation.drives import ProposedDrive
    from bench.annotation.formats.conversion import LabelSet
    from bench.execution import TaskExecutor
    from bench.recordings import DatasetCard, Recording, RecordingHandle

app = group("Propose and review moving objects in drives without labels; convert labels of other tools.")

FORMATS = "boxes, openlabel, cvat or semantickitti"
LEFT_OUT = "none"
UNITS_NS = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000}


def _pairs(option: str, *, name_may_lack: bool = False) -> Words:
    """TOOL=OURS of an option that may be repeated; OURS is None where it is "none"."""

    def parse(texts: list[str] | None) -> dict[str, str | None]:
        pairs = [text.rpartition("=") for text in texts or ()]
        for name, _, ours in pairs:
            if not (name or name_may_lack):
                raise UsageError(f"{option}: expected TOOL'S=OURS, got {ours!r}")
        return {name: None if ours == LEFT_OUT else ours for name, _, ours in pairs}

    return Words(list[str] | None, parse)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProposalScores:
    """Proposals against annotations.

    Attributes:
        table: a row for each range and group, with recall, precision, errors and false tracks; see
            `bench.annotation.proposal_scores`.
        minutes: how long the sweeps took.
        worst: tracks with which something is wrong; see `bench.annotation.worst_tracks`.
        files: that were written.
    """

    table: pd.DataFrame
    minutes: float
    worst: pd.DataFrame
    files: tuple[Path, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConvertedLabels:
    """Labels of a recording that were read from a tool's files, or written for others.

    Attributes:
        card: the data set.
        recording: that they are of.
        labels: what was read or written, and what the other side cannot hold.
        place: file or folder that was written; None where nothing was proposed and nothing reviewed.
        copies: of files of another content that were replaced on request.
    """

    card: DatasetCard
    recording: Recording
    labels: LabelSet
    place: Path | None
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
    split: Split = None,
    workers: Workers = 1,
    reviews: Place = None,
    progress: Report | None = None,
) -> Proposals:
    """Propose moving objects in drives without labels, from sweeps, ego-motion and calibration.

    Drives with up-to-date proposals are skipped; decisions are kept.

    Args:
        dataset: card, by path or by name.
        split: of the data set, or recordings with commas in between.
        workers: processes, or an executor.
        reviews: folder of reviews; default: the card's annotations, or annotations/<data set>.
        progress: called with the recordings done and their number.

    Raises:
        UnknownNameError: no data set or split of this name.
        OutputError: a file cannot be written.

    Examples:
        fisheye-bench annotate propose my-data
    """
    from bench.annotation.drives import propose_drives

    executor = as_executor(workers)
    card, handles, folder = _open_drives(dataset, split, reviews, executor)
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
    print_failures(failures, all_in="this command with --split RECORDING")
    return FAILURES if failures else 0


def evaluate_proposals(
    dataset: Dataset,
    *,
    split: Split = None,
    workers: Workers = 1,
    reviews: Place = None,
    against: Place = None,
    merged: Place = None,
    out: Place = None,
    progress: Report | None = None,
) -> ProposalScores:
    """Compare proposals with existing annotations: recall, false tracks, classes, boxes, speeds, worst tracks.

    Args:
        dataset: card, by path or by name.
        split: of the data set, or recordings with commas in between.
        workers: processes, or an executor.
        reviews: folder of reviews; default: the card's annotations, or annotations/<data set>.
        against: another reviewer's folder of reviews, to compare with in place of the annotations.
        merged: with --against: folder of both reviews as one; where they differ, tracks are undecided.
        out: folder of evaluate.html, .md and .csv files; default: none.
        progress: called with the recordings done and their number.

    Raises:
        UnknownNameError: no data set or split of this name.
        DataError: proposals that are missing or damaged.
        UsageError: a recording without annotations, or `merged` without `against`.
        OutputError: a file cannot be written, or a merged review is there already.

    Examples:
        fisheye-bench annotate evaluate demo --out my-evaluation
    """
    from bench.annotation.drives import evaluate_drives, merge_drives
    from bench.annotation.evaluate import proposal_scores, worst_tracks
    from bench.reporting.findings import write_proposal_scores

    if merged is not None and against is None:
        raise UsageError("merged: expected a second reviewer's folder, got none; name it with --against")
    other = None if against is None else Path(against)
    executor = as_executor(workers)
    card, handles, folder = _open_drives(dataset, split, reviews, executor)
    with progress_bar(f"evaluating proposals of {card.name}", "recordings", progress) as report:
        frames, minutes = evaluate_drives(handles, folder, against=other, executor=executor, progress=report)
    table, worst = proposal_scores(frames, minutes=minutes), worst_tracks(frames)
    names, files = [handle.name for handle in handles], list[Path]()
    if other is not None and merged is not None:
        files += merge_drives(names, folder, other, Path(merged))
    if out is not None:
        files += write_proposal_scores(Path(out), table, minutes, worst=worst, dataset=card.name, recordings=names)
    return ProposalScores(table=table, minutes=minutes, worst=worst, files=tuple(files))


def show_scores(scores: ProposalScores) -> None:
    """Print the tables and the files."""
    from bench.reporting.findings import scores_tables

    print_blocks(scores_tables(scores.table, scores.minutes, scores.worst))
    for file in scores.files:
        say(str(file))


def import_labels(
    format_name: Annotated[str, typer.Argument(metavar="FORMAT", help=f"Format of the files: {FORMATS}.")],
    source: Annotated[str | Path, typer.Argument(), Words(Path)],
    dataset: Annotated[
        str | Path | DatasetCard, typer.Option(help="Data-set card: a path, or a name of `list datasets`."), TEXT
    ],
    recording: Annotated[str, typer.Option()],
    *,
    out: Place = None,
    classes: Annotated[
        Mapping[str, str | None] | None, typer.Option("--class", metavar="TOOL=OURS"), _pairs("--class")
    ] = None,
    frames: Annotated[
        Mapping[str, str] | None, typer.Option("--frame", metavar="TOOL=OURS"), _pairs("--frame", name_may_lack=True)
    ] = None,
    first_frame: Annotated[int | None, typer.Option()] = None,
    time_unit: Annotated[Literal["ns", "us", "ms", "s"], typer.Option()] = "ns",
    overwrite: Flag = False,
) -> ConvertedLabels:
    """Convert a tool's labels to <recording>.json; list what was read and what was lost.

    Args:
        format_name: of the tool's files, such as "boxes".
        source: file or folder of the tool.
        dataset: card, by path or name.
        recording: name of the recording.
        out: folder of annotation files; default: the card's, or annotations/<data set>.
        classes: map a class of the tool to ours; =unclear leaves it unscored, =none (from Python None) drops it;
            repeatable.
        frames: map a coordinate system of the tool to vehicle, lidar or world; without TOOL= (from Python "") for boxes
            that name none; repeatable.
        first_frame: number of the first sweep, where frames are counted; default: frames are named as sweeps.
        time_unit: unit of times that do not state it.
        overwrite: replace other labels that are there; a copy is kept.

    Raises:
        UnknownNameError: no such format, data set or recording.
        UsageError: a class or frame that is none of ours.
        DataError: files that the format refuses, an object of two classes, or twice at one time.
        OutputError: other annotations are there, or they cannot be written.

    Examples:
        fisheye-bench annotate import boxes boxes.csv --dataset my-data --recording drive-1 --class Tram=vehicle
    """
    from bench.annotation.formats.conversion import LabelOptions, label_format, store_labels
    from bench.annotation.formats.conversion import import_labels as read_labels
    from bench.recordings.writing import annotation_text

    label_format(format_name)  # an unknown name is told before anything is opened
    card = as_card(dataset)
    folder, opened = _annotations_folder(card, out), open_unannotated(card, recording)
    options = LabelOptions(
        classes=classes or {}, frames=frames or {}, first_frame=first_frame, unit_ns=UNITS_NS[time_unit]
    )
    labels = read_labels(format_name, Path(source), opened, options)
    file = folder / f"{recording}.json"
    text = annotation_text(file, labels.tracks, timestamps_ns=labels.timestamps_ns)
    copies = store_labels(folder, {file.name: text.encode()}, overwrite=overwrite)
    return ConvertedLabels(card=card, recording=opened, labels=labels, place=file, copies=copies)


def export_labels(
    dataset: Dataset,
    out: Annotated[str | Path, typer.Option(), Words(Path)],
    *,
    split: Split = None,
    reviews: Place = None,
    unreviewed: Flag = False,
    format_name: Annotated[str | None, typer.Option("--format")] = None,
    annotated: Flag = False,
    overwrite: Flag = False,
) -> tuple[ConvertedLabels, ...]:
    """Write accepted tracks as annotations; refuse drives with undecided tracks or unwatched sweeps.

    Args:
        dataset: as of `propose`.
        out: folder of <recording>.json; with --format, a folder per recording.
        split: as of `propose`.
        reviews: folder of reviews; default: the card's annotations, or annotations/<data set>.
        unreviewed: write what was proposed and not rejected; results then say so.
        format_name: write files of a tool instead: boxes or openlabel.
        annotated: with --format: write the annotations of the data set instead of reviews.
        overwrite: replace other labels that are there; a copy is kept.

    Raises:
        UnknownNameError: no data set, split or format of this name.
        UsageError: annotations without a format, or a format that is only read.
        DataError: a review is missing, damaged or of another drive, or leaves something undecided or not watched.
        OutputError: other labels are there, or they cannot be written.

    Examples:
        fisheye-bench annotate export my-data --out annotations/my-data
        fisheye-bench annotate export my-data --out labels --format boxes --annotated
    """
    from bench.annotation.formats.conversion import LabelSet, label_format, store_labels
    from bench.recordings.writing import annotation_text

    if annotated and format_name is None:
        raise UsageError("annotated: expected a format to write annotations in, got none; name one with --format")
    tool = None if format_name is None else label_format(format_name)
    card, handles, folder = _open_drives(dataset, split, reviews)
    written: list[tuple[ConvertedLabels, dict[str, bytes]]] = []
    for handle in handles:
        recording = handle.open() if annotated else _reviewed(card, handle.name, folder, unreviewed=unreviewed)
        labels = LabelSet(tracks=recording.tracks, timestamps_ns=tuple(s.timestamp_ns for s in recording.sweeps))
        place, files = None, dict[str, bytes]()
        if recording.tracks or not unreviewed:
            place = Path(out) / (handle.name if tool else f"{handle.name}.json")
            if tool is None:
                files[place.name] = annotation_text(place, labels.tracks, timestamps_ns=labels.timestamps_ns).encode()
            else:
                files, lost = tool.write(recording)
                labels = replace(labels, lost=tuple(lost))
        written.append((ConvertedLabels(card=card, recording=recording, labels=labels, place=place), files))
    return tuple(
        replace(
            drive, copies=store_labels(Path(out) / (drive.recording.name if tool else ""), files, overwrite=overwrite)
        )
        for drive, files in written
    )


def show_labels(written: ConvertedLabels | Sequence[ConvertedLabels]) -> None:
    """Print the labels of each recording, and the line of the card by which annotations are used."""
    unused = {}
    for labels in [written] if isinstance(written, ConvertedLabels) else written:
        card, place = labels.card, labels.place
        if place is None:
            nothing = "nothing was proposed, and nobody has looked: no annotations are written"
            say(f"{labels.recording.name}: {nothing}", style="yellow")
            continue
        _print_labels(labels)
        if place.suffix and (card.annotations is None or card.annotations.resolve() != place.parent.resolve()):
            folder = os.path.relpath(place.parent.resolve(), card.file.parent.resolve())  # as a card counts paths
            also = ", in place of `annotated: none`" if card.content.annotated == "none" else ""
            unused[folder] = f"to use it, give the card {card.file} this line: annotations: {folder}{also}"
    for line in unused.values():
        say(line)


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


def _open_drives(
    dataset: str | Path | DatasetCard, split: str | None, reviews: Place, executor: TaskExecutor | None = None
) -> tuple[DatasetCard, tuple[RecordingHandle, ...], Path]:
    """The card of a data set, its recordings, rendered where they are missing, and the folder of their reviews."""
    from bench.recordings import open_dataset

    card = rendered_card(dataset, split, executor=executor)
    return card, open_dataset(card, split), _annotations_folder(card, reviews)


def _annotations_folder(card: DatasetCard, folder: Place) -> Path:
    """The folder of reviews and annotations that is named, else the card's, else one below the working folder."""
    return Path(folder) if folder is not None else card.annotations or Path("annotations") / card.name


def _reviewed(card: DatasetCard, name: str, folder: Path, *, unreviewed: bool) -> Recording:
    """A recording with the tracks that were accepted, or those that were proposed and not rejected."""
    from bench.annotation.decisions import refuse_unfinished, to_tracks
    from bench.annotation.store import read_review, review_file

    file = review_file(folder, name)
    review, opened = read_review(file), open_unannotated(card, name)
    if not unreviewed:
        refuse_unfinished(review, opened, file)
    return replace(opened, tracks=to_tracks(review, opened, unreviewed=unreviewed))


def review(
    dataset: Dataset,
    split: Split = None,
    port: Annotated[int, typer.Option(min=0, max=65535)] = 0,
    reviews: Place = None,
    reviewer: Annotated[str, typer.Option(envvar="USER")] = "reviewer",
    browser: Flag = True,
) -> None:
    """Review proposals in your browser: accept, reject, correct, draw; end with Ctrl-C.

    Each decision is stored at once. Nothing leaves this machine.

    Args:
        dataset: card, by path or by name.
        split: of the data set, or recordings with commas in between.
        port: port to listen on; 0 for any free one.
        reviews: folder of reviews; default: the card's annotations, or annotations/<data set>.
        reviewer: your name in the log of decisions.
        browser: open the page in your browser.

    Examples:
        fisheye-bench annotate review my-data --split drive-1
    """
    import webbrowser

    from bench.annotation.server import ReviewServer
    from bench.annotation.session import Session

    card, handles, folder = _open_drives(dataset, split, reviews)

    def open_session(name: str) -> Session:
        return Session(open_unannotated(card, name), dataset=card.name, folder=folder, reviewer=reviewer)

    with ReviewServer([handle.name for handle in handles], open_session, port=port) as server:
        say(f"reviews: {folder}")
        say(f"open {server.url} in a browser; end with Ctrl-C")
        if browser:
            webbrowser.open(server.url)
        try:
            server.serve_forever(poll_interval=0.1)
        except KeyboardInterrupt:
            say("ended; every decision is stored")


def _print_labels(written: ConvertedLabels) -> None:
    """Print a label set: its objects and sweeps, and each class with its middle box, which shows swapped axes."""
    import numpy as np

    from bench.recordings import Cuboid

    labels, recording = written.labels, written.recording
    states = [(track.object_class, state.shape) for track in labels.tracks for state in track.states]
    annotated = len({sweep.timestamp_ns for sweep in recording.sweeps} & set(labels.timestamps_ns))
    objects = f"{counted(len(labels.tracks), 'object')} in {counted(len(states), 'place')}"
    say(f"{recording.name}: {objects}, {annotated} of {counted(len(recording.sweeps), 'sweep')} annotated")
    for object_class in dict.fromkeys(track.object_class for track in labels.tracks):
        sizes_m = [shape.size_m for name, shape in states if name == object_class and isinstance(shape, Cuboid)]
        middle = ": the middle box is {:.2f} m long, {:.2f} m wide, {:.2f} m high"
        size = middle.format(*np.median(sizes_m, axis=0)) if sizes_m else ""
        say(f"  {sum(track.object_class == object_class for track in labels.tracks)} {object_class}{size}")
    for line in labels.lost:
        say(f"  lost: {line}", style="yellow")
    for copy in written.copies:
        say(f"  what was there is kept as {copy}", style="yellow")
    say(str(written.place))


add_command(app, "propose", propose, show_proposals)
add_command(app, "evaluate", evaluate_proposals, show_scores)
add_command(app, "review", review)
add_command(app, "import", import_labels, show_labels)
add_command(app, "export", export_labels, show_labels)
