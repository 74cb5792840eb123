"""`audit`: how good the lidar reference is, why a method misses, and whether the reference ranks as the truth does."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from bench.audit import audit_sources, read_misses, read_polygons, run_audit
from bench.audit.predictions import ALL_PREDICTIONS, Prediction
from bench.audit.ranking import run_ranking
from bench.cli.computing import local_executor, parse_settings, render_if_synthetic, split_method
from bench.cli.console import note, print_failures, progress_bar, say, show, stage_times
from bench.cli.interrupts import interruptible
from bench.evaluation import load_protocol
from bench.harness import Provenance, build_scorable
from bench.methods import FlowMethod, build_method
from bench.recordings import DatasetCard, load_card
from bench.recordings.atomic import output_folder
from bench.reporting.audit_pictures import write_audit_files, write_cause_pictures, write_examples
from bench.reporting.audit_ranking import ranking_tables, write_ranking_files
from bench.reporting.audit_tables import audit_tables, for_terminal

AUDITS = Path("reports/audit")
LEFT = "nothing of the audit is stored, and the same command begins it again"


def audit(
    dataset: str,
    *,
    method: str,
    settings: Sequence[str],
    protocol: str,
    split: str | None,
    out: Path | None,
    recordings: int | None,
    workers: int | None,
    pictures: bool,
) -> int:
    """Audit, write tables and pictures, print the tables and the paths; return the number of failures."""
    card, rules = load_card(dataset), load_protocol(protocol)
    chosen = build_method(method, parse_settings(settings))
    folder = out or AUDITS / card.name
    with _auditing(card, folder, title=f"auditing {card.name}") as report:
        found = run_audit(
            card,
            method=chosen,
            protocol=rules,
            out=folder,
            split=split,
            recordings=recordings,
            executor=local_executor(workers),
            progress=report,
        )
    files = list(write_audit_files(folder))
    if pictures:
        sources = {source.recorded.name: source for source in audit_sources(card, split=split, recordings=recordings)}
        handles = {name: source.recorded for name, source in sources.items()}
        files += write_examples(folder, found, read_polygons(folder), handles=handles, protocol=rules)
        if isinstance(chosen, FlowMethod):
            files += write_cause_pictures(folder, read_misses(folder), sources=sources, method=chosen, protocol=rules)
    show(for_terminal(audit_tables(found)))
    _print_cost(found.provenance, recordings=found.recordings)
    if found.left_out:
        say(f"without exact flow: {found.left_out}")
    _print_ends(found.failures, files, all_in="audit.json")
    return len(found.failures)


def rank(
    dataset: str,
    *,
    methods: str,
    split: str | None,
    out: Path | None,
    recordings: int | None,
    workers: int | None,
) -> int:
    """Rank methods by every reference, write tables and picture, print the tables and the paths.

    Returns:
        The number of failures.
    """
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
            executor=local_executor(workers),
            progress=report,
        )
    files = write_ranking_files(folder)
    show(for_terminal(ranking_tables(found)))
    _print_cost(found.provenance, recordings=found.recordings)
    _print_ends(found.failures, files, all_in="ranking.json")
    return len(found.failures)


@contextmanager
def _auditing(card: DatasetCard, folder: Path, *, title: str) -> Iterator[Callable[[float, int], None]]:
    """Audit recordings, which are rendered where they are not there, into a folder; takes what is done of how many."""
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
    names = ALL_PREDICTIONS if text == "all" else tuple(name.strip() for name in text.split(","))
    return tuple(_prediction(name) for name in names)


def _prediction(name: str) -> Prediction:
    method, settings = split_method(name)
    return Prediction(name=name, method=build_scorable(method, parse_settings(settings)))


def _print_cost(made: Provenance, *, recordings: int) -> None:
    stages = stage_times(made.stage_seconds)
    say(f"{made.images} images of {recordings} recordings in {made.seconds:.1f} s ({stages})")


def _print_ends(failures: Sequence[str], files: Iterable[Path], *, all_in: str) -> None:
    print_failures(failures, all_in=all_in)
    for file in files:
        note(str(file))
