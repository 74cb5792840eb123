"""A sweep: a run for each of several values of one setting, each in a folder of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from bench.harness import RunRequest, RunSummary, run_benchmark
from bench.harness.stages import Progress, part_of
from bench.reporting.formats import file_name
from bench.reporting.table_files import write_report_files


def run_values(
    requests: Mapping[str, RunRequest], folder: Path, *, progress: Progress | None = None
) -> dict[str, RunSummary]:
    """Score a run for each value and store it, with its tables and range maps, in a folder named after the value.

    Values that are done are not computed again.

    Args:
        requests: by value, as `bench.api.runs.run_request` assembles them, each one run; their folders are not used.
        folder: of the sweep.
        progress: called with the values done, fractions allowed, and their number.

    Returns:
        Summaries by value, for `bench.reporting.sweep.write_sweep`.

    Raises:
        DataError: nothing of the data set could be used.
    """
    summaries = {}
    with next(iter(requests.values())).executor as executor:  # of all values, so that workers start once
        for number, (value, request) in enumerate(requests.items()):
            (rules,) = request.runs.values()
            run = replace(
                request,
                runs={folder / (file_name(value).lstrip(".") or "_"): rules},
                executor=executor,
                progress=part_of(progress, number=number, total=len(requests)),
            )
            (stored,) = run_benchmark(run, finish=write_report_files).values()
            summaries[value] = stored.summary
    return summaries
