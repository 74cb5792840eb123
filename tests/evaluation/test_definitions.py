"""What every metric promises, from its one definition."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.errors import UnknownNameError
from bench.evaluation import published
from bench.evaluation.definitions import (
    OBJECT_FRAMES,
    Definition,
    cause_metric,
    find_metric,
    headlines,
    image_metrics,
    object_metrics,
)
from bench.evaluation.protocol import load_protocol
from bench.evaluation.rows import to_frame
from bench.records.reference import Category
from tests.evaluation.runs import random_run

METRICS = (*object_metrics((0.1, 0.5), unknown_bands=True, ceilings=True), *image_metrics(["epipolar", "depth"]))
DOCS = Path("docs/metrics.md").read_text(encoding="utf-8")
every_metric = pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.name)


def test_names_are_unique() -> None:
    assert len({metric.name for metric in METRICS}) == len(METRICS)
    assert len({metric.label for metric in METRICS}) == len(METRICS)


@every_metric
def test_sums_are_finite_and_a_ratio_is_in_its_bounds(metric: Definition) -> None:
    objects, frames = map(to_frame, random_run(1))
    rows = objects.assign(unknown_px=7, ceiling_tp=objects["tp"], ceiling_fp=3.0)
    rows.loc[rows.index[::3], ["ceiling_tp", "ceiling_fp"]] = np.nan
    rows = rows if metric.over == OBJECT_FRAMES else frames
    rows = rows[rows["status"] == "evaluated"]
    above, below = (np.asarray(term(rows), dtype=np.float64) for term in (metric.numerator, metric.denominator))
    assert above.shape == below.shape == (len(rows),)
    assert np.isfinite(above).all()
    assert (above >= 0).all()
    assert (above[below == 0] == 0).all()
    assert below.sum() > 0
    if metric.is_ratio:
        assert (above <= below + 1e-12).all()
    if metric.over == OBJECT_FRAMES:
        assert {*below} <= {0, 1}, "the gate and the tables count the denominators as object-frames"


@every_metric
def test_a_metric_is_found_by_its_name(metric: Definition) -> None:
    found = find_metric(metric.name)
    assert (found.name, found.label, found.higher_is_better) == (metric.name, metric.label, metric.higher_is_better)


@pytest.mark.parametrize("metric", [*METRICS[:-2], cause_metric("NAME")], ids=lambda metric: metric.name)
def test_docs_have_the_row_of_a_metric(metric: Definition) -> None:
    better = {True: "higher", False: "lower", None: ""}[metric.higher_is_better]
    row = f"| `{metric.name}` | {metric.label} | {metric.meaning.removesuffix('.')} | {better} |"
    assert row in DOCS, f"docs/metrics.md: expected the line {row}"


@pytest.mark.parametrize("name", ["iuo", "detection_rate_", "detection_rate_half", "chance_050", ""])
def test_an_unknown_name_is_refused(name: str) -> None:
    with pytest.raises(UnknownNameError, match="known are"):
        find_metric(name)


def test_the_headlines() -> None:
    names = ["iou", "tpr_all", "detection_rate_50", "false_positive_coverage"]
    assert [metric.name for metric in headlines()] == names
    assert {metric.name for metric in METRICS if metric.headline} == set(names)
    assert [metric.name for metric in headlines(levels=(0.1,))] == ["iou", "tpr_all", "false_positive_coverage"]


def test_the_papers_table_as_printed() -> None:
    rows = published.CATEGORIES
    assert list(rows) == list(load_protocol("paper-v1").reference.categories)
    assert sum(row.object_frames for row in rows.values()) == 8093
    crossing = rows[Category.CROSSING]
    assert crossing.iou > crossing.detection_rate * crossing.tpr, "IoU is over the detected object-frames"
    assert all(row.iou <= row.tpr for row in rows.values())
