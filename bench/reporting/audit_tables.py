"""The tables of an audit for people: Markdown, CSV and terminal; each has a note that says how to read it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

import pandas as pd

from bench.audit import (
    ALL,
    AuditSummary,
    Compensation,
    FalseCause,
    MissCause,
    PolygonFigures,
    Quartiles,
    Scoring,
)
from bench.evaluation import Metric, find_metric
from bench.reporting import formats
from bench.reporting.document import Block, Cell, Column, Heading, Paragraph, Report, Table
from bench.reporting.run_tables import COVERAGES

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


def _kind_columns(audit: AuditSummary) -> list[Column]:
    forms = {"IoU %": _spread, "area %": lambda error: f"{100 * error.median:+.0f}"}
    kinds = [kind.replace("-", " ") for kind in audit.polygon_kinds]
    return [Column(f"{kind} {what}", form) for kind in kinds for what, form in forms.items()]


def _spread(iou: Quartiles) -> str:
    return f"{100 * iou.median:.0f} ({100 * iou.low:.0f}-{100 * iou.high:.0f})"


def _kind_cells(audit: AuditSummary, found: Iterable[PolygonFigures]) -> list[Quartiles | None]:
    """IoU and error of the area of each kind, None for a kind that was not found."""
    of_kind = {part.kind: (part.fit["iou"], part.fit["area_error"]) for part in found}
    return [cell for kind in audit.polygon_kinds for cell in of_kind.get(kind, (None, None))]


def polygon_table(audit: AuditSummary) -> Table:
    """Every kind side by side, by class and range."""
    slices: dict[tuple[str, str], list[PolygonFigures]] = {}
    for part in audit.polygons:
        if part.compensation == Compensation.FULL and part.speed_mps == ALL:
            slices.setdefault((part.object_class, part.range_m), []).append(part)
    return Table(
        title="How well the reference polygons cover what the camera sees",
        columns=["Class", "Range m", "Frames", *_kind_columns(audit), Column("Filled IoU %", "{:.0f}".format)],
        rows=[
            [*key, max(part.object_frames for part in found), *_kind_cells(audit, found),
             100 * found[0].fit["solid"].median] for key, found in slices.items()
        ],
        note="IoU of each polygon, within V and less the nearer polygons, with the exact mask of its object: median "
        "(quartiles). Area: how much too large (+) or too small (-), median. Filled: IoU of the exact mask with its "
        "own filled outline, median: a polygon without holes does hardly better, and one sees through a bicycle. The "
        "object-frames are those that the protocol evaluates.",
        words=2,
    )  # fmt: skip


def speed_table(audit: AuditSummary) -> Table:
    """Error of the reference, and of the scores by it, by the object's own speed."""
    fully = [p for p in audit.polygons if p.compensation == Compensation.FULL and p.object_class == p.range_m == ALL]
    by_lidar, by_masks = (audit.scores[s].breakdowns["speed_mps"] for s in (Scoring.LIDAR, Scoring.MASKS))
    rows = []
    for name, of_speed in by_lidar.items():
        if of_speed.object_frames:
            scored = [of_speed.iou.value, by_masks[name].iou.value]
            cells = _kind_cells(audit, (part for part in fully if part.speed_mps == name))
            rows.append([name, of_speed.object_frames, *cells, *scored, scored[0] - scored[1]])
    scores = [Column(heading, formats.hundredths) for heading in ("Score by lidar", "by masks")]
    return Table(
        title="The reference by the object's own speed",
        columns=["Speed m/s", "Frames", *_kind_columns(audit), *scores, Column("Error", formats.points)],
        rows=rows,
        note="As above, over all classes. Score: mean IoU of the method by the protocol's lidar polygons, and of the "
        "same detections by the exact masks; error: the one less the other, in points of percent. At 20 m/s an object "
        "moves 20 cm in 10 ms: an error of its time or its speed shows here.",
        words=1,
    )


