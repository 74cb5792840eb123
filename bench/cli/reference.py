"""`reference`: what a protocol counts in each image, as files for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli import options
from bench.cli.console import note, say
from bench.cli.options import group

app = group("Write the reference of a data set as label images and JSON, to train and score with other tools.")


@app.command("export")
def export(
    dataset: options.Dataset,
    out: Annotated[Path, typer.Option(help="Folder, new or empty.")],
    protocol: options.ProtocolName = "surface-v1",
    recording: options.Recording = None,
    split: options.Split = None,
    workers: options.Workers = None,
) -> None:
    """Write for each image the pixels of objects, unknown bands and ignored areas, and what the objects are."""
    from bench.api.references import export_reference
    from bench.cli.progress import progress_bar
    from bench.cli.request import rendered_card, worker_processes

    card = rendered_card(dataset, split)
    with progress_bar(f"exporting the reference of {card.name}", "recordings") as report:
        export = export_reference(
            card,
            out,
            protocol=protocol,
            split=split,
            recording=recording,
            workers=worker_processes(workers),
            progress=report,
        )
    say(str(out))
    for problem in export.problems:
        note(f"no reference: {problem}")
    if export.problems:
        raise typer.Exit(options.FAILURES)
