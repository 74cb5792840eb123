"""An audit for people: its tables for terminal and Markdown; each has a note that says how to read it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from bench.atomic import write_text
from bench.audit.causes import FalseCause, MissCause
from bench.audit.polygons import Compensation
from bench.audit.run import ALL, AuditSummary, PolygonFigures, Quartiles, Scoring
from bench.evaluation.definitions import find_metric
from bench.evaluation.summary import Metric
from bench.plain_text import counted
from bench.reporting.document import Block, Column, Heading, Paragraph, Table, to_markdown
from bench.reporting.formats import INTERVALS, LABELS, hundredths, number, short_interval
from bench.reporting.run_tables import COVERAGES

COMPENSATIONS = {
    Compensation.NONE: "none, a snapshot",
    Compensation.EGO_MOTION: "ego-motion",
    Compensation.FULL: "ego and object",
}


decimal = number(2, none="n/a")


def share(part: int, whole: int) -> str:
    """A share in percent, "n/a" of nothing."""
    return f"{100 * part / whole:.1f}" if whole else "n/a"


def _spread(iou: Quartiles) -> str:
    return f"{100 * iou.median:.0f} ({100 * iou.low:.0f}-{100 * iou.high:.0f})"


def polygon_table(audit: AuditSummary) -> Table:
    """Every kind side by side, by class and range."""
    slices: dict[tuple[str, str], dict[str, PolygonFigures]] = {}
    for part in audit.polygons:
        if part.compensation == Compensation.FULL:
            slices.setdefault((part.object_class, part.range_m), {})[part.kind] = part
    forms = {"IoU %": _spread, "area %": lambda error: f"{100 * error.median:+.0f}"}
    columns = [
        Column(f"{kind.replace('-', ' ')} {what}", form) for kind in audit.polygon_kinds for what, form in forms.items()
    ]
    rows: list[list[object]] = []
    for key, kinds in slices.items():
        fits = [kinds[kind].fit if kind in kinds else {} for kind in audit.polygon_kinds]
        cells = [fit.get(name) for fit in fits for name in ("iou", "area_error")]
        first = next(iter(kinds.values()))
        frames = max(part.object_frames for part in kinds.values())
        rows.append([*key, frames, *cells, 100 * first.fit["solid"].median])
    return Table(
        title="How well the reference polygons cover what the camera sees",
        columns=["Class", "Range m", "Frames", *columns, Column("Filled IoU %", "{:.0f}".format)],
        rows=rows,
        note="IoU of each polygon with the exact mask of its object: median (quartiles). Area: how much too large (+) "
        "or too small (-), median. Filled: IoU of the exact mask with its own filled outline, median: a polygon "
        "without holes does hardly better.",
        words=2,
    )


def compensation_table(audit: AuditSummary) -> Table:
    """Every kind and compensation, by class."""
    found = {(p.kind, p.compensation, p.object_class): p.fit for p in audit.polygons if p.range_m == ALL}
    classes = list(dict.fromkeys(name for _, _, name in found))
    rows: list[list[object]] = []
    for kind in audit.polygon_kinds:
        for compensation, label in COMPENSATIONS.items():
            fits = [found.get((kind, compensation, name)) for name in classes]
            medians = [fit and fit[name].median for fit in fits for name in ("iou", "boundary_px")]
            rows.append([kind, label, *medians])
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
    shown = {name: heading for name, heading in RATES.items() if name in first.all_moving.metric_names()} | COVERAGES
    rows: list[list[object]] = []
    for category, found in first.categories.items():
        for scoring, scores in audit.scores.items() if found.object_frames else ():
            row = scores.categories[category]
            head = [LABELS[category], SCORINGS[Scoring(scoring)], row.recordings, row.object_frames]
            rows.append([*head, *map(row.metric, shown)])
    for scoring, scores in audit.scores.items():
        false = scores.false_positives
        head = ["False positives", SCORINGS[Scoring(scoring)], false.recordings, false.frames]
        rows.append([*head, false.coverage, *[None] * (len(shown) - 1)])
    return Table(
        title="What the reference, the ego-motion and the flow do to the score, in percent",
        columns=["Type", "Scored", "Recordings", "Frames", *(Column(text, _interval) for text in shown.values())],
        rows=rows,
        note="The same object-frames in all lines of a type. Lidar polygons: the benchmark. Exact masks: the same "
        "detections. Exact motion: ego-motion, calibration and road are exact. Exact flow: nothing is estimated, the "
        "method's own limit. Perfect cells: those whose centre shows a moving object, the limit of the grid. False "
        f"positives: area of the image. {INTERVALS}",
        words=2,
    )


def _interval(metric: Metric) -> str:
    return f"{hundredths(metric.value)} {short_interval(metric.ci95)}".rstrip()


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
        ["All moving" if row.category == ALL else LABELS[row.category], row.frames, row.cells,
         share(row.cells - row.wrong, row.cells), share(row.hit_by_error, row.cells),
         *(share(row.causes[cause], row.wrong) for cause in MISSES), row.flow_error_px.median]
        for row in audit.misses
        if row.cells
    ]  # fmt: skip
    head = ["Type", "Frames", "Cells", "Found %", "by error %", *MISSES.values()]
    return Table(
        title="Why cells of moving objects are missed, in percent of the missed ones",
        columns=[*head, Column("flow error px", decimal)],
        rows=rows,
        note="Cells of the exact masks. By error: share of all cells that are found although the exact flow fires "
        "nothing there. Blind: the exact flow with exact ego-motion fires nothing either. Flow, ego-motion: it would "
        "have fired by the exact one. Each cell has one cause, so a line adds up to 100. Flow error: median.",
        words=1,
    )


def false_alarm_table(audit: AuditSummary) -> Table:
    """One line."""
    row = audit.false_alarms
    assert row is not None, "asked for only where there is exact flow"
    shares = [share(row.causes[cause], row.wrong) for cause in FALSE_ALARMS]
    head = ["Images", "Cells", "Flagged %", *FALSE_ALARMS.values()]
    return Table(
        title="Why cells of the static world are flagged, in percent of the flagged ones",
        columns=[*head, Column("flow error px", decimal)],
        rows=[[row.frames, row.cells, share(row.wrong, row.cells), *shares, row.flow_error_px.median]],
        note="Method: the exact flow with exact ego-motion flags them as well. Flow: only the estimated flow flags "
        "them. Ego-motion: only the recorded ego-motion and calibration do.",
        words=0,
    )


def audit_tables(audit: AuditSummary) -> tuple[Table, ...]:
    """Polygons by class and range, compensation, scores; missed cells and false alarms by exact flow."""
    tables = [polygon_table(audit), compensation_table(audit), score_table(audit)]
    if audit.false_alarms is not None:
        tables += [miss_table(audit), false_alarm_table(audit)]
    return tuple(tables)


def sections(tables: Iterable[Table]) -> Iterator[Block]:
    """Each table below its title as a heading."""
    for table in tables:
        yield Heading(table.title)
        yield replace(table, title="")


def write_tables(folder: Path, audit: AuditSummary) -> Path:
    """Write all tables with their notes as `audit.md` beside `audit.json`, which has the numbers."""
    method = audit.method.name
    about = (
        f"{counted(audit.recordings, 'recording')}, protocol {audit.protocol.name}, method {method}. Evaluated "
        f"object-frames of which the camera sees no pixel ({audit.not_seen}) are in none of the metrics."
    )
    left_out = [Paragraph(f"Without exact flow: {audit.left_out}.")] if audit.left_out else []
    title = Heading(f"Audit of {audit.dataset}: lidar reference and {method}", 1)
    write_text(folder / "audit.md", to_markdown([title, Paragraph(about), *left_out, *sections(audit_tables(audit))]))
    return folder / "audit.md"
