"""`audit`: how good the lidar reference is, why a method misses, and whether the reference ranks as the truth does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.cli import options
from bench.cli.console import note, print_failures, say, show
from bench.cli.progress import interruptible, progress_bar
from bench.errors import UsageError

if TYPE_CHECKING:
    from bench.api.audit import Audit

LEFT = "nothing of the audit is stored, and the same command begins it again"


def audit(
    dataset: options.Dataset,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            help="Rank these methods by lidar references and by exact masks instead; settings behind colons, as in "
            "spherical:flow=dis,truth:grow_px=4; `all` for a list of good and bad ones.",
        ),
    ] = None,
    beams: Annotated[
        str | None,
        typer.Option(
            metavar="N,N,...",
            help="Leave out rings of the lidar and tell how good the reference surface-v1 is with so many, as in "
            "64,32,16; with --methods also how well it ranks these.",
        ),
    ] = None,
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

    With --methods: whether the lidar references rank methods as the exact masks do. With --beams: how many beams a
    trustworthy reference needs. An audit that was interrupted begins again.
    """
    from bench.api.audit import audit_beams, audit_folder, audit_ranking, audit_reference
    from bench.atomic import output_folder
    from bench.audit.beams import parse_beams
    from bench.audit.predictions import parse_predictions
    from bench.cli.request import rendered_card, worker_processes
    from bench.evaluation import load_protocol
    from bench.methods import build_method
    from bench.methods.settings import parse_settings
    from bench.recordings import load_card

    card = load_card(dataset)
    folder = audit_folder(card, out)

    def compute(audit: Callable[..., Audit[Any]], title: str, *, all_in: str, **named: Any) -> None:
        with output_folder(folder):
            rendered_card(card, split)
            with interruptible(LEFT), progress_bar(title, "recordings") as progress:
                named |= {"split": split, "recordings": recordings, "out": folder, "workers": worker_processes(workers)}
                found = audit(card, progress=progress, **named)
        _print(found, all_in=all_in)

    fixed = [option for option, text in (("--beams", beams), ("--methods", methods)) if text is not None]
    if fixed and (set_ or method != "spherical" or protocol != "paper-v1"):
        raise UsageError(
            f"{fixed[0]}: expected none of --method, --set and --protocol beside it; settings follow a method's name "
            "behind a colon in --methods, and the references are always the same"
        )
    ranked = () if methods is None else parse_predictions(methods)
    if beams is not None:
        title = f"thinning the lidar of {card.name}"
        compute(audit_beams, title, all_in="beams.json", beams=parse_beams(beams), methods=ranked)
    elif ranked:
        compute(audit_ranking, f"ranking {len(ranked)} on {card.name}", all_in="ranking.json", methods=ranked)
    else:
        built = build_method(method, parse_settings(set_))
        load_protocol(protocol)  # an unknown name is told before anything is rendered
        named = {"method": built, "protocol": protocol, "pictures": pictures}
        compute(audit_reference, f"auditing {card.name}", all_in="audit.json", **named)


def _print(found: Audit[Any], *, all_in: str) -> None:
    """Print the tables, the cost, failures and files, and end with the status that tells of failures."""
    from bench.reporting.audit_tables import for_terminal
    from bench.reporting.totals import stage_times

    show(for_terminal(found.tables))
    summary, made = found.summary, found.summary.provenance
    stages = stage_times(made.stage_seconds)
    say(f"{made.images} images of {summary.recordings} recordings in {made.seconds:.1f} s ({stages})")
    for remark in found.remarks:
        say(remark)
    print_failures(summary.failures, all_in=all_in)
    for file in found.files:
        note(str(file))
    if summary.failures:
        raise typer.Exit(options.FAILURES)
