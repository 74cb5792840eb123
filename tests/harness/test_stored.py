"""What is stored of a run: it reduces to the figures that it had; what is none of a run is refused where it is read."""

import math
import shutil
from pathlib import Path

import pyarrow as pa
import pytest

from bench.errors import DataError
from bench.evaluation.maps import range_maps
from bench.evaluation.summary import Metric, summary_of
from bench.evaluation.sums import sum_run
from bench.evaluation.thresholds import HISTOGRAMS
from bench.harness.stored import read_run
from tests.support.counts import change_table, counts_file, read_tables
from tests.support.runs import PAPER, score

STORED = Path(__file__).parents[1] / "stored"
RUNS = sorted(folder for folder in STORED.iterdir() if folder.is_dir())


@pytest.fixture(params=RUNS, ids=[run.name for run in RUNS])
def stored(request) -> Path:
    return request.param


def figures_of(part: object, path: str = "") -> dict[str, Metric]:
    """All figures of a summary by their place in it."""
    if isinstance(part, Metric):
        return {path: part}
    pairs = part.items() if isinstance(part, dict) else part if hasattr(part, "model_dump") else ()
    return {name: figure for key, inner in pairs for name, figure in figures_of(inner, f"{path}/{key}").items()}


def test_a_stored_run_reduces_to_its_figures(stored):
    run = read_run(stored)
    summary, protocol = run.summary, run.protocol
    assert protocol.digest == run.manifest.protocol.digest
    again = summary_of(sum_run(run.parts("objects"), run.parts("frames"), protocol=protocol), protocol=protocol)
    assert (again.objects, again.images) == (summary.objects, summary.images)
    then, now = figures_of(summary), figures_of(again)
    assert then.keys() <= now.keys(), "a metric that came later is new, and none is gone"
    assert len(then) > 200
    for name, figure in then.items():
        assert now[name].value == pytest.approx(figure.value, rel=1e-9, nan_ok=True), name
        assert now[name].cases == figure.cases, name
        assert (now[name].ci95 is None) == (math.isnan(figure.value) or now[name].recordings < 6), name


def test_histograms_may_stay_unread(stored):
    objects, frames = read_tables(stored, histograms=False)
    whole = read_tables(stored)
    assert objects == whole[0]
    assert frames == whole[1].drop_columns([*HISTOGRAMS])


# ---- counts that no run writes


@pytest.fixture(scope="module")
def results(tiny_card, tmp_path_factory):
    run = tmp_path_factory.mktemp("keys") / "run"
    score(tiny_card, run, method="nothing")
    return run / PAPER.name


@pytest.fixture
def changed(results, tmp_path):
    return shutil.copytree(results, tmp_path / "results")


def with_cell(name, value):
    """The change of a table that gives a cell another value, or None where the schema of the file lets it be."""

    def change(rows: pa.Table) -> pa.Table:
        cells = rows[name].to_pylist()
        cells[1] = value
        return rows.set_column(rows.schema.names.index(name), name, pa.array(cells, rows.schema.field(name).type))

    return change


def as_words(rows: pa.Table) -> pa.Table:
    return rows.set_column(rows.schema.names.index("tp"), "tp", pa.array(["x"] * len(rows)))


@pytest.mark.parametrize(
    ("table", "told", "change"),
    [
        *[("objects", f"'{name}'", with_cell(name, None)) for name in ("track_id", "tp")],
        *[("frames", f"'{name}'", with_cell(name, None)) for name in ("status", "fp_by_cause")],
        ("objects", r"\btp\b", lambda rows: rows.drop_columns(["tp"])),
        ("objects", "'x'", as_words),
    ],
)
def test_a_column_that_is_missing_has_a_null_or_is_of_another_kind_is_named(changed, table, told, change):
    change_table(changed, table, change, recording="crossing")
    file = counts_file(changed, table, "crossing")
    with pytest.raises(DataError, match=rf"{file.name}: expected counts of a run, got .*{told}.*; remove the file"):
        read_tables(changed)


@pytest.mark.parametrize("table", ["objects", "frames"])
def test_a_row_that_is_there_twice_also_in_another_file(changed, table):
    file = counts_file(changed, table, "crossing")
    for each in file.parent.glob("*00000001*"):
        shutil.copy(each, each.with_name(each.name.replace("00000001", "00000009")))
    with pytest.raises(DataError, match=r"recording, camera, timestamp_ns.*: expected each row once, got one twice"):
        read_tables(changed)


@pytest.mark.parametrize("x_m", [1e9, math.inf])
def test_maps_are_no_larger_than_the_protocol_lets_objects_lie(changed, x_m):
    change_table(changed, "objects", with_cell("x_m", x_m), recording="crossing")
    run = read_run(changed)
    with pytest.raises(
        DataError, match=r"x_m, y_m: expected centroids of evaluated objects within 33 m of the vehicle"
    ):
        range_maps(run.evaluated("objects"), protocol=run.protocol)
