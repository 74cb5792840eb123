"""Cells of the page's tables: a figure in words, and as a bar with its interval, its chance level and the paper's."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from bench.evaluation.summary import Figure, ObjectFigures
from bench.reporting.numbers import percent
from bench.reporting.tables import Comparison


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One figure to show.

    Attributes:
        text: for example "72.1 %".
        interval: for example "65.0 to 78.3"; empty without one.
        notes: lines below, for example "chance 12.0 %".
        value: length of the bar in percent; None without a bar.
        low: lower end of the interval in percent; None without.
        high: upper end.
        paper: where the paper's figure is marked, in percent; None without.
        weakest: whether it is the lowest of its group.
    """

    text: str
    interval: str = ""
    notes: tuple[str, ...] = ()
    value: float | None = None
    low: float | None = None
    high: float | None = None
    paper: float | None = None
    weakest: bool = False


def figure_cell(figure: Figure | Comparison, *, notes: tuple[str, ...] = (), weakest: bool = False) -> Cell:
    """A ratio."""
    if math.isnan(figure.value):
        return Cell(text=percent(figure.value, cases=figure.cases))
    low, high = (None, None) if figure.ci95 is None else (100 * figure.ci95[0], 100 * figure.ci95[1])
    theirs = getattr(figure, "paper", math.nan)
    return Cell(
        text=percent(figure.value),
        interval="" if low is None else f"{low:.1f} to {high:.1f}",
        notes=notes,
        value=100 * figure.value,
        low=low,
        high=high,
        paper=None if math.isnan(theirs) else 100 * theirs,
        weakest=weakest,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CellRow:
    """A row of cells; `name` heads it, `counts` are numbers in words."""

    name: str
    counts: tuple[str, ...]
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CellTable:
    """A table of the page."""

    caption: str
    headings: tuple[str, ...]
    rows: tuple[CellRow, ...]


BREAKDOWN_FIGURES = {
    "detection_rate": "found at all",
    "detection_rate_50": "half of it found",
    "tpr_all": "share found (TPR, all)",
    "iou": "IoU, all",
}


def figures_table(caption: str, first: str, rows: dict[str, ObjectFigures]) -> CellTable:
    """Rows of one breakdown, those without cases included; the lowest share found is marked where it is shown."""
    names = {n: h for n, h in BREAKDOWN_FIGURES.items() if all(n in row.figure_names() for row in rows.values())}
    lowest = lowest_of({name: row.tpr_all for name, row in rows.items()})
    return CellTable(
        caption=caption,
        headings=(first, "recordings", "object-frames", "objects", *names.values()),
        rows=tuple(
            CellRow(
                name=name,
                counts=(str(row.recordings), str(row.object_frames), str(row.tracks)),
                cells=tuple(
                    figure_cell(
                        row.figure(n),
                        notes=_chance(row, n),
                        weakest=n == "tpr_all" and name == lowest,
                    )
                    for n in names
                ),
            )
            for name, row in rows.items()
        ),
    )


def lowest_of(figures: Mapping[str, Figure]) -> str | None:
    """The lowest of several figures by name; None where no interval of another lies wholly above its own."""
    known = {name: figure for name, figure in figures.items() if figure.ci95 is not None}
    lowest = min(known, key=lambda name: known[name].value, default=None)
    if lowest is None or min(f.value for f in figures.values() if not math.isnan(f.value)) < known[lowest].value:
        return None
    return lowest if any(clearly_below(known[lowest], other) for other in known.values()) else None


def clearly_below(figure: Figure, other: Figure) -> bool:
    """Whether both have intervals and the one lies wholly below the other."""
    return figure.ci95 is not None and other.ci95 is not None and figure.ci95[1] < other.ci95[0]


def _chance(row: ObjectFigures, name: str) -> tuple[str, ...]:
    if not name.startswith("detection_rate"):
        return ()
    chance = row.figure(name.replace("detection_rate", "chance"))
    return () if math.isnan(chance.value) else (f"chance {percent(chance.value)}",)
