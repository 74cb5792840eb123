"""The main job: data set in, table out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.cli.console import console, print_failures, progress_bar
from bench.cli.rendering import render_if_synthetic
from bench.cli.settings import parse_settings
from bench.cli.viewing import draw_telling_frames
from bench.evaluation import Protocol, load_protocol
from bench.harness import RunSummary, build_scorable, run_benchmark
from bench.methods import Method
from bench.recordings import DatasetCard, load_card
from bench.reporting.terminal_table import to_rich
from bench.reporting.threshold_free_line import threshold_free_line
from bench.reporting.write import write_report_files

RUNS = Path("reports/runs")


def run(
    dataset: str,
    *,
    method: str,
    settings: Sequence[str],
    protocol: str,
    split: str | None,
    out: Path | None,
    pictures: bool,
) -> int:
    """Score a method, write the report, print the table and the paths; return the number of failures."""
    card, rules = load_card(dataset), load_protocol(protocol)
    chosen = build_scorable(method, parse_settings(settings))
    folder = out or RUNS / f"{card.name}-{chosen.name}"
    render_if_synthetic(card)
    with progress_bar(f"scoring {method} on {card.name}", "recordings") as report:
        summary = run_benchmark(card, method=chosen, protocol=rules, out=folder, split=split, progress=report)
    finish_run(card, summary, folder, method=chosen, protocol=rules, split=split, pictures=pictures)
    return len(summary.failures)


def finish_run(
    card: DatasetCard,
    summary: RunSummary,
    folder: Path,
    *,
    method: Method,
    protocol: Protocol,
    split: str | None,
    pictures: bool,
) -> None:
    """Write the report of a stored run, draw its pictures, print the table and the paths."""
    written = write_report_files(folder)
    drawn: list[Path] = []
    if pictures:
        with progress_bar("drawing", "pictures") as report:
            drawn = draw_telling_frames(card, folder, method=method, protocol=protocol, split=split, progress=report)
    screen = console()
    screen.print(to_rich(written.rows))
    _print_ends(summary, [folder / "summary.json", *written.files, *drawn])


def _print_ends(summary: RunSummary, files: Sequence[Path]) -> None:
    screen, made = console(), summary.provenance
    ledger, images = summary.objects, summary.images

    def say(text: str, *, style: str | None = None) -> None:
        screen.print(text, style=style, highlight=False, soft_wrap=True, markup=False)

    ignored = ", ".join(f"{count} {reason}" for reason, count in ledger.ignored.items() if count) or "none"
    say(
        f"{ledger.annotated} annotated object-frames: {ledger.evaluated} evaluated, {ledger.static} static, "
        f"ignored: {ignored}"
    )
    if summary.threshold_free is not None:
        say(threshold_free_line(summary.threshold_free))
    say(f"{images.images} images: {images.evaluated} scored, {images.skipped} skipped, {images.failed} failed")
    stages = ", ".join(f"{name} {seconds:.1f}" for name, seconds in made.stage_seconds.items())
    rate = made.images / made.seconds if made.seconds else 0.0
    say(f"{made.seconds:.1f} s ({stages}), {rate:.1f} images per second, peak memory {made.peak_memory_mb:.0f} MB")
    print_failures(summary.failures, all_in="summary.json")
    for file in files:
        say(str(file))
