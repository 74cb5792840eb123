"""How the gate writes numbers and rows, the same for people, JUnit and annotations."""

from __future__ import annotations

import math

from bench.evaluation.metric_sums import NOT_RATIOS
from bench.gate.verdict import Outcome, Row


def value_text(metric: str, value: float) -> str:
    """A figure: "72.1 %", "3.2" for a mean that is no ratio, "n/a" for NaN."""
    if math.isnan(value):
        return "n/a"
    return f"{value:.2f}" if metric in NOT_RATIOS else f"{100 * value:.1f} %"


def change_text(metric: str, difference: float) -> str:
    """A difference: "-3.2 pt" in percentage points, "+0.40" for a mean that is no ratio, "n/a" for NaN."""
    if math.isnan(difference):
        return "n/a"
    return f"{difference:+.2f}" if metric in NOT_RATIOS else f"{100 * difference:+.1f} pt"


def interval_text(metric: str, interval: tuple[float, float] | None) -> str:
    """The interval of a difference: "[-5.1, -1.2]"; "" where there is none."""
    if interval is None:
        return ""
    low, high = interval
    return f"[{low:+.2f}, {high:+.2f}]" if metric in NOT_RATIOS else f"[{100 * low:+.1f}, {100 * high:+.1f}]"


def allowed_text(metric: str, allowed: float) -> str:
    """What is tolerated: "1.5 pt", "4.50", "" for NaN."""
    if math.isnan(allowed):
        return ""
    return f"{allowed:.2f}" if metric in NOT_RATIOS else f"{100 * allowed:.1f} pt"


def row_text(row: Row) -> str:
    """A row in one line: "tpr_all of overtaking: 98.6 % -> 79.2 %, -19.4 pt [-24.1, -13.3], tolerated 2.0 pt"."""
    metric, change = row.metric, row.change
    told = (
        f"{metric} of {row.slice_name}: {value_text(metric, change.before)} -> {value_text(metric, change.after)}, "
        f"{change_text(metric, change.difference)} {interval_text(metric, change.ci95)}"
    ).rstrip()
    if not math.isnan(row.allowed):
        told += f", tolerated {allowed_text(metric, row.allowed)}"
    if row.worst_recording is not None and row.outcome in {Outcome.FAILED, Outcome.SUSPECT}:
        told += f"; most in {row.worst_recording}"
    return f"{told}; {row.reason}" if row.reason else told
