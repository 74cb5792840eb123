"""`sweep`: one thing through many values."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from bench.cli.computing import Computing, parse_settings, render_if_synthetic
from bench.cli.console import note_files, print_failures, progress_bar, say, show, stage_times
from bench.cli.interrupts import resumable
from bench.errors import UsageError
from bench.evaluation import load_protocol
from bench.harness.sweep import SWEEPS, Setup, SweepResult, plan_sweep, run_sweep
from bench.methods import build_method
from bench.recordings import load_card
from bench.recordings.atomic import output_folder
from bench.reporting.sweep import to_rich, write_sweep_files

RUNS = Path("reports/runs")
LIST = "list"


def sweep(
    dataset: str,
    *,
    what: str,
    values: str | None,
    method: str,
    settings: Sequence[str],
    protocol: str,
    split: str | None,
    out: Path | None,
    computing: Computing,
) -> int:
    """Run a sweep, write table and chart, print the table and the paths; return the number of failures."""
    if what == LIST:
        print_sweeps()
        return 0
    card = load_card(dataset)
    base = Setup(method=build_method(method, parse_settings(settings)), protocol=load_protocol(protocol))
    plan = plan_sweep(what, base=base, values=_split(values))
    folder = (out or RUNS / f"sweeps-{card.name}") / what
    title = f"sweeping {what} over {len(plan.values)} values on {card.name}"
    with output_folder(folder):
        render_if_synthetic(card)
        with resumable(folder), progress_bar(title, "values") as report:
            executor = computing.executor(card, base.method)
            result = run_sweep(
                card,
                plan=plan,
                out=folder,
                cache=computing.cache_folder,
                split=split,
                executor=executor,
                progress=report,
            )
    files = write_sweep_files(folder)
    show(to_rich(result))
    _print_totals(result, files)
    return len(result.failures)


def print_sweeps() -> None:
    """Print what can be swept."""
    table = Table("name", "values", "what it is", box=None)
    for name, one in sorted(SWEEPS.items()):
        table.add_row(name, ", ".join(f"{v:g}" if not isinstance(v, str) else v for v in one.values), one.title)
    show(table)


def _split(values: str | None) -> list[str]:
    if values is None:
        return []
    parts = [part.strip() for part in values.split(",")]
    if not all(parts):
        raise UsageError(f"--values: expected values with commas in between, got {values!r}")
    return parts


def _print_totals(result: SweepResult, files: Sequence[Path]) -> None:
    made = result.provenance
    stages = stage_times(made.stage_seconds)
    say(
        f"{len(result.rows)} values on {made.images} images in {made.seconds:.1f} s ({stages}); flow computed "
        f"{result.flow.computed} times, read {result.flow.read} times; peak memory {made.peak_memory_mb:.0f} MB"
    )
    print_failures(result.failures, all_in="sweep.json")
    note_files([str(file) for file in files])
