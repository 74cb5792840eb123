"""From a raw drive to annotations: proposals, their review, other tools' labels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from bench.annotation import class_confusion, proposal_scores, worst_tracks
from bench.annotation.drives import ProposedDrive, evaluate_drives, propose_drives
from bench.annotation.export import refuse_unfinished, to_tracks
from bench.annotation.formats import LabelOptions, LabelSet, label_format, writable_format
from bench.annotation.formats import export_labels as write_labels
from bench.annotation.formats import import_labels as read_labels
from bench.annotation.store import read_review, review_file
from bench.annotation.stored_labels import store_labels
from bench.api.datasets import as_card, as_executor, rendered_card
from bench.errors import UnknownNameError, UsageError
from bench.execution import TaskExecutor
from bench.harness.stages import Progress, no_progress
from bench.recordings import DatasetCard, Recording, RecordingHandle, open_dataset, write_annotations
from bench.recordings.writing import annotation_text
from bench.reporting.proposal_scores import write_proposal_scores

if TYPE_CHECKING:
    import pandas as pd


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


def propose(
    dataset: str | Path | DatasetCard,
    *,
    split: str | None = None,
    reviews: str | Path | None = None,
    workers: int | TaskExecutor = 1,
    progress: Progress | None = None,
) -> tuple[ProposedDrive, ...]:
    """Find what moves in drives without labels, as `fisheye-bench annotate propose` does, and store it for a review.

    Drives whose proposals are there are passed over, and decisions on them kept.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        split: of the data set, or recordings with commas in between; None for all of it.
        reviews: their folder; None for the card's annotations, or `annotations/<data set>`.
        workers: processes, or an executor.
        progress: called with the recordings done and their number.

    Returns:
        What became of each drive: `objects`, `doubted`, or a `failure`.

    Raises:
        UnknownNameError: no data set or split of this name.
        OutputError: a file cannot be written.
    """
    executor = as_executor(workers)
    card, handles, folder = open_drives(dataset, split=split, reviews=reviews, executor=executor)
    return propose_drives(card.name, handles, folder, executor=executor, progress=progress or no_progress)


def evaluate_proposals(
    dataset: str | Path | DatasetCard,
    *,
    split: str | None = None,
    reviews: str | Path | None = None,
    out: str | Path | None = None,
    workers: int | TaskExecutor = 1,
    progress: Progress | None = None,
) -> ProposalScores:
    """Compare stored proposals with annotations that exist, as `fisheye-bench annotate evaluate` does.

    Args:
        dataset: as of `propose`.
        split: as of `propose`.
        reviews: as of `propose`.
        out: folder of the report; None to write none.
        workers: processes, or an executor.
        progress: called with the recordings done and their number.

    Raises:
        UnknownNameError: no data set or split of this name.
        DataError: proposals that are missing or damaged.
        UsageError: a recording without annotations.
    """
    executor = as_executor(workers)
    card, handles, folder = open_drives(dataset, split=split, reviews=reviews, executor=executor)
    frames, minutes = evaluate_drives(handles, folder, executor=executor, progress=progress or no_progress)
    table, confusion, worst = proposal_scores(frames, minutes=minutes), class_confusion(frames), worst_tracks(frames)
    files: tuple[Path, ...] = ()
    if out is not None:
        names = [handle.name for handle in handles]
        files = write_proposal_scores(
            Path(out), table, minutes, confusion=confusion, worst=worst, dataset=card.name, recordings=names
        )
    return ProposalScores(table=table, minutes=minutes, confusion=confusion, worst=worst, files=files)


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
    """Write a tool's labels as the annotations of a recording, as `fisheye-bench annotate import` does.

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
    """Write accepted tracks, or annotations, as `fisheye-bench annotate export` does; of all drives, or of none.

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
    card = rendered_card(dataset, split, executor=executor)
    return card, open_dataset(card, split), annotations_folder(card, reviews)


def annotations_folder(card: DatasetCard, folder: str | Path | None = None) -> Path:
    """The folder of reviews and annotations that is named, else the card's, else one below the working folder."""
    return Path(folder) if folder is not None else card.annotations or Path("annotations") / card.name


def _reviewed(card: DatasetCard, name: str, folder: Path, *, unreviewed: bool) -> Recording:
    """A recording with the tracks that were accepted, or those that were proposed and not rejected."""
    file = review_file(folder, name)
    review, opened = read_review(file), open_unannotated(card, name)
    if not unreviewed:
        refuse_unfinished(review, opened, file)
    return replace(opened, tracks=to_tracks(review, opened, unreviewed=unreviewed))
