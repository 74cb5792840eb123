"""A run at a glance: its headlines, the kinds of motion and other breakdowns as tables, statements read off them."""

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
from bench.reporting.document import Bar, Cell, Paragraph, Style, Table
from bench.reporting.formats import LABELS, chance_of, headline_metrics, metric_cell, percent

_HALF = "detection_rate_50"
LEAST_OBJECT_FRAMES = 10  # of fewer nothing is said
COUNTS = ("object-frames", "objects", "recordings")
BREAKDOWN_METRICS = ("iou", "tpr_all", "detection_rate_50", "detection_rate", "unknown_share")
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


def against_chance(row: ObjectMetrics) -> tuple[Style, str, str]:
    """Compare the rate of object-frames of which half is found, or any pixel by a protocol without that level.

    Returns:
        style: "bad" where the rate is not shown to be above chance; to be above it is the least and no praise.
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
        return "", f"Above chance{condition}", numbers
    return "bad", f"Not shown to be above chance{condition}", numbers


def _kinds(metrics: Summary) -> dict[str, ObjectMetrics]:
    """The kinds of motion that have object-frames, by their labels, the lowest IoU first."""
    rows = {LABELS[name]: row for name, row in metrics.categories.items() if row.object_frames}
    return dict(sorted(rows.items(), key=lambda item: item[1].iou.value))


def kind_tables(metrics: Summary) -> list[Table]:
    """A row for each kind of motion in their order; no table without any."""
    kinds = _kinds(metrics)
    return [breakdown_table("By kind of motion, the lowest IoU first", "kind", kinds)] if kinds else []


def breakdowns(metrics: Summary) -> list[Table]:
    """One table for every way to sort the object-frames.

    Of class x speed the slices without object-frames, which are most of them, are left out.
    """
    tables = dict(metrics.breakdowns)
    if CLASS_AND_SPEED in tables:
        tables[CLASS_AND_SPEED] = {name: row for name, row in tables[CLASS_AND_SPEED].items() if row.object_frames}
    return [breakdown_table(*BREAKDOWNS[name][:2], rows) for name, rows in tables.items() if rows]


def lowest_of(rows: Mapping[str, ObjectMetrics]) -> str | None:
    """The row with the lowest IoU; None where no interval of another lies wholly above its own."""
    known = {name: row.iou for name, row in rows.items() if row.object_frames >= LEAST_OBJECT_FRAMES and row.iou.ci95}
    lowest = min(known, key=lambda name: known[name].value, default=None)
    if lowest is None or not any(_clearly_below(known[lowest], other) for other in known.values()):
        return None
    return lowest


def _clearly_below(metric: Metric, other: Metric) -> bool:
    """True if both have intervals and the one lies wholly below the other."""
    return metric.ci95 is not None and other.ci95 is not None and metric.ci95[1] < other.ci95[0]


def tiles(metrics: Summary, *, category: Category | None) -> Table:
    """The headline metrics as cards; of one kind of motion without the false positives, which have none."""
    row, shown = metrics.all_moving, dict[str, Cell]()
    few = f"{row.object_frames} object-frames, fewer than {LEAST_OBJECT_FRAMES}"
    for name, metric in headline_metrics(metrics).items():
        label, cell = find_metric(name).label, replace(metric_cell(metric), style="strong")
        if find_metric(name).over == IMAGE_FRAMES:
            about = f"of the image wrongly marked; over {metric.cases} images"
            if category is None:
                shown[label] = replace(cell, below=(*cell.below, about))
        elif row.object_frames < LEAST_OBJECT_FRAMES:
            shown[label] = Cell("n/a", (few,), "strong")
        else:
            about = "; ".join(filter(None, (_bound_note(name, row), f"over {row.object_frames} object-frames")))
            shown[label] = replace(cell, below=(*cell.below, about))
    return Table(columns=list(shown), rows=[list(shown.values())], words=0, look="tiles")


def remarks(metrics: Summary) -> list[Paragraph]:
    """List what a reader should know first: one statement on chance for each kind of motion; what is clearly lowest."""
    kinds = {label.lower(): row for label, row in _kinds(metrics).items()}
    if not kinds:
        why = not_annotated(metrics) or "No object-frame was evaluated: there is nothing to say of moving objects."
        return [Paragraph(why, "warn")]
    chances: dict[tuple[Style, str], list[str]] = {}
    for label, row in kinds.items():
        style, statement, numbers = against_chance(row)
        chances.setdefault((style, statement), []).append(f"{label} {numbers}".rstrip())
    ordered = sorted(chances.items(), key=lambda item: item[0][0] != "bad")
    said = [Paragraph(f"{text}: {', '.join(named)}.", style) for (style, text), named in ordered]
    split = {"kind {}": kinds} | {words: metrics.breakdowns.get(name, {}) for name, (_, _, words) in BREAKDOWNS.items()}
    lowest = [(words, rows, lowest_of(rows)) for words, rows in split.items()]
    named = [f"{words.format(name)} with {percent(rows[name].iou.value)}" for words, rows, name in lowest if name]
    if named:
        said.append(Paragraph(f"IoU is clearly lower than elsewhere: {'; '.join(named)}.", "bad"))
    images = metrics.images
    if left := images.failed + images.skipped:
        text = f"{left} of {images.images} images could not be scored; the last section says why."
        said.append(Paragraph(text, "bad"))
    return said


def bar_cell(metric: Metric, *notes: str, lowest: bool = False) -> Cell:
    """A metric with its bar, and its interval and notes below."""
    cell = metric_cell(metric)
    if math.isnan(metric.value):
        return cell
    below = tuple(filter(None, ("lowest" if lowest else "", *cell.below, *notes)))
    bar = Bar(share=metric.value, interval=metric.ci95)
    return replace(cell, below=below, style="bad" if lowest else "strong", bar=bar)


def _bound_note(name: str, row: ObjectMetrics) -> str:
    """Return what bounds a metric of a row: the chance level of a detection rate, the ceiling of IoU; "" for none."""
    other = chance_of(name) if name.startswith("detection_rate") else f"ceiling_{name}"
    if other not in row.metric_names() or name == "tpr_all" or math.isnan(row.metric(other).value):
        return ""
    return f"{other.partition('_')[0]} {percent(row.metric(other).value)}"


def breakdown_table(caption: str, heading: str, rows: Mapping[str, ObjectMetrics]) -> Table:
    """One way to sort the object-frames; the lowest row is marked where it is clearly lower.

    Args:
        caption: of the table.
        heading: of its first column.
        rows: by name, those without cases included; what all of them have is shown.
    """
    metrics = [name for name in BREAKDOWN_METRICS if all(name in row.metric_names() for row in rows.values())]
    lowest = lowest_of(rows)
    return Table(
        title=caption,
        columns=[heading, *(find_metric(name).label for name in metrics), *COUNTS],
        rows=[
            [key]
            + [bar_cell(row.metric(n), _bound_note(n, row), lowest=n == "iou" and key == lowest) for n in metrics]
            + [row.object_frames, row.tracks, row.recordings]
            for key, row in rows.items()
        ],
    )
