"""Runs that a command scores: how far they are, and what is printed of each."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from bench.commands.console import note, note_files, print_blocks, print_failures, say
from bench.commands.progress import Report, progress_bar, resumable

if TYPE_CHECKING:
    from bench.api.run_report import RunReport
    from bench.harness import Provenance, RunRequest, StoredRun
    from bench.harness.run import Finish
    from bench.validation import ValidationReport


def score(
    request: RunRequest,
    *,
    pictures: bool,
    validation: ValidationReport | None = None,
    finish: Finish | None = None,
    progress: Report | None = None,
) -> list[tuple[StoredRun, RunReport]]:
    """Score a method and write the report of each protocol, with bars; arguments as of `score_with_reports`."""
    from bench.api.run_report import score_with_reports

    title = f"scoring {request.method.name} on {request.card.name}"
    with resumable(request.folder), progress_bar(title, "images", progress) as report:
        return score_with_reports(
            replace(request, progress=report),
            pictures=pictures,
            validation=validation,
            finish=finish,
            drawing=partial(progress_bar, "drawing", "pictures"),
        )


def print_run(run: StoredRun, report: RunReport) -> None:
    """Print the table, what became of the images, the cost, and where everything is."""
    from bench.reporting.run_tables import nothing_scored, odd_masks, terminal_report, total_lines

    summary = run.summary
    for warning in filter(None, (nothing_scored(summary), odd_masks(run), *run.manifest.dataset.same_data)):
        say(warning, style="bold red")
    print_blocks(terminal_report(report.rows, title=f"{run.manifest.title}, beside the paper, in percent"))
    for line in total_lines(summary, run.protocol):
        note(line)
    print_cost(summary.provenance)
    print_failures(summary.failures, all_in="summary.json")
    note_files(run.folder / file for file in report.files)
    for remark in report.remarks:
        say(f"no picture: {remark}", style="yellow")


def print_cost(made: Provenance) -> None:
    """Print what a run had to compute, and the time and memory that it took."""
    from bench.reporting.run_tables import cost_lines

    for line in cost_lines(made):
        note(line)
