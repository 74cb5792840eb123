"""Runs with the report of each: the files beside its tables of counts."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from bench.atomic import write_text
from bench.harness import RunRequest, StoredRun, run_benchmark
from bench.harness.run import Finish
from bench.harness.stages import Progress, no_progress
from bench.reporting.findings import VALIDATION
from bench.reporting.frame_pictures import write_example_pictures
from bench.reporting.run_tables import TableRow, write_report_files
from bench.validation import ValidationReport

READ_FIRST = ("summary.json", "table.md", "range_map.png")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunReport:
    """Report of a run by one protocol.

    Attributes:
        rows: of its table.
        files: in its folder, those that are read first in front.
        remarks: why pictures could not be drawn, one line each.
    """

    rows: tuple[TableRow, ...]
    files: tuple[Path, ...]
    remarks: tuple[str, ...]


def score_with_reports(
    request: RunRequest,
    *,
    pictures: bool = False,
    validation: ValidationReport | None = None,
    finish: Finish | None = None,
    drawing: Callable[[], AbstractContextManager[Progress]] = lambda: nullcontext(no_progress),
) -> list[tuple[StoredRun, RunReport]]:
    """Score a method and write the report of each protocol beside its results.

    Args:
        request: the run.
        pictures: also draw an example frame of every category.
        validation: of the data; None where they were not validated.
        finish: as of `run_benchmark`, before the report.
        drawing: begins to show how many pictures are drawn.

    Returns:
        The results by each protocol.

    Raises:
        DataError: nothing of the data set could be used, or the folder holds another run.
    """
    reports: list[RunReport] = []

    def write(run: StoredRun) -> None:
        results = run.folder
        if finish is not None:
            finish(run)
        rows, files = write_report_files(run)
        drawn, remarks = list[Path](), list[str]()
        if pictures:
            with drawing() as progress:
                drawn, remarks = write_example_pictures(run, card=request.card, progress=progress)
        if validation is not None:
            write_text(results / VALIDATION, validation.as_json())
            files = (*files, results / VALIDATION)
        names = [file.relative_to(results) for file in (results / "summary.json", *files, *drawn)]
        names.sort(key=lambda name: str(name) not in READ_FIRST)
        reports.append(RunReport(rows=tuple(rows), files=tuple(names), remarks=tuple(remarks)))

    stored = run_benchmark(request, finish=write)
    return list(zip(stored, reports, strict=True))
