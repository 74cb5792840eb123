"""`audit`: how good the lidar reference is, why a method misses, and whether the reference ranks as the truth does."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli import options
from bench.cli.console import note, print_failures, progress_bar, say, show, stage_times
from bench.cli.interrupts import interruptible
from bench.errors import UsageError

if TYPE_CHECKING:
    from bench.audit.predictions import Prediction
    from bench.harness import Provenance
    from bench.recordings import DatasetCard

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

    With --methods: whether the lidar references rank methods as the exact masks do. An audit that was interrupted
    begins again.
    """
    from bench.audit import audit_sources, read_misses, read_polygons, run_audit
    from bench.cli.request import chosen, worker_processes
    from bench.methods import FlowMethod, build_method
    from bench.reporting.audit_pictures import write_audit_files, write_cause_pictures, write_examples
    from bench.reporting.audit_tables import audit_tables, for_terminal

    if methods is not None:
        if set_ or method != "spherical" or protocol != "paper-v1":
            raise UsageError(
                "--methods: expected none of --method, --set and --protocol beside it; settings follow a method's name "
                "behind a colon, and the references are always the same"
            )
        _rank(dataset, methods, split=split, out=out, recordings=recordings, workers=workers)
        return
    card, built, rules = chosen(dataset, build_method, method=method, settings=set_, protocol=protocol)
    folder = out or AUDITS / card.name
    with _auditing(card, folder, title=f"auditing {card.name}") as report:
        found = run_audit(
            card,
            method=built,
            protocol=rules,
            out=folder,
            split=split,
            recordings=recordings,
            executor=worker_processes(workers),
            progress=report,
        )
    files = list(write_audit_files(folder))
    if pictures:
        sources = {source.recorded.name: source for source in audit_sources(card, split=split, recordings=recordings)}
        handles = {name: source.recorded for name, source in sources.items()}
        files += write_examples(folder, found, read_polygons(folder), handles=handles, protocol=rules)
        if isinstance(built, FlowMethod):
            files += write_cause_pictures(folder, read_misses(folder), sources=sources, method=built, protocol=rules)
    show(for_terminal(audit_tables(found)))
    _print_cost(found.provenance, recordings=found.recordings)
    if found.left_out:
        say(f"without exact flow: {found.left_out}")
    _print_ends(found.failures, files, all_in="audit.json")


def _rank(
    dataset: str, methods: str, *, split: str | None, out: Path | None, recordings: int | None, workers: int | None
) -> None:
    """Rank methods by every reference, write tables and picture, print the tables and the paths."""
    from bench.audit.ranking import run_ranking
    from bench.cli.request import worker_processes
    from bench.recordings import load_card
    from bench.reporting.audit_ranking import ranking_tables, write_ranking_files
    from bench.reporting.audit_tables import for_terminal

    predictions = parse_methods(methods)
    card = load_card(dataset)
    folder = out or AUDITS / card.name
    with _auditing(card, folder, title=f"ranking {len(predictions)} on {card.name}") as report:
        found = run_ranking(
            card,
            predictions=predictions,
            out=folder,
            split=split,
            recordings=recordings,
            executor=worker_processes(workers),
            progress=report,
        )
    files = write_ranking_files(folder)
    show(for_terminal(ranking_tables(found)))
    _print_cost(found.provenance, recordings=found.recordings)
    _print_ends(found.failures, files, all_in="ranking.json")


@contextmanager
def _auditing(card: DatasetCard, folder: Path, *, title: str) -> Iterator[Callable[[float, int], None]]:
    """Audit recordings, which are rendered where they are not there, into a folder; takes what is done of how many."""
    from bench.atomic import output_folder
    from bench.cli.request import render_if_synthetic

    with output_folder(folder):
        render_if_synthetic(card)
        with interruptible(LEFT), progress_bar(title, "recordings") as report:
            yield report


def parse_methods(text: str) -> tuple[Prediction, ...]:
    """Build the methods of a list with commas, settings behind colons: `spherical,spherical:flow=dis:cell_size_px=4`.

    Args:
        text: the list, or "all".

    Raises:
        UsageError: a method or a setting that does not exist, or words behind a setting that are none.
    """
    from bench.audit.predictions import ALL_PREDICTIONS, Prediction
    from bench.cli.request import parse_settings, split_method
    from bench.harness import build_scorable

    names = ALL_PREDICTIONS if text == "all" else tuple(name.strip() for name in text.split(","))
    parts = [(name, *split_method(name)) for name in names]
    return tuple(
        Prediction(name=name, method=build_scorable(method, parse_settings(settings)))
        for name, method, settings in parts
    )


def _print_cost(made: Provenance, *, recordings: int) -> None:
    stages = stage_times(made.stage_seconds)
    say(f"{made.images} images of {recordings} recordings in {made.seconds:.1f} s ({stages})")


def _print_ends(failures: Sequence[str], files: Iterable[Path], *, all_in: str) -> None:
    """Print failures and files, and end with the status that tells of failures."""
    print_failures(failures, all_in=all_in)
    for file in files:
        note(str(file))
    if failures:
        raise typer.Exit(options.FAILURES)
