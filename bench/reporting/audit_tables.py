"""The tables of an audit for people: Markdown, CSV and terminal; each has a note that says how to read it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

from bench.audit import (
    ALL,
    Aim,
    AuditSummary,
    Compensation,
    FalseCause,
    MissCause,
    MissFigures,
    PolygonFigures,
    Quartiles,
    Scoring,
)
from bench.evaluation import Metric, ObjectMetrics, find_metric
from bench.reference import Category
from bench.reporting import document, formats
from bench.reporting.document import Block, Heading, Paragraph, Table
from bench.reporting.tables import COVERAGES

COMPENSATIONS = {
    Compensation.NONE: "none, a snapshot",
    Compensation.EGO_MOTION: "ego-motion",
    Compensation.FULL: "ego and object",
}


def decimal(value: float) -> str:
    """A number with two decimals, "n/a" for NaN."""
    return "n/a" if math.isnan(value) else f"{value:.2f}"


def share(part: int, whole: int) -> str:
    """A share in percent, "n/a" of nothing."""
    return f"{100 * part / whole:.1f}" if whole else "n/a"


def polygon_table(audit: AuditSummary) -> Table:
    """Every kind side by side, by class and range."""
    fully = (p for p in audit.polygons if p.compensation == Compensation.FULL and p.speed_mps == ALL)
    found = {(p.object_class, p.range_m, p.kind): p for p in fully}
    slices = dict.fromkeys((name, range_m) for name, range_m, _ in found)
    rows = []
    for name, range_m in slices:
        cells = [_polygon_cells(found.get((name, range_m, kind))) for kind in audit.polygon_kinds]
        frames = max(p.object_frames for (n, r, _), p in found.items() if (n, r) == (name, range_m))
        limit = next(p.solid.median for (n, r, _), p in found.items() if (n, r) == (name, range_m))
        rows.append((name, range_m, str(frames), *(cell for part in cells for cell in part), f"{100 * limit:.0f}"))
    headings = [f"{kind.replace('-', ' ')} {what}" for kind in audit.polygon_kinds for what in ("IoU %", "area %")]
    return Table(
        title="How well the reference polygons cover what the camera sees",
        columns=("Class", "Range m", "Frames", *headings, "Filled IoU %"),
        rows=rows,
        note="IoU of each polygon, within V and less the nearer polygons, with the exact mask of its object: median "
        "(quartiles). Area: how much too large (+) or too small (-), median. Filled: IoU of the exact mask with its "
        "own filled outline, median: a polygon without holes does hardly better, and one sees through a bicycle. The "
        "object-frames are those that the protocol evaluates.",
        words=2,
    )


def speed_table(audit: AuditSummary) -> Table:
    """Error of the reference, and of the scores by it, by the object's own speed."""
    fully = (p for p in audit.polygons if p.compensation == Compensation.FULL and p.object_class == p.range_m == ALL)
    found = {(p.speed_mps, p.kind): p for p in fully}
    by_lidar, by_masks = audit.scores[Scoring.LIDAR].speeds, audit.scores[Scoring.MASKS].speeds
    rows = []
    for name in by_lidar:
        cells = [_polygon_cells(found.get((name, kind))) for kind in audit.polygon_kinds]
        scored = [rows_of[name].iou.value for rows_of in (by_lidar, by_masks)]
        error = "n/a" if math.isnan(scored[0] - scored[1]) else f"{100 * (scored[0] - scored[1]):+.1f}"
        if by_lidar[name].object_frames:
            numbers = *map(formats.hundredths, scored), error
            rows.append((name, str(by_lidar[name].object_frames), *(cell for part in cells for cell in part), *numbers))
    headings = [f"{kind.replace('-', ' ')} {what}" for kind in audit.polygon_kinds for what in ("IoU %", "area %")]
    return Table(
        title="The reference by the object's own speed",
        columns=("Speed m/s", "Frames", *headings, "Score by lidar", "by masks", "Error"),
        rows=rows,
        note="As above, over all classes. Score: mean IoU of the method by the protocol's lidar polygons, and of the "
        "same detections by the exact masks; error: the one less the other, in points of percent. At 20 m/s an object "
        "moves 20 cm in 10 ms: an error of its time or its speed shows here.",
        words=1,
    )


