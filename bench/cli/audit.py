"""`audit`: how good the lidar reference is, why a method misses, and whether the reference ranks as the truth does."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from bench.cli import options
from bench.cli.console import note, print_failures, say, show
from bench.cli.progress import interruptible, progress_bar
from bench.errors import UsageError

if TYPE_CHECKING:
    from bench.audit import AuditSummary
    from bench.audit.beams import BeamsSummary
    from bench.audit.ranking import RankingSummary
    from bench.reporting.document import Table

Found = TypeVar("Found")

AUDITS = Path("reports/audit")
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
    from bench.atomic import output_folder
    from bench.audit import audit_sources, read_misses, read_polygons, run_audit
    from bench.audit.beams import parse_beams, run_beams
    from bench.audit.predictions import parse_predictions
    from bench.audit.ranking import run_ranking
    from bench.cli.request import render_if_synthetic, worker_processes
    from bench.evaluation import load_protocol
    from bench.methods import FlowMethod, build_method
    from bench.methods.settings import parse_settings
    from bench.recordings import load_card
    from bench.reporting.audit_beams import beams_tables, write_beams_files
    from bench.reporting.audit_pictures import write_audit_files, write_cause_pictures, write_examples
    from bench.reporting.audit_ranking import ranking_tables, write_ranking_files
    from bench.reporting.audit_tables import audit_tables

    card = load_card(dataset)
    folder = out or AUDITS / card.name

    def compute(work: Callable[..., Found], title: str) -> Found:
        with output_folder(folder):
            render_if_synthetic(card, split)
            with interruptible(LEFT), progress_bar(title, "recordings") as report:
                executor = worker_processes(workers)
                return work(card, out=folder, split=split, recordings=recordings, executor=executor, progress=report)

    fixed = [option for option, text in (("--beams", beams), ("--methods", methods)) if text is not None]
    if fixed and (set_ or method != "spherical" or protocol != "paper-v1"):
        raise UsageError(
            f"{fixed[0]}: expected none of --method, --set and --protocol beside it; settings follow a method's name "
            "behind a colon in --methods, and the references are always the same"
        )
    ranked = () if methods is None else parse_predictions(methods)
    if beams is not None:
        work = partial(run_beams, beams=parse_beams(beams), predictions=ranked)
        thinned = compute(work, f"thinning the lidar of {card.name}")
        _print(thinned, beams_tables(thinned), write_beams_files(folder), all_in="beams.json")
        return
    if ranked:
        ranking = compute(partial(run_ranking, predictions=ranked), f"ranking {len(ranked)} on {card.name}")
        _print(ranking, ranking_tables(ranking), write_ranking_files(folder), all_in="ranking.json")
        return
    built, rules = build_method(method, parse_settings(set_)), load_protocol(protocol)
    found = compute(partial(run_audit, method=built, protocol=rules), f"auditing {card.name}")
    files = list(write_audit_files(folder))
    if pictures:
        sources = {source.recorded.name: source for source in audit_sources(card, split=split, recordings=recordings)}
        handles = {name: source.recorded for name, source in sources.items()}
        files += write_examples(folder, found, read_polygons(folder), handles=handles, protocol=rules)
        if isinstance(built, FlowMethod):
            files += write_cause_pictures(folder, read_misses(folder), sources=sources, method=built, protocol=rules)
    _print(found, audit_tables(found), files, all_in="audit.json", left_out=found.left_out)


def _print(
    found: AuditSummary | BeamsSummary | RankingSummary,
    tables: Iterable[Table],
    files: Iterable[Path],
    *,
    all_in: str,
    left_out: str = "",
) -> None:
    """Print the tables, the cost, failures and files, and end with the status that tells of failures."""
    from bench.reporting.audit_tables import for_terminal
    from bench.reporting.totals import stage_times

    show(for_terminal(tables))
    made = found.provenance
    stages = stage_times(made.stage_seconds)
    say(f"{made.images} images of {found.recordings} recordings in {made.seconds:.1f} s ({stages})")
    if left_out:
        say(f"without exact flow: {left_out}")
    print_failures(found.failures, all_in=all_in)
    for file in files:
        note(str(file))
    if found.failures:
        raise typer.Exit(options.FAILURES)
