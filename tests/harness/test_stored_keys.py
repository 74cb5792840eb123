"""Stored counts that are none of a run are refused where they are read, whoever reads them."""

import math
import shutil

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bench.errors import DataError
from bench.evaluation import sum_run
from bench.evaluation.maps import range_maps
from bench.harness import open_tables, read_run, read_tables
from tests.support.counts import change_table, counts_file
from tests.support.runs import PAPER, score


@pytest.fixture(scope="module")
def results(tiny_card, tmp_path_factory):
    run = tmp_path_factory.mktemp("keys") / "run"
    score(tiny_card, run, method="nothing")
    return run / PAPER.name


@pytest.fixture
def changed(results, tmp_path):
    return shutil.copytree(results, tmp_path / "results")


def change_cell(results, table, name, value):
    """Give a cell of a recording another value, or None where the schema of the file lets it be."""

    def change(rows: pa.Table) -> pa.Table:
        cells = rows[name].to_pylist()
        cells[1] = value
        return rows.set_column(rows.schema.names.index(name), name, pa.array(cells, rows.schema.field(name).type))

    change_table(results, table, change, recording="crossing")


@pytest.mark.parametrize(
    ("table", "name"),
    [
        *[("objects", name) for name in ("recording", "timestamp_ns", "track_id", "object_class", "tp")],
        *[("frames", name) for name in ("recording", "timestamp_ns", "status", "detected_px", "fp_by_cause")],
    ],
)
def test_a_null_where_every_row_has_a_value(changed, table, name):
    change_cell(changed, table, name, None)
    file = counts_file(changed, table, "crossing")
    with pytest.raises(DataError, match=rf"{file.name}: expected counts of a run, got .*'{name}'.*; remove the file"):
        read_tables(changed)


@pytest.mark.parametrize("table", ["objects", "frames"])
def test_a_row_that_is_there_twice_also_in_another_file(changed, table):
    file = counts_file(changed, table, "crossing")
    for each in file.parent.glob("*00000001*"):
        shutil.copy(each, each.with_name(each.name.replace("00000001", "00000009")))
    with pytest.raises(DataError, match=r"recording, camera, timestamp_ns.*: expected each row once, got one twice"):
        read_tables(changed)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("x_m", 1e9, r"x_m, y_m: expected centroids of evaluated objects within 33 m of the vehicle's origin"),
        ("x_m", math.inf, r"x_m, y_m: expected centroids"),
        ("object_class", "tram", r"object_class of evaluated objects: expected pedestrian, .*, got 'tram'"),
        ("direction", "up", r"direction of evaluated objects: expected lateral, .*, got 'up'"),
    ],
)
def test_maps_are_no_larger_than_the_protocol_lets_objects_lie(changed, name, value, message):
    change_cell(changed, "objects", name, value)
    run = read_run(changed)
    with pytest.raises(DataError, match=message):
        range_maps(run.objects, protocol=run.protocol)


@pytest.mark.parametrize(
    ("table", "name", "value"),
    [("objects", "category", "other"), ("objects", "status", "other"), ("frames", "status", "other")],
)
def test_words_of_no_run_are_in_no_summary(changed, table, name, value):
    change_cell(changed, table, name, value)
    with pytest.raises(DataError, match=r"counts of the run: .*expected .*got 'other'"):
        sum_run(*open_tables(changed), protocol=PAPER)


def test_a_table_of_other_columns(changed):
    file = counts_file(changed, "objects", "crossing")
    pq.write_table(pq.read_table(file).drop_columns(["tp"]), file)
    with pytest.raises(DataError, match=rf"{file.name}: tp: expected this column of a run's counts"):
        open_tables(changed)