def aim_table(audit: AuditSummary) -> Table:
    """Classes that have an aim, and whether they reach it."""
    return Table(
        title="The aim for polygons that follow the outline",
        columns=("Kind", "Class", "Frames", "Median IoU", "Aim", "Verdict", "IoU, filled"),
        rows=tuple(
            (a.kind, f"{a.object_class} within {a.within_m:g} m", str(a.object_frames), decimal(a.median_iou),
             f">= {a.expected:.2f}", _verdict(a), decimal(a.median_filled_iou)) for a in audit.aims
        ),
        note="With full motion compensation. The convex hull is the paper's bounding polygon and has no aim. Filled: "
        "with the masks' holes filled, as annotators draw them.",
        words=2,
    )  # fmt: skip


def compensation_table(audit: AuditSummary) -> Table:
    """Every kind and compensation, by class."""
    found = {(p.kind, p.compensation, p.object_class): p for p in audit.polygons if p.range_m == p.speed_mps == ALL}
    classes = list(dict.fromkeys(name for _, _, name in found))
    rows = []
    for kind in audit.polygon_kinds:
        for compensation, label in COMPENSATIONS.items():
            row = [kind, label]
            for name in classes:
                part = found.get((kind, compensation.value, name))
                row += ["", ""] if part is None else [decimal(part.iou.median), decimal(part.boundary_px.median)]
            rows.append(row)
    headings = [f"{name} {what}" for name in classes for what in ("IoU", "edge px")]
    return Table(
        title="What motion compensation is worth",
        columns=("Kind", "Compensation", *headings),
        rows=rows,
        note="Medians over all ranges; edge: mean distance between the two outlines. Compensation: which motion "
        "between a lidar point and the exposure is undone; the last is what the benchmark does.",
        words=2,
    )


def _polygon_cells(found: PolygonFigures | None) -> tuple[str, str]:
    if found is None:
        return "", ""
    iou = found.iou
    spread = f"{100 * iou.median:.0f} ({100 * iou.low:.0f}-{100 * iou.high:.0f})"
    return spread, f"{100 * found.area_error.median:+.0f}"


def _verdict(aim: Aim) -> str:
    return "no cases" if aim.met is None else "met" if aim.met else "NOT MET"


SCORINGS = {
    Scoring.LIDAR: "lidar polygons",
    Scoring.MASKS: "exact masks",
    Scoring.EXACT_MOTION: "+ exact motion",
    Scoring.EXACT_FLOW: "+ exact flow",
    Scoring.CELLS: "perfect cells",
}
RATES = {name: find_metric(name).label for name in ("detection_rate", "detection_rate_50")}


def score_table(audit: AuditSummary) -> Table:
    """One line per kind of motion and scoring, then the false positives."""
    first = next(iter(audit.scores.values()))
    rates = {name: heading for name, heading in RATES.items() if name in first.all_moving.metric_names()}
    rows = []
    for category, found in first.categories.items():
        if not found.object_frames:
            continue
        for scoring, scores in audit.scores.items():
            cells = _cells(scores.categories[category], rates)
            rows.append((formats.LABELS[Category(category)], SCORINGS[Scoring(scoring)], *cells))
    for scoring, scores in audit.scores.items():
        false = scores.false_positives
        blank = [""] * (len(rates) + len(COVERAGES) - 1)
        head = "False positives", SCORINGS[Scoring(scoring)], false.recordings, false.frames
        rows.append((*head, _metric(false.coverage), *blank))
    return Table(
        title="What the reference, the ego-motion and the flow do to the score, in percent",
        columns=("Type", "Scored", "Recordings", "Frames", *rates.values(), *COVERAGES.values()),
        rows=rows,
        note="The same object-frames in all lines of a type; types without any are left out. Lidar polygons: the "
        "benchmark. Exact masks: the same detections. Exact motion: ego-motion, calibration and road are exact, the "
        "flow is estimated. Exact flow: nothing is estimated, the method's own limit; the flow is that of each cell's "
        "centre. Perfect cells: every cell whose centre shows a moving object and no other, the limit of the grid. "
        f"False positives: area of the image. {formats.INTERVALS}",
        words=2,
    )


