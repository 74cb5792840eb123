"""`audit`: how good the lidar reference is, and why a method misses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli import options
from bench.cli.console import note, print_failures, say, show
from bench.cli.progress import interruptible, progress_bar

if TYPE_CHECKING:
    from bench.api.audit import Audit

LEFT = "nothing of the audit is stored, and the same command begins it again"


def audit(
    dataset: options.Dataset,
    method: options.MethodName = "spherical",
    set_: options.Settings = None,
    protocol: options.ProtocolName = "paper-v1",
    split: options.Split = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the audit; default: reports/audit/<data set>.")] = None,
    recordings: Annotated[
        int | None, typer.Option(help="How many recordings, spread over the split; default: all.")
    ] = None,
    workers: options.Workers = None,
    pictures: Annotated[bool, typer.Option(help="Draw median and worst examples of every class.")] = True,
) -> None:
    """Audit a rendered data set: lidar polygons against exact masks, and why the method misses.

    An audit that was interrupted begins again.
    """
    from bench.api.audit import audit_folder, audit_reference
    from bench.atomic import output_folder
    from bench.cli.request import rendered_card, worker_processes
    from bench.evaluation import load_protocol
    from bench.methods import build_method
    from bench.methods.settings import parse_settings
    from bench.recordings import load_card

    card, built = load_card(dataset), build_method(method, parse_settings(set_))
    load_protocol(protocol)  # an unknown name is told before anything is rendered
    folder = audit_folder(card, out)
    with output_folder(folder):
        rendered_card(card, split)
        with interruptible(LEFT), progress_bar(f"auditing {card.name}", "recordings") as progress:
            found = audit_reference(
                card,
                built,
                protocol=protocol,
                split=split,
                recordings=recordings,
                out=folder,
                pictures=pictures,
                workers=worker_processes(workers),
                progress=progress,
            )
    _print(found)


def _print(found: Audit) -> None:
    """Print the tables, the cost, failures and files, and end with the status that tells of failures."""
    from bench.reporting.audit_tables import for_terminal
    from bench.reporting.totals import stage_times

    show(for_terminal(found.tables))
    summary, made = found.summary, found.summary.provenance
    stages = stage_times(made.stage_seconds)
    say(f"{made.images} images of {summary.recordings} recordings in {made.seconds:.1f} s ({stages})")
    for remark in found.remarks:
        say(remark)
    print_failures(summary.failures, all_in="audit.json")
    for file in found.files:
        note(str(file))
    if summary.failures:
        raise typer.Exit(options.FAILURES)
