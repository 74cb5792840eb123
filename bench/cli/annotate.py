"""`annotate`: from a raw drive to annotations: review, export."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli.console import say
from bench.cli.options import Dataset, group
from bench.errors import UnknownNameError

if TYPE_CHECKING:
    from bench.recordings import DatasetCard, RecordingHandle

app = group("Make annotations of a drive that has none: propose, review, export.")

DEFAULT_FOLDER = Path("annotations")

Reviews = Annotated[
    Path | None,
    typer.Option(help="Folder of reviews; default: the card's annotations, or annotations/<data set>."),
]
Chosen = Annotated[str | None, typer.Option("--recording", help="Name of the recording; default: all.")]


def reviews_folder(card: DatasetCard, reviews: Path | None) -> Path:
    """Return the folder of a data set's reviews."""
    return reviews or card.annotations or DEFAULT_FOLDER / card.name


def chosen_recordings(card: DatasetCard, recording: str | None) -> list[RecordingHandle]:
    """Recordings of a data set, rendered first where it is not, or the one that is asked for.

    Raises:
        UnknownNameError: no such recording.
    """
    from bench.cli.request import render_if_synthetic
    from bench.recordings import open_dataset

    render_if_synthetic(card)
    handles = open_dataset(card)
    if recording is not None and recording not in {handle.name for handle in handles}:
        raise UnknownNameError("recording", recording, [handle.name for handle in handles])
    return [handle for handle in handles if recording in (None, handle.name)]


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
    from bench.recordings import load_card

    card = load_card(dataset)
    names = [handle.name for handle in chosen_recordings(card, recording)]
    folder = reviews_folder(card, reviews)

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
    out: Annotated[Path, typer.Option(help="Folder of the annotation files, <recording>.json.")],
    recording: Chosen = None,
    reviews: Reviews = None,
    unreviewed: Annotated[
        bool, typer.Option("--unreviewed", help="Write what was proposed and not rejected; whatever uses it says so.")
    ] = False,
    labels: Annotated[
        list[str] | None,
        typer.Option(metavar="FORMAT", help="Also in this format, see `annotations formats`; repeatable."),
    ] = None,
) -> None:
    """Write accepted tracks as annotations; refuse drives of which something is undecided or not watched."""
    from dataclasses import replace

    from bench.annotation.export import refuse_unfinished, to_tracks, write_reviewed
    from bench.annotation.store import read_review, review_file
    from bench.labels import LabelOptions, export_labels, label_format, open_unannotated
    from bench.recordings import load_card

    for name in labels or ():
        label_format(name)
    card = load_card(dataset)
    folder = reviews_folder(card, reviews)
    found = []
    for handle in chosen_recordings(card, recording):
        file = review_file(folder, handle.name)
        stored, opened = read_review(file), open_unannotated(card, handle.name)
        if not unreviewed:
            refuse_unfinished(stored, opened, file)
        found.append((opened, to_tracks(stored, opened, unreviewed=unreviewed)))
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