def _cells(row: ObjectMetrics, rates: dict[str, str]) -> list[object]:
    cells: list[object] = [row.recordings, row.object_frames]
    cells += [_metric(row.metric(name), with_interval=False) for name in rates]
    return cells + [_metric(row.metric(name), with_interval=name != "tpr") for name in COVERAGES]


def _metric(metric: Metric, *, with_interval: bool = True) -> str:
    return f"{formats.hundredths(metric.value)} {formats.short_interval(metric) if with_interval else ''}".rstrip()


MISSES = {
    MissCause.NEAR_EPIPOLE: "blind: at the epipole",
    MissCause.ENTERED: "blind: just entered",
    MissCause.ABOVE_HORIZON: "blind: above horizon",
    MissCause.BELOW_THRESHOLD: "blind: below threshold",
    MissCause.UNCOVERED: "flow: hidden before",
    MissCause.FLOW: "flow",
    MissCause.EGO_MOTION: "ego-motion, calibration",
}
FALSE_ALARMS = {
    FalseCause.ANTI_PARALLEL: "method: anti-parallel",
    FalseCause.OTHER_CONSTRAINT: "method: other constraint",
    FalseCause.UNCOVERED: "flow: hidden before",
    FalseCause.BESIDE_OBJECT: "flow: beside a moving object",
    FalseCause.FLOW: "flow: elsewhere",
    FalseCause.EGO_MOTION: "ego-motion, calibration",
}


def miss_table(audit: AuditSummary) -> Table:
    """One line per kind of motion, then all."""
    rows = [_miss_cells(row) for row in audit.misses if row.cells]
    return Table(
        title="Why cells of moving objects are missed, in percent of the missed ones",
        columns=("Type", "Frames", "Cells", "Found %", "by error %", *MISSES.values(), "flow error px"),
        rows=rows,
        note="Cells of the exact masks. By error: share of all cells that are found although the exact flow fires "
        "nothing there. Blind: the exact flow with exact ego-motion fires nothing either, since the motion lies in the "
        "epipolar plane or the deviation stays below the threshold; above the horizon no height constraint can help. "
        "Flow: it would have fired by the exact flow. Ego-motion: it would have fired by the exact ego-motion. Each "
        "cell has one cause, so a line adds up to 100. Flow error: median over object-frames.",
        words=1,
    )


def _miss_cells(row: MissFigures) -> tuple[str, ...]:
    shares = [share(row.causes[cause.value], row.missed) for cause in MISSES]
    found = [share(row.hit, row.cells), share(row.hit_by_error, row.cells)]
    label = "All moving" if row.category == ALL else formats.LABELS[Category(row.category)]
    return (label, str(row.object_frames), str(row.cells), *found, *shares, decimal(row.flow_error_px.median))


def false_alarm_table(audit: AuditSummary) -> Table:
    """One line."""
    row = audit.false_alarms
    assert row is not None, "asked for only where there is exact flow"
    shares = [share(row.causes[cause.value], row.flagged) for cause in FALSE_ALARMS]
    return Table(
        title="Why cells of the static world are flagged, in percent of the flagged ones",
        columns=("Images", "Cells", "Flagged %", *FALSE_ALARMS.values(), "flow error px"),
        rows=(
            (str(row.images), str(row.cells), share(row.flagged, row.cells), *shares,
             decimal(row.flow_error_px.median)),
        ),
        note="Method: the exact flow with exact ego-motion flags them as well; anti-parallel is the paper's own, "
        "static points between the road and the camera's height. Flow: only the estimated flow flags them. Ego-motion: "
        "only the recorded ego-motion and calibration do.",
        words=0,
    )  # fmt: skip


