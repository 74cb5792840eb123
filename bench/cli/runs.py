"""Runs that a command scores: how far they are, and what is printed of each."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from bench.api.run_report import RunReport, score_with_reports
from bench.cli.console import note, note_files, print_failures, say, show
from bench.cli.progress import progress_bar, resumable
from bench.harness import Provenance, RunRequest, StoredRun
from bench.harness.run import Finish
from bench.reporting.tables import terminal_report
from bench.reporting.totals import cost_lines, nothing_scored, odd_masks, total_lines
from bench.validation import ValidationReport


def score(
    request: RunRequest,
    *,
    title: str,
    pictures: bool,
    validation: ValidationReport | None = None,
    finish: Finish | None = None,
) -> list[StoredRun]:
    """Score runs with their reports and print what was found.

    Args:
        request: the runs.
        title: what goes on.
        pictures: also draw an example frame of every category.
        validation: of the data; None where they were not validated.
        finish: as of `run_benchmark`, before the report.
    """
    with resumable(request.folder):
        with progress_bar(title, "images") as progress:
            scored = score_with_reports(
                replace(request, progress=progress),
                pictures=pictures,
                validation=validation,
                finish=finish,
                drawing=partial(progress_bar, "drawing", "pictures"),
            )
        for run, report in scored:
            _print(run, report)
    return [run for run, _ in scored]


def _print(run: StoredRun, report: RunReport) -> None:
    """Print the table, what became of the images, the cost, and where everything is."""
    summary = run.summary
    for warning in filter(None, (nothing_scored(summary), odd_masks(run), *run.manifest.dataset.same_data)):
        say(warning, style="bold red")
    show(terminal_report(report.rows, title=f"{run.manifest.title}, beside the paper, in percent"))
    for line in total_lines(summary, run.protocol):
        note(line)
    print_cost(summary.provenance)
    print_failures(summary.failures, all_in="summary.json")
    note_files(run.folder / file for file in report.files)
    for remark in report.remarks:
        say(f"no picture: {remark}", style="yellow")


def print_cost(made: Provenance) -> None:
    """Print what a run had to compute, and the time and memory that it took."""
    for line in cost_lines(made):
        note(line)
