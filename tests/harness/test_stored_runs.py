"""A stored run loads, and reduces to the figures that it had."""

import math
import shutil
from pathlib import Path

import pyarrow as pa
import pytest

from bench.errors import DataError
from bench.evaluation import Metric, sum_run, summarise, threshold_sweep
from bench.evaluation.summary import take_ratios
from bench.harness import open_tables, read_image_maps, read_run, read_tables
from bench.harness.stored import HISTOGRAMS
from tests.support.counts import change_table

STORED = Path(__file__).parents[1] / "stored"
RUNS = sorted(folder for folder in STORED.iterdir() if folder.is_dir())


@pytest.fixture(params=RUNS, ids=[run.name for run in RUNS])
def stored(request) -> Path:
    return request.param


def summary_of(part: object, path: str = "") -> dict[str, Metric]:
    """All figures of a summary by their place in it."""
    if isinstance(part, Metric):
        return {path: part}
    pairs = part.items() if isinstance(part, dict) else part if hasattr(part, "model_dump") else ()
    return {name: figure for key, inner in pairs for name, figure in summary_of(inner, f"{path}/{key}").items()}


def test_a_stored_run_reduces_to_its_figures(stored):
    run = read_run(stored)
    summary, protocol = run.summary, run.protocol
    assert protocol.digest == run.manifest.protocol.digest
    again = summarise(*read_tables(stored), protocol=protocol)
    assert (again.objects, again.images) == (summary.objects, summary.images)
    then, now = summary_of(summary), summary_of(again)
    assert then.keys() == now.keys()
    assert len(then) > 200
    for name, figure in then.items():
        assert now[name].value == pytest.approx(figure.value, rel=1e-9, nan_ok=True), name
        assert now[name].cases == figure.cases, name
        assert (now[name].ci95 is None) == (math.isnan(figure.value) or now[name].recordings < 6), name


def test_a_stored_runs_sums_have_its_figures(stored):
    run = read_run(stored)
    summary, protocol = run.summary, run.protocol
    found = take_ratios(sum_run(*open_tables(stored), protocol=protocol))
    for category, row in summary.categories.items():
        for metric in row.metric_names() if row.object_frames else ():
            value = found["category", category, metric].value
            assert value == pytest.approx(row.metric(metric).value, rel=1e-9, nan_ok=True), (category, metric)
    coverage = found["frames", "frames", "false_positive_coverage"]
    assert coverage.value == pytest.approx(summary.false_positives.coverage.value)


def test_a_stored_runs_curve_and_maps_agree_with_its_figures(stored):
    summary, (_, frames) = read_run(stored).summary, read_tables(stored)
    sweep = threshold_sweep(frames)
    threshold = read_run(stored).manifest.method.settings["threshold"]
    (at,) = [k for k, edge in enumerate(sweep.thresholds.tolist()) if edge == threshold]
    assert sweep.recall[at] == pytest.approx(summary.segmentation.recall.value)
    assert sweep.precision[at] == pytest.approx(summary.segmentation.precision.value)
    assert sweep.false_positive_coverage[at] == pytest.approx(summary.false_positives.coverage.value)
    (front,) = read_image_maps(stored).values()
    assert (front.camera, front.frames) == ("front", summary.images.evaluated)
    for grid, column in ((front.reference_px, "reference_px"), (front.missed_px, "fn_px"), (front.false_px, "fp_px")):
        assert grid.sum() == sum(frames[column].to_pylist()) > 0


def test_histograms_may_stay_unread(stored):
    objects, frames = read_tables(stored, histograms=False)
    whole = read_tables(stored)
    assert objects == whole[0]
    assert frames == whole[1].drop_columns(sorted(HISTOGRAMS))


def test_a_column_of_another_kind_is_named(stored, tmp_path):
    run = Path(shutil.copytree(stored, tmp_path / "run"))
    change_table(run, "objects", as_words, recording="crossing")
    with pytest.raises(DataError, match=r"objects\.parquet: expected counts of a run, got .*'x'"):
        read_tables(run)


def as_words(table: pa.Table) -> pa.Table:
    return table.set_column(table.schema.names.index("tp"), "tp", pa.array(["x"] * len(table)))
