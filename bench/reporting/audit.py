"""An audit for people: its tables for terminal and Markdown, the fit of polygons by distance, pictures of causes.

Each table has a note that says how to read it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from bench.audit import (
    ALL,
    AUDIT,
    AuditSource,
    AuditSummary,
    Compensation,
    ExplainedImage,
    FalseCause,
    MissCause,
    PolygonFigures,
    Quartiles,
    Scoring,
    explain_image,
)
from bench.evaluation import Metric, Protocol, find_metric
from bench.methods import Method
from bench.reporting.document import Block, Column, Heading, Paragraph, Report, Table
from bench.reporting.figures import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT_GREY,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    VERMILION,
    YELLOW,
    new_figure,
    styled,
    write_picture,
)
from bench.reporting.formats import INTERVALS, LABELS, hundredths, short_interval
from bench.reporting.frame import faded, overlay_areas, show_image
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
        note="IoU of each polygon, within V and less the nearer polygons, with the exact mask of its object: median "
        "(quartiles). Area: how much too large (+) or too small (-), median. Filled: IoU of the exact mask with its "
        "own filled outline, median: a polygon without holes does hardly better, and one sees through a bicycle. The "
        "object-frames are those that the protocol evaluates.",
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
        note="The same object-frames in all lines of a type; types without any are left out. Lidar polygons: the "
        "benchmark. Exact masks: the same detections. Exact motion: ego-motion, calibration and road are exact, the "
        "flow is estimated. Exact flow: nothing is estimated, the method's own limit; the flow is that of each cell's "
        "centre. Perfect cells: every cell whose centre shows a moving object and no other, the limit of the grid. "
        f"False positives: area of the image. {INTERVALS}",
        words=2,
    )


def _interval(metric: Metric) -> str:
    return f"{hundredths(metric.value)} {short_interval(metric)}".rstrip()


# Each cause with its name and its colour in pictures.
MISSES = {
    MissCause.NEAR_EPIPOLE: ("blind: at the epipole", BLACK),
    MissCause.ENTERED: ("blind: just entered", GREY),
    MissCause.ABOVE_HORIZON: ("blind: above horizon", BLUE),
    MissCause.BELOW_THRESHOLD: ("blind: below threshold", SKY_BLUE),
    MissCause.UNCOVERED: ("flow: hidden before", ORANGE),
    MissCause.FLOW: ("flow", VERMILION),
    MissCause.EGO_MOTION: ("ego-motion, calibration", PURPLE),
}
FALSE_ALARMS = {
    FalseCause.ANTI_PARALLEL: ("method: anti-parallel", YELLOW),
    FalseCause.OTHER_CONSTRAINT: ("method: other constraint", SKY_BLUE),
    FalseCause.UNCOVERED: ("flow: hidden before", GREY),
    FalseCause.BESIDE_OBJECT: ("flow: beside a moving object", ORANGE),
    FalseCause.FLOW: ("flow: elsewhere", VERMILION),
    FalseCause.EGO_MOTION: ("ego-motion, calibration", PURPLE),
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
    head = ["Type", "Frames", "Cells", "Found %", "by error %", *(name for name, _ in MISSES.values())]
    return Table(
        title="Why cells of moving objects are missed, in percent of the missed ones",
        columns=[*head, Column("flow error px", decimal)],
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
    head = ["Images", "Cells", "Flagged %", *(name for name, _ in FALSE_ALARMS.values())]
    return Table(
        title="Why cells of the static world are flagged, in percent of the flagged ones",
        columns=[*head, Column("flow error px", decimal)],
        rows=[[row.frames, row.cells, share(row.wrong, row.cells), *shares, row.flow_error_px.median]],
        note="Method: the exact flow with exact ego-motion flags them as well; anti-parallel is the paper's own, "
        "static points between the road and the camera's height. Flow: only the estimated flow flags them. Ego-motion: "
        "only the recorded ego-motion and calibration do.",
        words=0,
    )


def audit_tables(audit: AuditSummary) -> tuple[Table, ...]:
    """Polygons by class and range, compensation, scores; missed cells and false alarms by exact flow."""
    tables = [polygon_table(audit), compensation_table(audit), score_table(audit)]
    if audit.false_alarms is not None:
        tables += [miss_table(audit), false_alarm_table(audit)]
    return tuple(tables)


_WIDEST = 8  # columns of a table that a terminal holds


def for_terminal(tables: Iterable[Table]) -> list[Table]:
    """Tables for a console of at least 110 columns, with rows for columns where there are too many."""
    return [table.transposed() if table.words < 2 and len(table.columns) > _WIDEST else table for table in tables]


def sections(tables: Iterable[Table]) -> Iterator[Block]:
    """Each table below its title as a heading."""
    for table in tables:
        yield Heading(table.title)
        yield replace(table, title="")


def report(audit: AuditSummary) -> Report:
    """All tables with their notes; the numbers are in `audit.json`."""
    method = audit.method.name
    about = (
        f"{audit.recordings} recordings, protocol {audit.protocol.name}, method {method}. {audit.not_seen} evaluated "
        "object-frames of which the camera sees no pixel are in none of the metrics."
    )
    left_out = [Paragraph(f"Without exact flow: {audit.left_out}.")] if audit.left_out else []
    title = f"Audit of {audit.dataset}: lidar reference and {method}"
    return Report(title=title, blocks=[Paragraph(about), *left_out, *sections(audit_tables(audit))])


# The pictures.

COLOURS = (ORANGE, BLUE, GREEN, PURPLE)
BIN_M = 1.0
FEWEST = 3  # object-frames of a point; fewer say nothing about quartiles
_PANEL_IN, _HEIGHT_IN = 2.6, 3.0


@styled
def draw_fit_by_distance(audit: AuditSummary, polygons: pa.Table) -> Figure:
    """Draw median and quartiles of the IoU over the distance, each kind of polygon in its colour.

    Args:
        audit: for names.
        polygons: the rows behind them.
    """
    rows = polygons.to_pandas()
    rows = rows[rows["compensation"] == Compensation.FULL.value]
    classes = sorted(set(rows["object_class"])) or ["none"]
    figure = new_figure(max(len(classes) * _PANEL_IN, 4.0), _HEIGHT_IN, layout="constrained")
    figure.suptitle(f"Reference polygons of {audit.dataset}: median and quartiles", x=0.01, ha="left", fontsize=8)
    panels = figure.subplots(1, len(classes), sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, classes, strict=True):
        of_class = rows[rows["object_class"] == name]
        for kind, colour in zip(audit.polygon_kinds, cycle(COLOURS), strict=False):
            _draw_kind(axes, of_class[of_class["kind"] == kind], kind=kind, colour=colour)
        frames = len(of_class[of_class["kind"] == audit.polygon_kinds[0]])
        axes.set(xlabel="distance (m)", ylim=(0.3, 1.0), xlim=(0, max(float(rows["range_m"].max()), 8.0)))
        axes.set_title(f"{name}, {frames} object-frames", pad=3)
        axes.grid(color=LIGHT_GREY, linewidth=0.4)
    panels[0].set_ylabel("IoU with the exact mask")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(COLOURS), frameon=False)
    return figure


def _draw_kind(axes: Axes, rows: pd.DataFrame, *, kind: str, colour: str) -> None:
    by_bin = rows.groupby(np.floor(rows["range_m"] / BIN_M))["iou"]
    low, median, high = (by_bin.quantile(share)[by_bin.size() >= FEWEST] for share in (0.25, 0.5, 0.75))
    middles_m = (median.index.to_numpy(dtype=np.float64) + 0.5) * BIN_M
    axes.fill_between(middles_m, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.plot(middles_m, median, color=colour, marker="o", markersize=3, linewidth=1.2, label=kind)


def write_audit_files(folder: Path, audit: AuditSummary, polygons: pa.Table) -> tuple[Path, ...]:
    """Write `audit.md`, `fit.png` and `fit.svg` beside `audit.json`; all of their paths.

    Args:
        folder: of the audit.
        audit: its summary.
        polygons: its rows.
    """
    tables = report(audit).write(folder, "audit")
    return (folder / AUDIT, *tables, *write_picture(folder / "fit", draw_fit_by_distance(audit, polygons)))


_CAUSE_IN, _CAUSE_BELOW_IN, _TINT = 3.6, 0.75, 0.65


def write_cause_pictures(
    folder: Path,
    misses: pa.Table,
    *,
    sources: Mapping[str, AuditSource],
    method: Method,
    protocol: Protocol,
) -> tuple[Path, ...]:
    """Write `causes-<category>.png` and `.svg` for every kind of motion that has missed cells.

    Args:
        folder: of the audit.
        misses: its rows.
        sources: recordings by name.
        method: that was audited.
        protocol: of the audit.
    """
    files: list[Path] = []
    for category, (recording, camera, timestamp_ns) in worst_images(misses).items():
        explained = explain_image(
            sources[recording], camera=camera, timestamp_ns=timestamp_ns, method=method, protocol=protocol
        )
        title = f"{category.replace('_', ' ')}: {recording}, {timestamp_ns / 1e9:.3f} s"
        files += write_picture(folder / f"causes-{category}", draw_causes(explained, title=title))
    return tuple(files)


def worst_images(misses: pa.Table) -> dict[str, tuple[str, str, int]]:
    """By category, recording, camera and time of the object-frame with most missed cells; ties go to the first."""
    rows = misses.to_pandas()
    rows["missed"] = rows["cells"] - rows["hit"]
    order = ["missed", "recording", "camera", "timestamp_ns", "track_id"]
    rows = rows[rows["missed"] > 0].sort_values(order, ascending=[False, *[True] * 4])
    first = rows.drop_duplicates("category").sort_values("category")
    keys = first[["category", "recording", "camera", "timestamp_ns"]].itertuples(index=False, name=None)
    return {str(name): (str(recording), str(camera), int(time_ns)) for name, recording, camera, time_ns in keys}


@styled
def draw_causes(explained: ExplainedImage, *, title: str) -> Figure:
    """Draw the moving objects' cells on the left, the false alarms on the right, each in the colour of its cause."""
    height, width = explained.pixels.shape[:2]
    figure = new_figure(2 * _CAUSE_IN, _CAUSE_IN * height / width + _CAUSE_BELOW_IN, layout="constrained")
    left = [("found", GREEN, explained.hit)]
    left += [(*shown, explained.missed[cause]) for cause, shown in MISSES.items()]
    right = [(*shown, explained.flagged[cause]) for cause, shown in FALSE_ALARMS.items()]
    panels = figure.subplots(1, 2)
    for axes, heading, layers in zip(panels, ("moving objects", "static world"), (left, right), strict=True):
        areas = {colour: _pixels(cells, explained) for _, colour, cells in layers}
        show_image(axes, overlay_areas(faded(explained.pixels, 0.8), areas, strength=_TINT))
        axes.set_title(f"{title}, {heading}", pad=3, fontsize=7)
        handles = [
            Patch(facecolor=colour, edgecolor=BLACK, linewidth=0.3, label=f"{name} ({np.count_nonzero(cells)})")
            for name, colour, cells in layers
            if cells.any()
        ]
        axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.01), ncols=2, frameon=False,
                    fontsize=6, handlelength=1.2, columnspacing=1.0)  # fmt: skip
    return figure


def _pixels(cells: NDArray[np.bool_], explained: ExplainedImage) -> NDArray[np.bool_]:
    """(H, W) bool, the pixels of cells."""
    height, width = explained.pixels.shape[:2]
    every: NDArray[np.bool_] = np.kron(cells, np.ones((explained.cell_size_px, explained.cell_size_px), dtype=bool))
    return every[:height, :width]
