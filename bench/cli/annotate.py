"""`annotate`: from a raw drive to annotations: propose, evaluate, review, export."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from bench.cli.annotations import annotations_folder
from bench.cli.console import print_failures, say, show
from bench.cli.options import FAILURES, Dataset, Workers, group
from bench.cli.progress import progress_bar, resumable
from bench.errors import UsageError

if TYPE_CHECKING:
    from bench.recordings import DatasetCard, Recording, RecordingHandle

app = group("Make annotations of a drive that has none: propose, evaluate, review, export.")

Reviews = Annotated[
    Path | None,
    typer.Option(help="Folder of reviews; default: the card's annotations, or annotations/<data set>."),
]
LabellingTool = Literal["sustechpoints", "cvat", "labelcloud"]
PointsOf = Literal["deskewed", "recorded"]
Chosen = Annotated[str | None, typer.Option("--recording", help="Recordings with commas in between; default: all.")]


def open_drives(
    dataset: str, recording: str | None, reviews: Path | None
) -> tuple[DatasetCard, tuple[RecordingHandle, ...], Path]:
    """Open a data set, of which recordings are rendered first where they are not there.

    Args:
        dataset: card, or its name.
        recording: names with commas in between; None for all.
        reviews: their folder; None for the usual one.

    Returns:
        The card, the recordings, the folder of their reviews.

    Raises:
        UnknownNameError: no such recording.
    """
    from bench.cli.request import rendered_card
    from bench.recordings import open_dataset

    card = rendered_card(dataset, recording)
    return card, open_dataset(card, recording), reviews or annotations_folder(card)


@app.command("propose")
def propose(dataset: Dataset, recording: Chosen = None, workers: Workers = None, reviews: Reviews = None) -> None:
    """Find what moves in drives without labels, from sweeps, ego-motion and calibration.

    Drives whose proposals are there are passed over, and decisions on them kept.
    """
    from bench.annotation.drives import propose_drives
    from bench.cli.request import worker_processes
    from bench.reporting.document import Table

    card, handles, folder = open_drives(dataset, recording, reviews)
    with resumable(folder), progress_bar(f"proposing objects of {card.name}", "recordings") as progress:
        drives = propose_drives(card.name, handles, folder, executor=worker_processes(workers), progress=progress)
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
    from bench.annotation import class_confusion, proposal_scores, worst_tracks
    from bench.annotation.drives import evaluate_drives
    from bench.cli.request import worker_processes
    from bench.reporting.proposal_scores import scores_tables, write_proposal_scores

    card, handles, folder = open_drives(dataset, recording, reviews)
    with progress_bar(f"evaluating proposals of {card.name}", "recordings") as progress:
        frames, minutes = evaluate_drives(handles, folder, executor=worker_processes(workers), progress=progress)
    scores = proposal_scores(frames, minutes=minutes)
    confusion, worst = class_confusion(frames), worst_tracks(frames)
    show(scores_tables(scores, minutes, confusion, worst))
    if out is not None:
        names = [handle.name for handle in handles]
        for file in write_proposal_scores(
            out, scores, minutes, confusion=confusion, worst=worst, dataset=card.name, recordings=names
        ):
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
    from bench.labels import open_unannotated

    card, handles, folder = open_drives(dataset, recording, reviews)
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


@app.command("export")
def export(
    dataset: Dataset,
    out: Annotated[Path, typer.Option(help="Folder of the annotation files, <recording>.json, or of the projects.")],
    recording: Chosen = None,
    reviews: Reviews = None,
    unreviewed: Annotated[
        bool, typer.Option("--unreviewed", help="Write what was proposed and not rejected; whatever uses it says so.")
    ] = False,
    labels: Annotated[
        list[str] | None,
        typer.Option(metavar="FORMAT", help="Also in this format, see `annotations formats`; repeatable."),
    ] = None,
    labelling: Annotated[
        LabellingTool | None,
        typer.Option(help="Write projects for this tool instead, of what was not rejected, reviewed or not."),
    ] = None,
    points: Annotated[
        PointsOf, typer.Option(help="Of projects: moved to the time of their sweep, or as recorded.")
    ] = "deskewed",
) -> None:
    """Write accepted tracks as annotations; refuse drives of which something is undecided or not watched."""
    from dataclasses import replace

    from bench.annotation.export import refuse_unfinished, to_tracks, write_reviewed
    from bench.annotation.store import read_review, review_file
    from bench.labels import LabelOptions, export_labels, label_format, open_unannotated

    if labelling and labels:
        raise UsageError("--labelling: expected projects or annotations, got --labels as well; run the command twice")
    for name in labels or ():
        label_format(name)
    card, handles, folder = open_drives(dataset, recording, reviews)
    unreviewed = unreviewed or labelling is not None
    found = []
    for handle in handles:
        file = review_file(folder, handle.name)
        stored, opened = read_review(file), open_unannotated(card, handle.name)
        if not unreviewed:
            refuse_unfinished(stored, opened, file)
        found.append((opened, to_tracks(stored, opened, unreviewed=unreviewed)))
    if labelling is not None:
        _write_projects(card, [replace(opened, tracks=tracks) for opened, tracks in found], out, labelling, points)
        return
    for opened, tracks in found:  # all or none
        if unreviewed and not tracks:
            say(
                f"{opened.name}: nothing was proposed, and nobody has looked: no annotations are written",
                style="yellow",
            )
            continue
        say(str(write_reviewed(out, opened, tracks)))
        for name in labels or ():
            _, lost = export_labels(name, replace(opened, tracks=tracks), out / name / opened.name, LabelOptions())
            for line in lost:
                say(f"  {name}, lost: {line}", style="yellow")
    say(f"To score by them, the card says where they are, `annotations: {out}`, and no longer `annotated: none`.")


def _write_projects(
    card: DatasetCard, recordings: Sequence[Recording], out: Path, tool: LabellingTool, points: PointsOf
) -> None:
    from bench.labels.projects import PROJECTS, write_project

    with progress_bar(f"writing projects of {card.name}", "recordings") as progress:
        for number, recording in enumerate(recordings):

            def report(share: float, before: int = number) -> None:
                progress(before + share, len(recordings))

            lost = write_project(recording, out / recording.name, tool=tool, points=points, progress=report)
            say(str(out / recording.name))
            for line in lost:
                say(f"  lost: {line}", style="yellow")
    source = out / (recordings[0].name if len(recordings) == 1 else "NAME")
    name = PROJECTS[tool].label_format
    say(f"back again: fisheye-bench annotations import {name} {source} --dataset {card.file} --recording {source.name}")
