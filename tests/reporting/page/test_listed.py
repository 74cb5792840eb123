"""Which object-frames the table of a page lists where there are too many."""

import numpy as np
import pytest

from bench.evaluation import rows
from bench.evaluation.rows import OBJECT, TableRows
from bench.reporting.object_table import listed_rows
from tests.evaluation.runs import random_run, shuffled


def keys(content):
    return [tuple(row[name] for name in OBJECT) for row in content]


@pytest.mark.parametrize("rows_at_once", [1, 20, 10_000])
def test_the_least_covered_are_listed_and_those_with_pictures(monkeypatch, rows_at_once):
    monkeypatch.setattr(rows, "ROWS_AT_ONCE", rows_at_once)
    objects, _ = random_run(2)
    content = objects.to_pylist()
    evaluated = sorted(
        (r["tp"] / (r["tp"] + r["fn"]), -r["region_px"], *keys([r])[0]) for r in content if r["region_px"]
    )
    pictured = {evaluated[-1][2:]}
    found, annotated = listed_rows(TableRows(shuffled(objects, 1)), pictured=pictured, most=10)
    assert annotated == len(content)
    assert keys(found.to_dict("records")) == [*(row[2:] for row in evaluated[:9]), evaluated[-1][2:]]


def test_all_are_listed_where_there_are_few():
    objects, _ = random_run(2)
    found, annotated = listed_rows(TableRows(objects), pictured=(), most=10_000)
    assert len(found) == annotated == objects.num_rows
    assert sorted(keys(found.to_dict("records"))) == sorted(keys(objects.to_pylist()))
    assert np.isfinite(found["tp"]).all()