def audit_tables(audit: AuditSummary) -> tuple[Table, ...]:
    """Polygons by class, range and speed, the aim, compensation, scores; missed cells, false alarms by exact flow."""
    tables = [polygon_table(audit), speed_table(audit), aim_table(audit), compensation_table(audit), score_table(audit)]
    if audit.false_alarms is not None:
        tables += [miss_table(audit), false_alarm_table(audit)]
    return tuple(tables)


def report(audit: AuditSummary) -> Iterator[Block]:
    """All tables with their notes."""
    made = audit.method
    yield Heading(f"Audit of {audit.dataset}: lidar reference and {made.name}", 1)
    yield Paragraph(
        f"{audit.recordings} recordings, protocol {audit.protocol.name}, method {made.name}. {audit.not_seen} "
        "evaluated object-frames of which the camera sees no pixel are in none of the metrics."
    )
    if audit.left_out:
        yield Paragraph(f"Without exact flow: {audit.left_out}.")
    yield from sections(audit_tables(audit))


def sections(tables: Iterable[Table]) -> Iterator[Block]:
    """Each table below its title as a heading."""
    for table in tables:
        yield Heading(table.title)
        yield replace(table, title="")


_COLUMNS = ["table", "kind", "compensation", "slice", "range_m", "speed_mps", "figure", "cases", "value"]


def to_csv(audit: AuditSummary) -> str:
    """One line per metric, at full precision; empty where there is no number."""
    return document.to_csv(_csv_rows(audit), _COLUMNS)


def _csv_rows(audit: AuditSummary) -> Iterator[dict[str, object]]:
    for p in audit.polygons:
        where = {"kind": p.kind, "compensation": p.compensation, "slice": p.object_class}
        where |= {"range_m": p.range_m, "speed_mps": p.speed_mps}
        for name, part in p:
            for quartile, value in part if isinstance(part, Quartiles) else ():
                yield {"table": "polygons", **where, "figure": f"{name}.{quartile}", "cases": p.object_frames,
                       "value": value}  # fmt: skip
    for scoring, scores in audit.scores.items():
        for category, row in scores.categories.items():
            for name in row.metric_names():
                figure = row.metric(name)
                yield {"table": "scores", "kind": scoring, "slice": category, "figure": name, "cases": figure.cases,
                       "value": figure.value}  # fmt: skip
        coverage = scores.false_positives.coverage
        yield {"table": "scores", "kind": scoring, "slice": "false_positives", "figure": "coverage",
               "cases": coverage.cases, "value": coverage.value}  # fmt: skip
    for miss in audit.misses:
        counts = {"cells": miss.cells, "hit": miss.hit, "hit_by_error": miss.hit_by_error, **miss.causes}
        for name, cells in counts.items():
            yield {"table": "misses", "slice": miss.category, "figure": name, "cases": miss.cells, "value": cells}
    if audit.false_alarms is not None:
        counts = {"cells": audit.false_alarms.cells, "flagged": audit.false_alarms.flagged, **audit.false_alarms.causes}
        for name, cells in counts.items():
            yield {"table": "false_alarms", "figure": name, "cases": audit.false_alarms.cells, "value": cells}


_WIDEST = 8  # columns of a table that a terminal holds


def for_terminal(tables: Iterable[Table]) -> list[Table]:
    """Tables for a console of at least 110 columns, with rows for columns where there are too many."""
    return [table.transposed() if table.words < 2 and len(table.columns) > _WIDEST else table for table in tables]
