"""How figures are written for people, the same in every table."""

from __future__ import annotations

import math

from bench.reporting.tables import Comparison


def percent(ratio: float, *, cases: int = 0, digits: int = 1) -> str:
    """A ratio as "72.1 %"; "n/a (0 cases)" for NaN."""
    return f"n/a ({cases} cases)" if math.isnan(ratio) else f"{100 * ratio:.{digits}f} %"


def ours(figure: Comparison) -> str:
    """Our figure, for example "72.1 %"."""
    return percent(figure.value, cases=figure.cases)


def interval(figure: Comparison) -> str:
    """Our 95 % interval in percent, for example "[65.0, 78.3]"; empty where there is none."""
    return "" if figure.ci95 is None else f"[{100 * figure.ci95[0]:.1f}, {100 * figure.ci95[1]:.1f}]"


def ours_with_interval(figure: Comparison) -> str:
    """For example "72.1 % [65.0, 78.3]"."""
    return f"{ours(figure)} {interval(figure)}".rstrip()


def paper(figure: Comparison) -> str:
    """The paper's figure as it prints it, for example "72 %"; empty where it has none."""
    return "" if math.isnan(figure.paper) else percent(figure.paper, digits=0)


def difference(figure: Comparison) -> str:
    """Ours minus the paper's in percentage points, for example "+0.1"; empty where either is missing."""
    return "" if math.isnan(figure.difference_points) else f"{figure.difference_points:+.1f}"


def mean(figure: Comparison) -> str:
    """A mean that is no ratio, for example "3.2 [2.8, 3.9]"."""
    if math.isnan(figure.value):
        return f"n/a ({figure.cases} cases)"
    bounds = "" if figure.ci95 is None else f" [{figure.ci95[0]:.1f}, {figure.ci95[1]:.1f}]"
    return f"{figure.value:.1f}{bounds}"


def count(number: int | None) -> str:
    """A count as "3848"; empty for None."""
    return "" if number is None else str(number)
