"""Report of a run that a command scores: the files beside its tables of counts, and what is printed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from bench.atomic import write_text
from bench.cli.console import note, note_files, print_failures, say, show
from bench.cli.progress import progress_bar, resumable
from bench.harness import Provenance, RunRequest, StoredRun, run_benchmark
from bench.harness.run import Finish
from bench.recordings import DatasetCard
from bench.reporting.findings import VALIDATION
from bench.reporting.frame_pictures import write_example_pictures
from bench.reporting.table_files import write_report_files
from bench.reporting.tables import TableRow, terminal_report
from bench.reporting.totals import cost_lines, total_lines
from bench.validation import ValidationReport

READ_FIRST = ("summary.json", "table.md", "range_map.png")


@dataclass(kw_only=True)
class RunReport:
    """Report of a run: the files written beside its tables of counts, and what is printed of them.

    Attributes:
        card: the data set.
        pictures: also draw an example frame of every category.
        validation: of the data; None where they were not validated.
    """

    card: DatasetCard
    pictures: bool
    validation: ValidationReport | None = None
    _rows: tuple[TableRow, ...] = ()
    _files: list[Path] = field(default_factory=list)
    _remarks: list[str] = field(default_factory=list)

    def write(self, run: StoredRun) -> None:
        """Write the report of new results and draw their pictures."""
        results = run.folder
        rows, files = write_report_files(run)
        drawn: list[Path] = []
        if self.pictures:
            with progress_bar("drawing", "pictures") as progress:
                drawn, self._remarks = write_example_pictures(run, card=self.card, progress=progress)
        self._rows = tuple(rows)
        if self.validation is not None:
            write_text(results / VALIDATION, self.validation.as_json())
            files = (*files, results / VALIDATION)
        every = (results / "summary.json", *files, *drawn)
        names = [file.relative_to(results) for file in every]
        self._files = sorted(names, key=lambda name: str(name) not in READ_FIRST)  # the first few are printed

    def print(self, run: StoredRun) -> None:
        """Print the table, what became of the images, the cost, and where everything is."""
        summary = run.summary
        show(terminal_report(self._rows))
        for line in total_lines(summary, run.protocol):
            note(line)
        print_cost(summary.provenance)
        print_failures(summary.failures, all_in="summary.json")
        note_files(run.folder / file for file in self._files)
        for remark in self._remarks:
            say(f"no picture: {remark}", style="yellow")


def score(
    request: RunRequest,
    *,
    title: str,
    pictures: bool,
    validation: ValidationReport | None = None,
    finish: Finish | None = None,
) -> dict[Path, StoredRun]:
    """Score runs, write the report of each and print it.

    Args:
        request: the runs.
        title: what goes on.
        pictures: also draw an example frame of every category.
        validation: of the data; None where they were not validated.
        finish: as of `run_benchmark`, before the report.
    """
    reports = {
        rules.name: RunReport(card=request.card, pictures=pictures, validation=validation)
        for rules in request.runs.values()
    }

    def write(run: StoredRun) -> None:
        if finish is not None:
            finish(run)
        reports[run.protocol.name].write(run)

    with resumable(next(iter(request.runs))):
        with progress_bar(title, "images") as progress:
            stored = run_benchmark(replace(request, progress=progress), finish=write)
        for run in stored.values():
            reports[run.protocol.name].print(run)
    return stored


def print_cost(made: Provenance) -> None:
    """Print what a run had to compute, and the time and memory that it took."""
    for line in cost_lines(made):
        note(line)
