"""A run at a glance: its headlines, the kinds of motion in one table, and statements that are read off the tables."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from bench.evaluation import Metric, find_metric
from bench.evaluation.definitions import IMAGE_FRAMES
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.summary import ObjectMetrics, Summary, not_annotated
from bench.evaluation.sums import CLASS_AND_SPEED
from bench.reference import Category
from bench.reporting.document import Cell, Paragraph, Style, Table
from bench.reporting.formats import LABELS, chance_of, headline_metrics, metric_cell, percent
from bench.reporting.page.tables import bound_note, breakdown_table

_HALF = "detection_rate_50"
# By name: caption, heading of the first column, and a row in words.
BREAKDOWNS = {
    "object_class": ("By class", "class", "class {}"),
    "range_m": ("By range", "nearest point (m)", "range {} m"),
    "speed_mps": ("By the object's own speed", "speed (m/s)", "speed {} m/s"),
    CLASS_AND_SPEED: ("By class and the object's own speed", "class, speed (m/s)", "{} m/s"),
    "ego_speed_mps": ("By speed of the ego vehicle", "speed (m/s)", "ego speed {} m/s"),
    "camera": ("By camera", "camera", "camera {}"),
    "points": ("By lidar points on the object", "points", "{} lidar points"),
}
LEAST_OBJECT_FRAMES = 10  # of fewer nothing is said


def against_chance(row: ObjectMetrics) -> tuple[Style, str, str]:
    """Compare the rate of object-frames of which half is found, or any pixel by a protocol without that level.

    Returns:
        style: "good" only where the 95 % interval lies wholly above chance.
        statement: of a row against chance; it is one of several that exclude each other.
        numbers: that it rests on.
    """
    half = _HALF if _HALF in row.metric_names() else "detection_rate"
    rate, chance = row.metric(half), row.metric(chance_of(half)).value
    if row.object_frames < LEAST_OBJECT_FRAMES:
        return "", f"Fewer than {LEAST_OBJECT_FRAMES} object-frames", f"({row.object_frames})"
    if math.isnan(chance):
        return "", "Without a chance level", ""
    if rate.ci95 is None:
        return "", f"Too few recordings to tell from chance, {FEWEST_RECORDINGS} are needed", f"({row.recordings})"
    condition = " when half of an object must be found" if half == _HALF else ""
    numbers = f"({percent(rate.value)}, by chance {percent(chance)})"
    if rate.ci95[0] > chance:
        return "good", f"Above chance{condition}", numbers
    return "bad", f"Not shown to be above chance{condition}", numbers


def kinds_of(found: Summary) -> dict[str, ObjectMetrics]:
    """The kinds of motion that have object-frames, by their labels, the lowest IoU first."""
    rows = {LABELS[name]: row for name, row in found.categories.items() if row.object_frames}
    return dict(sorted(rows.items(), key=lambda item: item[1].iou.value))


def kind_tables(found: Summary) -> list[Table]:
    """A row for each kind of motion in their order; no table without any."""
    kinds = kinds_of(found)
    title = "By kind of motion, the lowest IoU first"
    return [breakdown_table(title, "kind", kinds, lowest=lowest_of(kinds))] if kinds else []


def breakdowns(found: Summary) -> list[Table]:
    """One table for every way to sort the object-frames; the lowest row is marked where it is clearly lower.

    Of class x speed the slices without object-frames, which are most of them, are left out.
    """
    tables = dict(found.breakdowns)
    if CLASS_AND_SPEED in tables:
        tables[CLASS_AND_SPEED] = {name: row for name, row in tables[CLASS_AND_SPEED].items() if row.object_frames}
    return [
        breakdown_table(*BREAKDOWNS[name][:2], rows, lowest=lowest_of(rows)) for name, rows in tables.items() if rows
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


def remarks(found: Summary) -> list[Paragraph]:
    """List what a reader should know first: one statement on chance for each kind of motion; what is clearly lowest.

    The style of a statement is "good", "bad", or neither.
    """
    kinds = {label.lower(): row for label, row in kinds_of(found).items()}
    if not kinds:
        why = not_annotated(found) or "No object-frame was evaluated: there is nothing to say of moving objects."
        return [Paragraph(why)]
    chances: dict[tuple[Style, str], list[str]] = {}
    for label, row in kinds.items():
        style, statement, numbers = against_chance(row)
        chances.setdefault((style, statement), []).append(f"{label} {numbers}".rstrip())
    ordered = sorted(chances.items(), key=lambda item: ("good", "bad", "").index(item[0][0]))
    said = [Paragraph(f"{text}: {', '.join(named)}.", style) for (style, text), named in ordered]
    split = {"kind {}": kinds} | {words: found.breakdowns.get(name, {}) for name, (_, _, words) in BREAKDOWNS.items()}
    lowest = [(words, rows, lowest_of(rows)) for words, rows in split.items()]
    named = [f"{words.format(name)} with {percent(rows[name].iou.value)}" for words, rows, name in lowest if name]
    if named:
        said.append(Paragraph(f"IoU is clearly lower than elsewhere: {'; '.join(named)}.", "bad"))
    images = found.images
    if left := images.failed + images.skipped:
        text = f"{left} of {images.images} images could not be scored; the last section says why."
        said.append(Paragraph(text, "bad"))
    return said
