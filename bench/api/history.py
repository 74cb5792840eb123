"""A method's headline metrics over commits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from bench.reporting.history import History, Series, read_history, write_history


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HistoryReport:
    """Runs over commits.

    Attributes:
        found: what was read, and what could not be.
        files: that were written.
    """

    found: History
    files: tuple[Path, ...] = ()

    @property
    def series(self) -> Mapping[str, Series]:
        """By method, data set and protocol in words, its runs in order, each with `name`, `metrics` and `change`."""
        return self.found.series


def history(*runs: str | Path, out: str | Path | None = None, checkout: str | Path | None = None) -> HistoryReport:
    """Read a method's headline metrics over commits, and what changed, as `fisheye-bench history` does.

    Args:
        runs: folders of runs, or folders that hold runs at any depth.
        out: folder of charts and texts; None to write none.
        checkout: a folder in the repository that knows the times of commits; None for the working folder.

    Raises:
        DataError: a folder holds no run, or no method has two.
    """
    found = read_history([Path(run) for run in runs], checkout=Path.cwd() if checkout is None else Path(checkout))
    return HistoryReport(found=found, files=() if out is None else write_history(found, Path(out)))