def aim_table(audit: AuditSummary) -> Table:
    """Classes that have an aim, and whether they reach it."""
    verdicts = {None: "no cases", True: "met", False: "NOT MET"}
    return Table(
        title="The aim for polygons that follow the outline",
        columns=["Kind", "Class", "Frames", Column("Median IoU", decimal), Column("Aim", ">= {:.2f}".format), "Verdict",
                 Column("IoU, filled", decimal)],
        rows=[
            [aim.kind, f"{aim.object_class} within {aim.within_m:g} m", aim.object_frames, aim.median_iou,
             aim.expected, verdicts[aim.met], aim.median_filled_iou] for aim in audit.aims
        ],
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
            parts = [found.get((kind, compensation, name)) for name in classes]
            medians = [
                tuple(part.fit[name].median if part else None for name in ("iou", "boundary_px")) for part in parts
            ]
            rows.append([kind, label, *(cell for pair in medians for cell in pair)])
    headings = [f"{name} {what}" for name in classes for what in ("IoU", "edge px")]
    return Table(
        title="What motion compensation is worth",
        columns=["Kind", "Compensation", *(Column(heading, decimal) for heading in headings)],
        rows=rows,
        note="Medians over all ranges; edge: mean distance between the two outlines. Compensation: which motion "
        "between a lidar point and the exposure is undone; the last is what the benchmark does.",
        words=2,
    )


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
    rows: list[list[object]] = []
    for category, found in first.categories.items():
        for scoring, scores in audit.scores.items() if found.object_frames else ():
            row = scores.categories[category]
            head = [formats.LABELS[category], SCORINGS[Scoring(scoring)], row.recordings, row.object_frames]
            rows.append([*head, *map(row.metric, (*rates, *COVERAGES))])
    metrics = [Column(heading, _value if name in ("tpr", *rates) else _with_interval)
               for name, heading in (rates | COVERAGES).items()]  # fmt: skip
    blank = [None] * (len(rates) + len(COVERAGES) - 1)
    for scoring, scores in audit.scores.items():
        false = scores.false_positives
        coverage = Cell(_with_interval(false.coverage))
        rows.append(["False positives", SCORINGS[Scoring(scoring)], false.recordings, false.frames, coverage, *blank])
    return Table(
        title="What the reference, the ego-motion and the flow do to the score, in percent",
        columns=["Type", "Scored", "Recordings", "Frames", *metrics],
        rows=rows,
        note="The same object-frames in all lines of a type; types without any are left out. Lidar polygons: the "
        "benchmark. Exact masks: the same detections. Exact motion: ego-motion, calibration and road are exact, the "
        "flow is estimated. Exact flow: nothing is estimated, the method's own limit; the flow is that of each cell's "
        "centre. Perfect cells: every cell whose centre shows a moving object and no other, the limit of the grid. "
        f"False positives: area of the image. {formats.INTERVALS}",
        words=2,
    )  # fmt: skip


def _value(metric: Metric) -> str:
    return formats.hundredths(metric.value)


def _with_interval(metric: Metric) -> str:
    return f"{_value(metric)} {formats.short_interval(metric)}".rstrip()


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
    rows = [
        ["All moving" if row.category == ALL else formats.LABELS[row.category], row.frames, row.cells,
         share(row.cells - row.wrong, row.cells), share(row.hit_by_error, row.cells),
         *(share(row.causes[cause], row.wrong) for cause in MISSES), row.flow_error_px.median]
        for row in audit.misses
        if row.cells
    ]  # fmt: skip
    head = ["Type", "Frames", "Cells", "Found %", "by error %"]
    return Table(
        title="Why cells of moving objects are missed, in percent of the missed ones",
        columns=[*head, *MISSES.values(), Column("flow error px", decimal)],
        rows=rows,
        note="Cells of the exact masks. By error: share of all cells that are found although the exact flow fires "
        "nothing there. Blind: the exact flow with exact ego-motion fires nothing either, since the motion lies in the "
        "epipolar plane or the deviation stays below the threshold; above the horizon no height constraint can help. "
        "Flow: it would have fired by the exact flow. Ego-motion: it would have fired by the exact ego-motion. Each "
        "cell has one cause, so a line adds up to 100. Flow error: median over object-frames.",
        words=1,
    )


def false_alarm_table(audit: AuditSummary) -> Table:
    """One line."""
    row = audit.false_alarms
    assert row is not None, "asked for only where there is exact flow"
    shares = [share(row.causes[cause], row.wrong) for cause in FALSE_ALARMS]
    return Table(
        title="Why cells of the static world are flagged, in percent of the flagged ones",
        columns=["Images", "Cells", "Flagged %", *FALSE_ALARMS.values(), Column("flow error px", decimal)],
        rows=[[row.frames, row.cells, share(row.wrong, row.cells), *shares, row.flow_error_px.median]],
        note="Method: the exact flow with exact ego-motion flags them as well; anti-parallel is the paper's own, "
        "static points between the road and the camera's height. Flow: only the estimated flow flags them. Ego-motion: "
        "only the recorded ego-motion and calibration do.",
        words=0,
    )


def audit_tables(audit: AuditSummary) -> tuple[Table, ...]:
    """Polygons by class, range and speed, the aim, compensation, scores; missed cells, false alarms by exact flow."""
    tables = [polygon_table(audit), speed_table(audit), aim_table(audit), compensation_table(audit), score_table(audit)]
    if audit.false_alarms is not None:
        tables += [miss_table(audit), false_alarm_table(audit)]
    return tuple(tables)


def report(audit: AuditSummary) -> Report:
    """All tables with their notes; a line of numbers per measure, none where there is no number."""
    method = audit.method.name
    about = (
        f"{audit.recordings} recordings, protocol {audit.protocol.name}, method {method}. {audit.not_seen} evaluated "
        "object-frames of which the camera sees no pixel are in none of the metrics."
    )
    left_out = [Paragraph(f"Without exact flow: {audit.left_out}.")] if audit.left_out else []
    return Report(
        title=f"Audit of {audit.dataset}: lidar reference and {method}",
        blocks=[Paragraph(about), *left_out, *sections(audit_tables(audit))],
        numbers=pd.DataFrame(_numbers(audit), columns=COLUMNS, dtype=object),
    )


def sections(tables: Iterable[Table]) -> Iterator[Block]:
    """Each table below its title as a heading."""
    for table in tables:
        yield Heading(table.title)
        yield replace(table, title="")


COLUMNS = ["table", "kind", "compensation", "slice", "range_m", "speed_mps", "figure", "cases", "value"]


def _numbers(audit: AuditSummary) -> Iterator[dict[str, object]]:
    for p in audit.polygons:
        where = {"table": "polygons", "kind": p.kind, "compensation": p.compensation, "slice": p.object_class}
        where |= {"range_m": p.range_m, "speed_mps": p.speed_mps}
        for name, part in p.fit.items():
            for quartile, value in part:
                yield where | {"figure": f"{name}.{quartile}", "cases": p.object_frames, "value": value}
    for scoring, scores in audit.scores.items():
        metrics = [(slice_, name, row.metric(name)) for slice_, row in scores.categories.items()
                   for name in row.metric_names()]  # fmt: skip
        for slice_, name, metric in [*metrics, ("false_positives", "coverage", scores.false_positives.coverage)]:
            yield {"table": "scores", "kind": scoring, "slice": slice_, "figure": name, "cases": metric.cases,
                   "value": metric.value}  # fmt: skip
    for miss in audit.misses:
        counts = {"cells": miss.cells, "hit": miss.cells - miss.wrong, "hit_by_error": miss.hit_by_error, **miss.causes}
        for name, cells in counts.items():
            yield {"table": "misses", "slice": miss.category, "figure": name, "cases": miss.cells, "value": cells}
    if (false := audit.false_alarms) is not None:
        for name, cells in {"cells": false.cells, "flagged": false.wrong, **false.causes}.items():
            yield {"table": "false_alarms", "figure": name, "cases": false.cells, "value": cells}


_WIDEST = 8  # columns of a table that a terminal holds


def for_terminal(tables: Iterable[Table]) -> list[Table]:
    """Tables for a console of at least 110 columns, with rows for columns where there are too many."""
    return [table.transposed() if table.words < 2 and len(table.columns) > _WIDEST else table for table in tables]
