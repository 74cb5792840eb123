"""The paper's table as printed."""

from __future__ import annotations

from bench.evaluation import load_protocol, published
from bench.records.reference import Category


def test_every_category_in_order() -> None:
    assert list(published.CATEGORIES) == list(load_protocol("paper-v1").reference.categories)


def test_the_rows_sum_to_object_frames() -> None:
    assert sum(row.object_frames for row in published.CATEGORIES.values()) == 8093


def test_the_papers_iou_is_over_detected_object_frames() -> None:
    crossing = published.CATEGORIES[Category.CROSSING]
    assert crossing.iou > crossing.detection_rate * crossing.tpr
    assert all(row.iou <= row.tpr for row in published.CATEGORIES.values())
