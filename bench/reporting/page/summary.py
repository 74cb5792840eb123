"""A run at a glance: its headlines, the kinds of motion in one table, and statements that are read off the tables."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from bench.evaluation import Metric, find_metric
from bench.evaluation.definitions import IMAGE_FRAMES
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.summary import ObjectMetrics, Summary, not_annotated
from bench.reference import Category
from bench.reporting.document import Cell, Style, Table
from bench.reporting.formats import LABELS, chance_of, headline_metrics, metric_cell, percent
from bench.reporting.page.tables import bound_note, breakdown_table

_HALF = "detection_rate_50"
# By name: caption, heading of the first column, and a row in words.
BREAKDOWNS = {
    "object_class": ("By class", "class", "class {}"),
    "range_m": ("By range", "nearest point (m)", "range {} m"),
    "ego_speed_mps": ("By speed of the ego vehicle", "speed (m/s)", "ego speed {} m/s"),
    "camera": ("By camera", "camera", "camera {}"),
    "points": ("By lidar points on the object", "points", "{} lidar points"),
}
LEAST_OBJECT_FRAMES = 10  # of fewer nothing is said


class Standing(StrEnum):
    """Result of a kind of motion against chance, when half of an object must be found."""

    ABOVE = "Above chance"
    NOT_SHOWN = "Not shown to be above chance"
    FEW_RECORDINGS = "Too few recordings to tell from chance"
    FEW_CASES = f"Fewer than {LEAST_OBJECT_FRAMES} object-frames"
    NO_CHANCE = "Without a chance level"


_STYLES: dict[Standing, Style] = {Standing.ABOVE: "good", Standing.NOT_SHOWN: "bad"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """A kind of motion with object-frames: a row of the table, and what the statements are made of.

    Attributes:
        label: for people.
        row: its metrics.
        half: rate of object-frames of which half is found, or any pixel by a protocol without that level.
        standing: of that rate against chance.
    """

    label: str
    row: ObjectMetrics
    half: str
    standing: Standing


def kinds_of(found: Summary) -> list[Kind]:
    """The kinds of motion that have object-frames, the lowest IoU first."""
    rows = {name: row for name, row in found.categories.items() if row.object_frames}
    ordered = sorted(rows, key=lambda name: rows[name].iou.value)
    return [_kind(name, rows[name]) for name in ordered]


def _kind(name: str, row: ObjectMetrics) -> Kind:
    half = _HALF if _HALF in row.metric_names() else "detection_rate"
    return Kind(label=LABELS[name], row=row, half=half, standing=_standing(row, half))


def _standing(row: ObjectMetrics, half: str) -> Standing:
    rate, chance = row.metric(half), row.metric(chance_of(half)).value
    if row.object_frames < LEAST_OBJECT_FRAMES:
        return Standing.FEW_CASES
    if math.isnan(chance):
        return Standing.NO_CHANCE
    if rate.ci95 is None:
        return Standing.FEW_RECORDINGS
    return Standing.ABOVE if rate.ci95[0] > chance else Standing.NOT_SHOWN


def kind_table(kinds: list[Kind]) -> Table:
    """A row for each kind of motion in their order."""
    rows = {kind.label: kind.row for kind in kinds}
    return breakdown_table("By kind of motion, the lowest IoU first", "kind", rows, lowest=lowest_of(rows))


def breakdowns(found: Summary) -> list[Table]:
    """One table for every way to sort the object-frames; the lowest row is marked where it is clearly lower."""
    return [
        breakdown_table(*BREAKDOWNS[name][:2], rows, lowest=lowest_of(rows))
        for name, rows in found.breakdowns.items()
        if rows
    ]


def lowest_of(rows: Mapping[str, ObjectMetrics]) -> str | None:
    """The row with the lowest IoU; None where no interval of another lies wholly above its own."""
    known = {name: row.iou for name, row in rows.items() if row.object_frames >= LEAST_OBJECT_FRAMES and row.iou.ci95}
    lowest = min(known, key=lambda name: known[name].value, default=None)
    if lowest is None or not any(clearly_below(known[lowest], other) for other in known.values()):
        return None
    return lowest


def clearly_below(metric: Metric, other: Metric) -> bool:
    """True if both have intervals and the one lies wholly below the other."""
    return metric.ci95 is not None and other.ci95 is not None and metric.ci95[1] < other.ci95[0]


def tiles(found: Summary, *, category: Category | None) -> list[tuple[str, Cell]]:
    """Label and value of the headline metrics; of one kind of motion without the false positives, which have none."""
    row, shown = found.all_moving, []
    few = f"{row.object_frames} object-frames, fewer than {LEAST_OBJECT_FRAMES}"
    for name, metric in headline_metrics(found).items():
        label = find_metric(name).label
        if find_metric(name).over == IMAGE_FRAMES:
            if category is None:
                shown.append((label, _tile(metric, f"of the image wrongly marked; over {metric.cases} images")))
        elif row.object_frames < LEAST_OBJECT_FRAMES:
            shown.append((label, Cell("n/a", (few,))))
        else:
            about = [bound_note(name, row), f"over {row.object_frames} object-frames"]
            shown.append((label, _tile(metric, "; ".join(filter(None, about)))))
    return shown


def _tile(metric: Metric, about: str) -> Cell:
    cell = metric_cell(metric)
    return replace(cell, below=(*cell.below, about))


@dataclass(frozen=True, slots=True, kw_only=True)
class Remark:
    """One statement; `style` gives its mark."""

    style: Style
    text: str


def remarks(found: Summary, kinds: list[Kind]) -> list[Remark]:
    """List what a reader should know first: one statement on chance for each kind of motion; what is clearly lowest.

    Args:
        found: metrics of a run.
        kinds: of it, as the table has them.
    """
    if not kinds:
        why = not_annotated(found) or "No object-frame was evaluated: there is nothing to say of moving objects."
        return [Remark(style="", text=why)]
    said = []
    for standing in Standing:
        named = [f"{kind.label.lower()} {_beside(kind)}" for kind in kinds if kind.standing is standing]
        if named:
            text = f"{standing}{_condition(standing, kinds[0].half)}: {', '.join(named)}."
            said.append(Remark(style=_STYLES.get(standing, ""), text=text))
    lowest = [("kind {}", {kind.label.lower(): kind.row for kind in kinds})]
    lowest += [(words, found.breakdowns.get(name, {})) for name, (_, _, words) in BREAKDOWNS.items()]
    named = [
        f"{words.format(name)} with {percent(rows[name].iou.value)}"
        for words, rows in lowest
        if (name := lowest_of(rows)) is not None
    ]
    if named:
        said.append(Remark(style="bad", text=f"IoU is clearly lower than elsewhere: {'; '.join(named)}."))
    images = found.images
    if left := images.failed + images.skipped:
        text = f"{left} of {images.images} images could not be scored; the last section says why."
        said.append(Remark(style="bad", text=text))
    return said


def _condition(standing: Standing, half: str) -> str:
    if standing is Standing.FEW_RECORDINGS:
        return f", {FEWEST_RECORDINGS} are needed"
    return " when half of an object must be found" if standing in _STYLES and half == _HALF else ""


def _beside(kind: Kind) -> str:
    """Return the numbers that the statement on a kind rests on, in parentheses."""
    rate, chance = kind.row.metric(kind.half), kind.row.metric(chance_of(kind.half)).value
    if kind.standing is Standing.FEW_CASES:
        return f"({kind.row.object_frames})"
    if kind.standing in _STYLES:
        return f"({percent(rate.value)}, by chance {percent(chance)})"
    return f"({kind.row.recordings})" if kind.standing is Standing.FEW_RECORDINGS else ""
