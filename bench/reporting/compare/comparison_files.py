"""The comparison for programs: CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd

from bench.recordings import replacing
from bench.reporting.compare.changes import MetricChange
from bench.reporting.compare.comparison import RunComparison, category_line, verdict_line
from bench.reporting.compare.comparison_text import NOTE
from bench.reporting.compare.detections import paired_objects
from bench.reporting.compare.pictures import DrawnFrame
from bench.reporting.compare.stored_runs import StoredRun

SCHEMA_VERSION = 1
_CHANGED = ("gained", "lost", "both")


def to_csv(comparisons: Sequence[RunComparison]) -> str:
    """One line per pair of runs, row and metric, ratios at full precision; empty where there is no number."""
    heading = ["before_run", "after_run", "row", "frames", "metric", "before", "after", "difference", "ci95_low",
               "ci95_high", "p_value", "p_holm", "cases_before", "cases_after", "recordings", "chance_before",
               "chance_after", "verdict", "images_before", "images_after", "images_compared"]  # fmt: skip
    lines = []
    for comparison in comparisons:
        for row in comparison.rows:
            for metric, cell in row.metrics.items():
                change, chance = cell.change, cell.chance
                low, high = change.ci95 or (None, None)
                numbers = [change.before, change.after, change.difference, low, high, change.p_value, cell.p_holm]
                chances = [None, None] if chance is None else [figure.value for figure in chance]
                lines.append(
                    [comparison.before.label, comparison.after.label, row.name, row.frames, metric,
                     *map(_or_empty, numbers), change.cases_before, change.cases_after, change.recordings,
                     *map(_or_empty, chances), cell.verdict or "", *comparison.images]
                )  # fmt: skip
    return _csv(heading, lines)


def write_object_changes(file: Path, comparisons: Sequence[RunComparison]) -> None:
    """Write one line per object-frame that was gained, was lost, or changed its coverage, a part of them at a time."""
    columns = ["recording", "camera", "timestamp_ns", "track_id", "object_class", "category", "range_m", "region_px",
               "change", "coverage_before", "coverage_after", "iou_before", "iou_after"]  # fmt: skip
    with replacing(file) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["before_run", "after_run", *columns])
        for comparison in comparisons:
            labels = comparison.before.label, comparison.after.label
            for rows in paired_objects(comparison.before, comparison.after):
                changed = rows[rows["change"].isin(_CHANGED) & (rows["coverage_before"] != rows["coverage_after"])]
                values = [_cells(changed[name]) for name in columns]
                writer.writerows((*labels, *line) for line in zip(*values, strict=True))


def to_json(
    comparisons: Sequence[RunComparison],
    *,
    drawn: Sequence[Sequence[DrawnFrame]],
    remarks: Sequence[Sequence[str]],
) -> str:
    """Everything but the object-frames, at full precision; null where there is no number."""
    first = comparisons[0].before.summary
    content = {
        "schema_version": SCHEMA_VERSION,
        "note": NOTE,
        "dataset": first.dataset,
        "split": first.split,
        "protocol": first.protocol.model_dump(),
        "reference_fingerprint": first.reference_fingerprint,
        "comparisons": [
            _json_comparison(comparison, pictures, said)
            for comparison, pictures, said in zip(comparisons, drawn, remarks, strict=True)
        ],
    }
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _json_comparison(comparison: RunComparison, drawn: Sequence[DrawnFrame], remarks: Sequence[str]) -> dict[str, Any]:
    return {
        "before": _json_run(comparison.before),
        "after": _json_run(comparison.after),
        "images": dict(zip(("before", "after", "compared"), comparison.images, strict=True)),
        "verdict": verdict_line(comparison),
        "categories": category_line(comparison),
        "notes": list(comparison.notes),
        "rows": [
            {
                "name": row.name,
                "frames": row.frames,
                "recordings": row.recordings,
                "metrics": {metric: _json_change(cell) for metric, cell in row.metrics.items()},
            }
            for row in comparison.rows
        ],
        "detections": [asdict(counts) for counts in comparison.detections],
        "changed_frames": [asdict(frame) for frame in comparison.frames],
        "pictures": [{"file": f"pictures/{picture.name}", "title": picture.title} for picture in drawn],
        "remarks": list(remarks),
    }


def _json_run(run: StoredRun) -> dict[str, Any]:
    made = run.summary.provenance
    return {
        "run": run.label,
        "method": run.summary.method.model_dump(),
        "version": made.version,
        "commit": made.commit,
        "started_utc": made.started_utc,
    }


def _json_change(cell: MetricChange) -> dict[str, Any]:
    change = asdict(cell.change)
    return {
        **{name: _or_none(value) if isinstance(value, float) else value for name, value in change.items()},
        "p_holm": cell.p_holm,
        "verdict": cell.verdict,
        "chance": None if cell.chance is None else [_or_none(figure.value) for figure in cell.chance],
    }


def _cells(column: pd.Series[Any]) -> list[object]:
    values: list[object] = column.tolist()
    return [_or_empty(value) if isinstance(value, float) else value for value in values]


def _csv(heading: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(heading)
    writer.writerows(lines)
    return buffer.getvalue()


def _or_none(number: float) -> float | None:
    return None if math.isnan(number) else number


def _or_empty(number: float | None) -> str:
    return "" if number is None or math.isnan(number) else repr(float(number))
