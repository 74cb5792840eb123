"""The files of an audit for people: Markdown, CSV and `rich` tables, and how well polygons fit by distance."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from bench.audit import AUDIT, AuditSummary, Compensation, PolygonFigures, Quartiles, read_audit, read_polygons
from bench.plain_text import escape_markdown, plain
from bench.recordings import write_text
from bench.reporting.audit_tables import AuditTable, audit_tables
from bench.reporting.canvas import BLUE, GREEN, GREY, LIGHT_GREY, ORANGE, PURPLE, new_figure, styled
from bench.reporting.write import write_picture


def figure_rows(audit: AuditSummary) -> Iterator[dict[str, object]]:
    """Every number of the audit as one row: table, slice, figure, value; ratios in [0, 1], NaN where there is none."""
    for p in audit.polygons:
        where = {"kind": p.kind, "compensation": p.compensation, "slice": p.object_class, "range_m": p.range_m}
        for name, part in _quartile_fields(p).items():
            for quartile in ("low", "median", "high"):
                yield {"table": "polygons", **where, "figure": f"{name}.{quartile}", "cases": p.object_frames,
                       "value": getattr(part, quartile)}  # fmt: skip
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
        for name, count in counts.items():
            yield {"table": "misses", "slice": miss.category, "figure": name, "cases": miss.cells, "value": count}
    if audit.false_alarms is not None:
        counts = {"cells": audit.false_alarms.cells, "flagged": audit.false_alarms.flagged, **audit.false_alarms.causes}
        for name, count in counts.items():
            yield {"table": "false_alarms", "figure": name, "cases": audit.false_alarms.cells, "value": count}


def _quartile_fields(figures: PolygonFigures) -> Mapping[str, Quartiles]:
    names = [name for name, field in type(figures).model_fields.items() if field.annotation is Quartiles]
    return {name: getattr(figures, name) for name in names}


_WIDEST = 8  # columns of a table that a terminal holds
_COLUMNS = ("table", "kind", "compensation", "slice", "range_m", "figure", "cases", "value")


def to_markdown(audit: AuditSummary) -> str:
    """All tables with their notes, GitHub's Markdown."""
    made = audit.method
    dataset, method, protocol = map(escape_markdown, (audit.dataset, made.name, audit.protocol.name))
    head = [
        f"# Audit of {dataset}: lidar reference and {method}",
        f"{audit.recordings} recordings, protocol {protocol}, method {method}. {audit.not_seen} evaluated "
        "object-frames of which the camera sees no pixel are in none of the figures.",
    ]
    if audit.left_out:
        head.append(f"Without exact flow: {escape_markdown(audit.left_out)}.")
    return "\n\n".join([*head, *(_markdown(table) for table in audit_tables(audit))]) + "\n"


def to_csv(audit: AuditSummary) -> str:
    """One line per figure, at full precision; empty where there is no number."""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, _COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    for row in figure_rows(audit):
        value = row["value"]
        text = "" if isinstance(value, float) and math.isnan(value) else repr(value)
        writer.writerow({**row, "value": text})
    return buffer.getvalue()


def to_rich(audit: AuditSummary) -> Iterator[tuple[Table, str]]:
    """The tables for a console of at least 110 columns, each with its note; nothing is printed here."""
    for item in audit_tables(audit):
        turned = item.labels < 2 and len(item.sheet.headings) > _WIDEST
        headings, rows = _turned(item) if turned else (item.sheet.headings, item.sheet.rows)
        table = Table(
            box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False, title=item.sheet.title, title_justify="left"
        )
        words = max(item.labels, 1)
        for number, heading in enumerate(map(plain, headings)):
            table.add_column(
                Text(heading if number < words else heading.replace(" ", "\n", 1)),
                justify="left" if number < words else "right",
                no_wrap=not turned and number > 0,
            )
        before = ""
        for row in rows:
            table.add_row("" if row[0] == before else row[0], *row[1:])
            before = row[0]
        yield table, item.note


def _turned(item: AuditTable) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """A table too wide for a terminal, with rows for columns."""
    sheet = item.sheet
    if item.labels:
        return ("", *(row[0] for row in sheet.rows)), tuple(
            (heading, *(row[k] for row in sheet.rows)) for k, heading in enumerate(sheet.headings) if k
        )
    return ("", ""), tuple((heading, *(row[k] for row in sheet.rows)) for k, heading in enumerate(sheet.headings))


