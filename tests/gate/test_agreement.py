"""Gate and comparison are one: of the same two runs they say the same."""

import math

import pytest

from bench.evaluation import PairedChange
from bench.gate import judge, load_tolerances, read_baseline, read_run_sums
from bench.reporting.compare import compare_runs
from tests.reporting.compare.runs import drawn, write_run

CHANGE = [*PairedChange.__slots__]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    changed = {key: px - 5 * key[0] if key[2] == "crossing" else px for key, px in drawn(60).items()}
    folder = tmp_path_factory.mktemp("runs")
    return [
        write_run(folder / name, detected, fp_px=fp_px)
        for name, detected, fp_px in (("before", drawn(50), 3072), ("after", changed, 4000))
    ]


@pytest.fixture(scope="module")
def rows(folders):
    """The rows of the gate."""
    return judge(read_baseline(folders[0]), read_run_sums(folders[1]), tolerances=load_tolerances()).rows


def test_the_gate_has_the_changes_intervals_and_p_values_of_compare(folders, rows):
    (comparison,) = compare_runs(folders)
    gate = {(row.slice_name, row.metric): {name: getattr(row, name) for name in CHANGE} for row in rows}
    shown = comparison.changes.reset_index().to_dict("records")
    compared = {(row["slice"], row["metric"]): row for row in shown if row["cases_before"] and row["cases_after"]}
    assert compared.keys() <= gate.keys()
    for key, row in compared.items():
        assert gate[key] == {name: row[name] for name in CHANGE} | (
            {"p_value": None} if math.isnan(row["p_value"]) else {}
        )
    assert any(gate[key]["ci95"] is not None and gate[key]["p_value"] is not None for key in compared)
