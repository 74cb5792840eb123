"""Compare stored runs in pairs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bench.api.runs import Run, run_folder
from bench.harness.stages import Progress
from bench.reporting.compare.changes import RunComparison, compare_runs
from bench.reporting.compare.runs import read_comparable
from bench.reporting.compare.writing import write_comparison


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """Runs against the first of them.

    Attributes:
        pairs: the first run with each of the others: `changes`, the metrics of both with difference, interval, p-value
            and verdict, and `detections` and `frames`, what was gained and lost, are tables of pandas.
        files: that were written.
    """

    pairs: tuple[RunComparison, ...]
    files: tuple[Path, ...] = ()


def compare(
    *runs: str | Path | Run, out: str | Path | None = None, pictures: bool = True, progress: Progress | None = None
) -> Comparison:
    """Compare runs in pairs on the images that both scored, as `fisheye-bench compare` does.

    Args:
        runs: two or more, stored or by their folders; the first is compared against.
        out: folder of the report; None to write none.
        pictures: draw the frames that changed most into the report, from the data set.
        progress: called with the pictures done and their number, for each pair anew.

    Raises:
        DataError: a run is missing or damaged.
        UsageError: fewer than two runs, or runs that do not compare, as of other data or by another protocol.
    """
    folders = [run_folder(run) for run in runs]
    if out is None:
        return Comparison(pairs=tuple(compare_runs(read_comparable(folders))))
    pairs, files = write_comparison(folders, Path(out), pictures=pictures, progress=progress)
    return Comparison(pairs=tuple(pairs), files=files)