def _markdown(item: AuditTable) -> str:
    sheet = item.sheet
    rule = ["---"] * item.labels + ["---:"] * (len(sheet.headings) - item.labels)
    lines = [f"| {' | '.join(map(escape_markdown, row))} |" for row in (sheet.headings, rule, *sheet.rows)]
    return "\n".join([f"## {sheet.title}", "", *lines, "", item.note])


COLOURS = (ORANGE, BLUE, GREEN, PURPLE)
BIN_M = 1.0
FEWEST = 3  # object-frames of a point; fewer say nothing about quartiles
_PANEL_IN, _HEIGHT_IN, _LEFT_IN, _GAP_IN, _TOP_IN, _BOTTOM_IN = 2.4, 3.0, 0.5, 0.2, 0.75, 0.45


@styled
def draw_fit_by_distance(audit: AuditSummary, polygons: pa.Table) -> Figure:
    """Draw median and quartiles of the IoU over the distance, each kind of polygon in its colour.

    Args:
        audit: the figures, for names and aims.
        polygons: the rows behind them.
    """
    rows = polygons.to_pandas()
    rows = rows[rows["compensation"] == Compensation.FULL.value]
    classes = sorted(set(rows["object_class"])) or ["none"]
    width_in = _LEFT_IN + len(classes) * (_PANEL_IN + _GAP_IN)
    figure = new_figure(max(width_in, 4.0), _HEIGHT_IN)
    for number, name in enumerate(classes):
        axes = figure.add_axes(
            (
                (_LEFT_IN + number * (_PANEL_IN + _GAP_IN)) / max(width_in, 4.0),
                _BOTTOM_IN / _HEIGHT_IN,
                _PANEL_IN / max(width_in, 4.0),
                1 - (_TOP_IN + _BOTTOM_IN) / _HEIGHT_IN,
            )
        )
        of_class = rows[rows["object_class"] == name]
        for kind, colour in zip(audit.polygon_kinds, COLOURS, strict=False):
            _draw_kind(axes, of_class[of_class["kind"] == kind], kind=kind, colour=colour)
        aims = {aim.expected for aim in audit.aims if aim.object_class == name}
        for expected in sorted(aims):
            axes.axhline(expected, color=GREY, linewidth=0.8, linestyle=":")
        frames = len(of_class[of_class["kind"] == audit.polygon_kinds[0]])
        axes.set(xlabel="distance (m)", ylim=(0.3, 1.0), xlim=(0, max(float(rows["range_m"].max()), 8.0)))
        axes.set_title(f"{name}, {frames} object-frames", pad=3)
        axes.grid(color=LIGHT_GREY, linewidth=0.4)
        axes.tick_params(labelleft=number == 0)
        if number == 0:
            axes.set_ylabel("IoU with the exact mask")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper right", ncols=len(labels), frameon=False)
    figure.text(0.08 / width_in, 1 - 0.06 / _HEIGHT_IN, f"Reference polygons of {audit.dataset}", va="top", fontsize=10)
    figure.text(
        0.08 / width_in,
        1 - 0.26 / _HEIGHT_IN,
        "Median and quartiles; dotted: the aim for kinds that follow the outline",
        va="top",
        fontsize=7,
        color="#555555",
    )
    return figure


def _draw_kind(axes: Axes, rows: pd.DataFrame, *, kind: str, colour: str) -> None:
    bins = np.floor(rows["range_m"].to_numpy(dtype=np.float64) / BIN_M)
    places, quarters = [], []
    for number in np.unique(bins):
        iou = rows["iou"].to_numpy(dtype=np.float64)[bins == number]
        if len(iou) >= FEWEST:
            places.append((number + 0.5) * BIN_M)
            quarters.append(np.quantile(iou, [0.25, 0.5, 0.75]))
    low, median, high = np.array(quarters).reshape(-1, 3).T
    axes.fill_between(places, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.plot(places, median, color=colour, marker="o", markersize=3, linewidth=1.2, label=kind)


def write_audit_files(folder: Path) -> tuple[Path, ...]:
    """Write `audit.md`, `audit.csv`, `fit.png` and `fit.svg` beside `audit.json`; all of their paths.

    Raises:
        DataError: the stored audit is missing or damaged.
    """
    audit = read_audit(folder)
    tables = {folder / "audit.md": to_markdown(audit), folder / "audit.csv": to_csv(audit)}
    for file, text in tables.items():
        write_text(file, text)
    chart = draw_fit_by_distance(audit, read_polygons(folder))
    return (folder / AUDIT, *tables, *write_picture(folder / "fit", chart))
