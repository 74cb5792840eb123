"""`annotate`: from a raw drive to annotations: propose, evaluate, review, export."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from bench.cli.console import print_failures, say, show
from bench.cli.options import FAILURES, Dataset, Workers, group
from bench.cli.progress import progress_bar, resumable
from bench.errors import UsageError

if TYPE_CHECKING:
    from bench.api.annotate import ExportedDrive
    from bench.recordings import DatasetCard

app = group("Make annotations of a drive that has none: propose, evaluate, review, export.")

Reviews = Annotated[
    Path | None,
    typer.Option(help="Folder of reviews; default: the card's annotations, or annotations/<data set>."),
]
LabellingTool = Literal["sustechpoints", "cvat", "labelcloud"]
PointsOf = Literal["deskewed", "recorded"]
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
    from bench.api.annotate import open_drives
    from bench.cli.request import rendered_card
    from bench.labels import open_unannotated

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
    from bench.api.annotate import export_projects, export_reviewed
    from bench.cli.request import rendered_card

    if labelling and labels:
        raise UsageError("--labelling: expected projects or annotations, got --labels as well; run the command twice")
    card = rendered_card(dataset, recording)
    if labelling is not None:
        with progress_bar(f"writing projects of {card.name}", "recordings") as progress:
            drives = export_projects(
                card, out, labelling, split=recording, reviews=reviews, points=points, progress=progress
            )
        _print_projects(drives, card, out, labelling)
        return
    formats = labels or ()
    for drive in export_reviewed(card, out, split=recording, reviews=reviews, unreviewed=unreviewed, formats=formats):
        if drive.place is None:
            nothing = "nothing was proposed, and nobody has looked: no annotations are written"
            say(f"{drive.name}: {nothing}", style="yellow")
            continue
        say(str(drive.place))
        for line in drive.lost:
            say(f"  {line}", style="yellow")
    say(f"To score by them, the card says where they are, `annotations: {out}`, and no longer `annotated: none`.")


def _print_projects(drives: Sequence[ExportedDrive], card: DatasetCard, out: Path, tool: LabellingTool) -> None:
    """Print where projects are, what they cannot hold, and the command that brings them back."""
    from bench.labels.projects import PROJECTS

    for drive in drives:
        say(str(drive.place))
        for line in drive.lost:
            say(f"  lost: {line}", style="yellow")
    source = out / (drives[0].name if len(drives) == 1 else "NAME")
    name = PROJECTS[tool].label_format
    say(f"back again: fisheye-bench annotations import {name} {source} --dataset {card.file} --recording {source.name}")
