"""A run in a few sentences, and its breakdowns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from bench.evaluation import Metric
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.summary import ObjectMetrics, Summary
from bench.reference import Category
from bench.reporting.formats import LABELS, chance_of, interval, percent

NEAR_CHANCE = 0.05
_HALF = "detection_rate_50"
# By name: caption, heading of the first column, and a row in words.
BREAKDOWNS = {
    "object_class": ("By class", "class", "class {}"),
    "range_m": ("By range", "nearest point (m)", "range {} m"),
    "ego_speed_mps": ("By speed of the ego vehicle", "speed (m/s)", "ego speed {} m/s"),
    "camera": ("By camera", "camera", "camera {}"),
    "points": ("By lidar points on the object", "points", "{} lidar points"),
}
BREAKDOWN_METRICS = {
    "iou": "IoU, all",
    "tpr_all": "share found (TPR, all)",
    "detection_rate_50": "half of it found",
    "detection_rate": "found at all",
    "unknown_share": "unknown",
}
LEAST_OBJECT_FRAMES = 10  # of fewer nothing is said


@dataclass(frozen=True, slots=True, kw_only=True)
class Breakdown:
    """The object-frames sorted in one way.

    Attributes:
        caption: of the table.
        heading: of its first column.
        rows: by name, those without cases included.
        metrics: that all rows have, with their headings.
        lowest: the row with the lowest TPR over all; None where no other is clearly better.
    """

    caption: str
    heading: str
    rows: Mapping[str, ObjectMetrics]
    metrics: Mapping[str, str]
    lowest: str | None


def breakdowns(found: Summary) -> list[Breakdown]:
    """One for every way to sort the object-frames, first by kind of motion where there are several."""
    kinds = {name.replace("_", " "): row for name, row in found.categories.items()}
    several = len([row for row in kinds.values() if row.object_frames]) > 1
    tables = [breakdown("By kind of motion", "kind", {"all": found.all_moving} | kinds)] if several else []
    return [*tables, *(breakdown(*BREAKDOWNS[name][:2], rows) for name, rows in found.breakdowns.items() if rows)]


def breakdown(caption: str, heading: str, rows: Mapping[str, ObjectMetrics]) -> Breakdown:
    """One way to sort the object-frames."""
    metrics = {n: h for n, h in BREAKDOWN_METRICS.items() if all(n in row.metric_names() for row in rows.values())}
    lowest = lowest_of({name: row.tpr_all for name, row in rows.items() if row.object_frames >= LEAST_OBJECT_FRAMES})
    return Breakdown(caption=caption, heading=heading, rows=rows, metrics=metrics, lowest=lowest)


def lowest_of(metrics: Mapping[str, Metric]) -> str | None:
    """The lowest of several by name; None where no interval of another lies wholly above its own."""
    values = {name: metric.value for name, metric in metrics.items() if not math.isnan(metric.value)}
    lowest = min(values, key=lambda name: (values[name], metrics[name].ci95 is None), default=None)
    if lowest is None or not any(clearly_below(metrics[lowest], other) for other in metrics.values()):
        return None
    return lowest


def clearly_below(metric: Metric, other: Metric) -> bool:
    """Whether both have intervals and the one lies wholly below the other."""
    return metric.ci95 is not None and other.ci95 is not None and metric.ci95[1] < other.ci95[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class Remark:
    """One sentence; `kind` gives its mark."""

    kind: Literal["good", "bad", "note"]
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """One number that the page begins with.

    Attributes:
        name: of the metric.
        metric: its value and interval; None where there are too few object-frames for it.
        beside: what it is compared with.
    """

    name: str
    metric: Metric | None
    beside: str


def tiles(found: Summary, *, category: Category | None) -> list[Tile]:
    """IoU beside its ceiling, what is wrongly marked, and TPR."""
    row = found.all_moving
    few = row.object_frames < LEAST_OBJECT_FRAMES
    over = f"over {row.object_frames} object-frames"
    iou, ceiling = over, row.metric("ceiling_iou") if "ceiling_iou" in row.metric_names() else None
    if few:
        over = iou = f"{row.object_frames} object-frames, fewer than {LEAST_OBJECT_FRAMES}"
    elif ceiling is not None and not math.isnan(ceiling.value):
        iou = f"ceiling {percent(ceiling.value)}: what exact masks get; {over}"
    shown = [Tile(name="IoU, all", metric=None if few else row.iou, beside=iou)]
    if category is None:
        area = found.false_positives
        text = f"of the image wrongly marked; over {area.frames} images"
        shown.append(Tile(name="False positives", metric=area.coverage if area.frames else None, beside=text))
    return [
        *shown,
        Tile(name="TPR, all", metric=None if few else row.tpr_all, beside=f"of an object is marked; {over}"),
    ]


def remarks(found: Summary, *, category: Category | None) -> list[Remark]:
    """What a reader should know first, of nothing that has fewer than ten object-frames."""
    with_cases = {name: row for name, row in found.categories.items() if row.object_frames}
    rows = {name: row for name, row in with_cases.items() if row.object_frames >= LEAST_OBJECT_FRAMES}
    if not with_cases:
        return [Remark(kind="note", text="No object-frame was evaluated: there is nothing to say of moving objects.")]
    said = [*(_best_and_worst(rows) if rows else ()), *_by_chance(rows), *_weak_slices(found)]
    if few := [f"{_name(name).lower()} ({row.object_frames})" for name, row in with_cases.items() if name not in rows]:
        text = f"Nothing is said of fewer than {LEAST_OBJECT_FRAMES} object-frames: {', '.join(few)}."
        said.append(Remark(kind="note", text=text))
    return said if category is not None else [*said, *_of_images(found)]


def _best_and_worst(rows: dict[str, ObjectMetrics]) -> list[Remark]:
    """The weakest and the best kind of motion where their intervals lie apart; else the lowest, and all as they are."""
    known = {name: row.tpr_all for name, row in rows.items() if row.tpr_all.ci95 is not None}
    order = sorted(known, key=lambda name: known[name].value)
    if len(order) > 1 and clearly_below(known[order[0]], known[order[-1]]):
        left = [f"{_name(n).lower()} ({row.recordings})" for n, row in rows.items() if n not in known]
        few = f" Left out, with fewer than {FEWEST_RECORDINGS} recordings: {', '.join(left)}." if left else ""
        return [
            Remark(kind="bad", text=f"Weakest: {_name(order[0]).lower()}, {_found(rows[order[0]])}."),
            Remark(kind="good", text=f"Best: {_name(order[-1]).lower()}, {_found(rows[order[-1]])}.{few}"),
        ]
    if len(rows) == 1:
        return [Remark(kind="note", text=f"{_name(name)}: {_found(row)}.") for name, row in rows.items()]
    shares = ", ".join(f"{_name(name).lower()} {percent(row.tpr_all.value)}" for name, row in rows.items())
    text = f"Share of an object that is found, on average: {shares}; the recordings are too few to call one the best."
    return [_lowest(rows), Remark(kind="note", text=text)]


def _lowest(rows: Mapping[str, ObjectMetrics]) -> Remark:
    """The lowest kind of motion of several as it is, whether or not another run would find the same."""
    name = min(rows, key=lambda name: rows[name].iou.value)
    row, (rate, chance) = rows[name], _of_half(rows[name])
    luck = ", not above chance" if rate.value <= chance else ""
    told = "no interval" if row.iou.ci95 is None else f"95 % interval {interval(row.iou)}"
    text = (
        f"Lowest here: {_name(name).lower()}, IoU {percent(row.iou.value)}{luck} ({row.recordings} recordings, {told})."
    )
    return Remark(kind="bad", text=text)


def _of_half(row: ObjectMetrics) -> tuple[Metric, float]:
    """Rate of object-frames of which half is found, or any pixel by a protocol without that level, and its chance."""
    name = _HALF if _HALF in row.metric_names() else "detection_rate"
    return row.metric(name), row.metric(chance_of(name)).value


def _by_chance(rows: dict[str, ObjectMetrics]) -> list[Remark]:
    """A rate that the mask of another image reaches too says nothing."""
    near, unknown = [], []
    for name, row in rows.items():
        rate, chance = _of_half(row)
        if rate.ci95 is None:
            unknown.append(f"{_name(name).lower()} ({row.recordings})")
        elif rate.ci95[0] < chance:
            near.append(f"{_name(name).lower()} ({percent(rate.value)}, by chance {percent(chance)})")
    touched = [_name(n).lower() for n, row in rows.items() if row.detection_rate.value - row.chance.value < NEAR_CHANCE]
    sentences = []
    if unknown:
        text = f"Recordings too few to tell from chance, {FEWEST_RECORDINGS} are needed: {', '.join(unknown)}."
        sentences.append(Remark(kind="note", text=text))
    if near:
        text = f"Not clearly better than chance when half of an object must be found: {', '.join(near)}."
        sentences.append(Remark(kind="bad", text=text))
    if touched:
        text = f"“Found at all” says little for {', '.join(touched)}: the mask of another image touches as many of "
        sentences.append(Remark(kind="note", text=f"{text}these objects."))
    return sentences


def _weak_slices(found: Summary) -> list[Remark]:
    """The weakest slice of each breakdown, where its interval lies wholly below that of everything."""
    whole, sentences = found.all_moving.tpr_all, []
    for name, (_, _, words) in BREAKDOWNS.items():
        cut = found.breakdowns.get(name, {})
        shares = {key: row.tpr_all for key, row in cut.items() if row.object_frames >= LEAST_OBJECT_FRAMES}
        weak = {key: share.value for key, share in shares.items() if clearly_below(share, whole)}
        if weak:
            worst = min(weak, key=weak.__getitem__)
            sentences.append(f"{words.format(worst)} with {percent(weak[worst])}")
    text = f"Where least of an object is found (on average {percent(whole.value)}): {'; '.join(sentences)}."
    return [Remark(kind="bad", text=text)] if sentences else []


def _of_images(found: Summary) -> list[Remark]:
    """False positives, their causes, and images without a score."""
    rate = found.false_positives.coverage
    text = f"Wrongly marked as moving: {percent(rate.value, cases=rate.cases)} of the image on average"
    causes = found.false_positive_causes
    if causes:
        order = sorted(causes, key=lambda name: -causes[name].value)
        named = [f"{name.replace('_', ' ')} with {percent(causes[name].value)}" for name in order[:2]]
        alone = len(order) == 1 or clearly_below(causes[order[1]], causes[order[0]])
        text += f"; the largest cause is {named[0]}" if alone else f"; the two largest causes are {' and '.join(named)}"
        text += " of the false pixels"
    sentences = [Remark(kind="bad" if rate.value > NEAR_CHANCE else "note", text=f"{text}.")]
    images = found.images
    if left := images.failed + images.skipped:
        text = f"{left} of {images.images} images could not be scored; the last section says why."
        sentences.append(Remark(kind="bad", text=text))
    return sentences


def _name(category: str) -> str:
    return LABELS[Category(category)]


def _found(row: ObjectMetrics) -> str:
    return (
        f"on average {percent(row.tpr_all.value)} of an object is found, over "
        f"{row.object_frames} object-frames of {row.tracks} objects in {row.recordings} recordings"
    )
