"""Pages, comparisons and leaderboards of stored runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.api.runs import run_folder
from bench.cli.console import note_files, progress_bar, say, show
from bench.errors import UnknownNameError
from bench.reference import Category
from bench.reporting.compare.changes import category_line, verdict_line
from bench.reporting.compare.writing import terminal_report, write_comparison
from bench.reporting.leaderboard.page import write_leaderboard
from bench.reporting.leaderboard.reading import read_leaderboard
from bench.reporting.leaderboard.texts import leaderboard_tables
from bench.reporting.page.build import write_page
from bench.reporting.page.charts import write_figures

RUNS = Path("reports/runs")


def report(run: str, *, category: str | None, beside: str | None, out: Path | None, pictures: bool) -> None:
    """Write the page of a run and its charts for papers, and print the files."""
    if category is not None and category not in set(Category):
        raise UnknownNameError("category", category, (known.value for known in Category))
    kind = None if category is None else Category(category)
    folder = run_folder(run)
    other = None if beside is None else run_folder(beside)
    with progress_bar("drawing frames", "pictures") as progress:
        page = write_page(folder, category=kind, out=out, other=other, pictures=pictures, progress=progress)
    for problem in page.problems:
        say(f"pictures missing: {problem}", style="yellow")
    files = (page.file, *write_figures(folder, category=kind))
    note_files([str(file) for file in files])


def compare(runs: Sequence[Path], *, out: Path | None, pictures: bool) -> None:
    """Compare the first run with each of the others; print tables, verdicts and files."""
    folder = out or RUNS / f"compare-{'-'.join(run.resolve().name for run in runs)}"
    with progress_bar("drawing what changed", "pictures") as report:
        comparisons, files = write_comparison(runs, folder, pictures=pictures, progress=report)
    for comparison in comparisons:
        show(terminal_report(comparison))
        counts = comparison.detections[-1]
        say(f"{counts.object_frames} object-frames, detected: {counts.before} before, {counts.after} after; "
             f"{counts.gained} newly detected, {counts.lost} newly missed")  # fmt: skip
        for told in comparison.notes:
            say(told)
        say(verdict_line(comparison), style="bold")
        say(category_line(comparison))
    for comparison in comparisons:
        for remark in comparison.remarks:
            say(remark, style="red")
    note_files([str(file) for file in files])


def leaderboard(folder: Path, *, out: Path | None, pictures: bool) -> int:
    """Print a table per group of comparable runs under a folder; return the number of runs that cannot be read."""
    found = read_leaderboard(folder)
    show(leaderboard_tables(found))
    for run, fault in found.damaged:
        say(f"damaged: {run}: {fault}", style="red")
    if out is not None:
        with progress_bar("drawing the same images", "runs") as progress:
            files, problems = write_leaderboard(found, out, pictures=pictures, progress=progress)
        for problem in problems:
            say(f"no picture: {problem}", style="yellow")
        note_files([str(file) for file in files])
    return len(found.damaged)
