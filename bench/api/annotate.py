"""From a raw drive to annotations: proposals, their review, other tools' labels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from bench.annotation import class_confusion, proposal_scores, worst_tracks
from bench.annotation.drives import ProposedDrive, evaluate_drives, propose_drives
from bench.annotation.export import refuse_unfinished, to_tracks, write_reviewed
from bench.annotation.store import read_review, review_file
from bench.api.datasets import Dataset, as_card, as_executor, rendered_card
from bench.execution import TaskExecutor
from bench.harness.stages import Progress, no_progress
from bench.labels import LabelOptions, LabelSet, label_format, open_unannotated
from bench.labels import export_labels as write_labels
from bench.labels import import_labels as read_labels
from bench.labels.projects import Points, write_project
from bench.recordings import DatasetCard, Recording, RecordingHandle, open_dataset
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


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedDrive:
    """A drive that was written for others.

    Attributes:
        name: of the recording.
        place: file or folder; None where nothing was proposed and nothing reviewed.
        lost: one line for each thing that a format cannot hold.
    """

    name: str
    place: Path | None
    lost: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConvertedLabels:
    """Labels of a recording that were read from a tool's files, or written as such.

    Attributes:
        recording: that they are of.
        labels: what was read or written.
        place: file or folder that was written.
        lost: one line for each thing that the other side cannot hold.
    """

    recording: Recording
    labels: LabelSet
    place: Path
    lost: tuple[str, ...]


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
        dataset: card, by path or by a name that `fisheye-bench datasets` lists.
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


def export_reviewed(
    dataset: str | Path | DatasetCard,
    out: str | Path,
    *,
    split: str | None = None,
    reviews: str | Path | None = None,
    unreviewed: bool = False,
    formats: Sequence[str] = (),
) -> tuple[ExportedDrive, ...]:
    """Write accepted tracks as annotations, as `fisheye-bench annotate export` does; of all drives, or of none.

    Args:
        dataset: as of `propose`.
        out: folder of the annotation files, <recording>.json.
        split: as of `propose`.
        reviews: as of `propose`.
        unreviewed: write what was proposed and not rejected instead; whatever uses it says so.
        formats: label formats to write as well, in folders below `out`; `fisheye-bench annotations formats` lists them.

    Raises:
        UnknownNameError: no data set, split or format of this name.
        DataError: a review is missing or damaged, or leaves something undecided or not watched.
    """
    for name in formats:
        label_format(name)  # an unknown name is told before anything is opened
    written = []
    for opened in list(_reviewed(dataset, split, reviews, unreviewed=unreviewed)):
        if unreviewed and not opened.tracks:
            written.append(ExportedDrive(name=opened.name, place=None))
            continue
        file, lost = write_reviewed(Path(out), opened, opened.tracks), []
        for name in formats:
            _, of_format = write_labels(name, opened, Path(out) / name / opened.name, LabelOptions())
            lost += [f"{name}, lost: {line}" for line in of_format]
        written.append(ExportedDrive(name=opened.name, place=file, lost=tuple(lost)))
    return tuple(written)


def export_projects(
    dataset: str | Path | DatasetCard,
    out: str | Path,
    tool: str,
    *,
    split: str | None = None,
    reviews: str | Path | None = None,
    points: Points = "deskewed",
    progress: Progress | None = None,
) -> tuple[ExportedDrive, ...]:
    """Write what was proposed and not rejected as projects of a labelling tool, a folder for each recording.

    Args:
        dataset: as of `propose`.
        out: folder of the projects.
        tool: "sustechpoints", "cvat" or "labelcloud".
        split: as of `propose`.
        reviews: as of `propose`.
        points: "deskewed" moves every point to the time of its sweep; "recorded" leaves it where the lidar gave it.
        progress: called with the recordings done, fractions allowed, and their number.

    Raises:
        UnknownNameError: no data set, split or tool of this name.
        DataError: a review is missing or damaged, or a project's folder holds something.
    """
    opened, written = list(_reviewed(dataset, split, reviews, unreviewed=True)), []
    for number, recording in enumerate(opened):
        place = Path(out) / recording.name

        def report(share: float, before: int = number) -> None:
            (progress or no_progress)(before + share, len(opened))

        lost = write_project(recording, place, tool=tool, points=points, progress=report)
        written.append(ExportedDrive(name=recording.name, place=place, lost=lost))
    return tuple(written)


def import_labels(
    format_name: str,
    source: str | Path,
    dataset: str | Path | DatasetCard,
    recording: str,
    *,
    out: str | Path | None = None,
    classes: Mapping[str, str | None] | None = None,
    first_frame: int = 0,
) -> ConvertedLabels:
    """Write a tool's labels as the annotations of a recording, as `fisheye-bench annotations import` does.

    Args:
        format_name: of the tool's files; `fisheye-bench annotations formats` lists them.
        source: the tool's file or folder.
        dataset: card, by path or name.
        recording: name.
        out: folder of annotation files; None for the card's annotations, or `annotations/<data set>`.
        classes: what a class of the tool is for us; None for one whose objects are left out.
        first_frame: number of the first sweep in the tool's frames.

    Raises:
        UnknownNameError: no such format, data set or recording.
        UsageError: a class that is none of ours.
        DataError: files that the format refuses, an object twice, or twice at one time.
    """
    options = LabelOptions(classes=classes or {}, first_frame=first_frame)
    label_format(format_name)  # an unknown name is told before anything is opened
    card = as_card(dataset)
    file, opened = annotations_folder(card, out) / f"{recording}.json", open_unannotated(card, recording)
    labels = read_labels(format_name, Path(source), opened, options, file=file)
    return ConvertedLabels(recording=opened, labels=labels, place=file, lost=labels.lost)


def export_labels(
    format_name: str,
    dataset: str | Path | DatasetCard,
    out: str | Path,
    *,
    recording: str | None = None,
    classes: Mapping[str, str | None] | None = None,
    first_frame: int = 0,
) -> Iterator[ConvertedLabels]:
    """Write annotations as a tool's files, one recording after the other, as `fisheye-bench annotations export` does.

    Args:
        format_name: of the tool's files; `fisheye-bench annotations formats` lists them.
        dataset: card, by path or name.
        out: folder; each recording gets one in it.
        recording: name of the only one; None for all.
        classes: what a class of the tool is for us; None for one that is left out.
        first_frame: number of the first sweep in the tool's frames.

    Raises:
        UnknownNameError: no such format, data set or recording.
        UsageError: a class that is none of ours.
        DataError: a recording that cannot be read, or has no sweeps.
    """
    options = LabelOptions(classes=classes or {}, first_frame=first_frame)
    label_format(format_name)
    card = as_card(dataset)
    data = Dataset(card=card, handles=open_dataset(card))
    for name in data.names if recording is None else (recording,):
        opened, place = data[name], Path(out) / name
        labels, lost = write_labels(format_name, opened, place, options)
        yield ConvertedLabels(recording=opened, labels=labels, place=place, lost=lost)


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


def _reviewed(
    dataset: str | Path | DatasetCard, split: str | None, reviews: str | Path | None, *, unreviewed: bool
) -> Iterator[Recording]:
    """Each recording with its tracks: those that were accepted, or those that were proposed and not rejected."""
    card, handles, folder = open_drives(dataset, split=split, reviews=reviews)
    for handle in handles:
        file = review_file(folder, handle.name)
        stored, opened = read_review(file), open_unannotated(card, handle.name)
        if not unreviewed:
            refuse_unfinished(stored, opened, file)
        yield replace(opened, tracks=to_tracks(stored, opened, unreviewed=unreviewed))
