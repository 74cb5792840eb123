"""Stored counts that no run counts are refused where they are read, whoever reads them."""

from __future__ import annotations

import math
import shutil

import pyarrow as pa
import pytest

from bench.errors import DataError
from bench.evaluation.maps import range_maps
from bench.harness import open_tables, read_run
from bench.harness.stored import SUMMARY
from tests.support.counts import change_table, counts_file
from tests.support.runs import score


@pytest.fixture(scope="module")
def results(tiny_card, tmp_path_factory):
    run = tmp_path_factory.mktemp("keys") / "run"
    score(tiny_card, run, method="nothing")
    return next(run.glob(f"*/{SUMMARY}")).parent


def with_cell(name, value):
    def change(table: pa.Table) -> pa.Table:
        rows = table.to_pylist()
        rows[1][name] = value
        return pa.Table.from_pylist(rows, schema=table.schema)

    return change


def read(results):
    objects, frames = open_tables(results)
    return objects.table(), frames.table()


@pytest.mark.parametrize(
    ("table", "name", "value"),
    [
        *[("objects", name, None) for name in ("recording", "camera", "timestamp_ns", "track_id", "object_class")],
        *[("frames", name, None) for name in ("recording", "camera", "timestamp_ns", "status", "detected_px")],
        *[(table, name, "other") for table in ("objects", "frames") for name in ("recording", "camera", "status")],
        *[("objects", name, "other") for name in ("reason", "category", "direction")],
        ("objects", "timestamp_ns", 7),
        *[("objects", "tp", value) for value in (None, -5, 2**62)],
        *[("objects", "x_m", value) for value in (math.inf, -1e300)],
        *[("frames", "valid_px", value) for value in (-1, 2**50)],
    ],
)
def test_a_cell_that_no_run_writes(results, tmp_path, table, name, value):
    changed = shutil.copytree(results, tmp_path / "results")
    change_table(changed, table, with_cell(name, value), recording="crossing")
    of_objects = name == "timestamp_ns" and table == "frames"  # the time of an image is missing, of which objects are
    file = counts_file(changed, "objects" if of_objects else table, "crossing")
    with pytest.raises(DataError, match=rf"{file.name}: {name}: expected .*, got .*; remove the file, and run again"):
        read(changed)


@pytest.mark.parametrize("table", ["objects", "frames"])
def test_a_row_that_is_there_twice_also_in_another_file(results, tmp_path, table):
    changed = shutil.copytree(results, tmp_path / "results")
    file = counts_file(changed, table, "crossing")
    for each in file.parent.glob("*00000001*"):
        shutil.copy(each, each.with_name(each.name.replace("00000001", "00000009")))
    with pytest.raises(DataError, match=r"recording, camera, timestamp_ns.*: expected each row once, got one twice"):
        read(changed)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("x_m", 1e9, r"x_m, y_m: expected centroids of evaluated objects within 33 m of the vehicle's origin"),
        ("object_class", "tram", r"object_class of evaluated objects: expected pedestrian, .*, got 'tram'"),
    ],
)
def test_maps_are_no_larger_than_the_protocol_lets_objects_lie(results, tmp_path, name, value, message):
    changed = shutil.copytree(results, tmp_path / "results")
    change_table(changed, "objects", with_cell(name, value), recording="crossing")
    run = read_run(changed)
    with pytest.raises(DataError, match=message):
        range_maps(run.objects, protocol=run.protocol)
