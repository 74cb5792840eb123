"""The rules as files."""

import hashlib
from importlib import resources

import pytest

from bench.errors import DataError
from bench.gate.tolerances import known_tolerances, load_tolerances
from bench.gate.verdict import Outcome
from bench.reporting.verdict import change_lines
from tests.gate.factories import one, verdict_of

# Released files are never edited, only superseded.
RELEASED = {
    "default-v1": "4662592b37ac5b010184bff7dca39262f0ddc87ec1840382ed73a96debc591d6",
    "rendered-v1": "d72a1409d66a11cf3743275b7e1acedff26d20e120947a9f12a8238bd91aa008",
}


def own(tmp_path, text):
    file = tmp_path / "own.yaml"
    file.write_text(text)
    return file


def test_released_files_hold():
    folder = resources.files("bench.gate") / "tolerances"
    found = {name: hashlib.sha256((folder / f"{name}.yaml").read_bytes()).hexdigest() for name in known_tolerances()}
    assert found == RELEASED


def test_a_slice_overrides_its_metric_and_the_last_pattern_wins(tmp_path):
    file = own(
        tmp_path,
        """
based_on: default-v1
name: ours
version: 3
slices:
  "*": {tpr_all: {absolute: 0.03}}
  "range_m=*": {tpr_all: {absolute: 0.05}}
  "range_m=[0, 2)": {tpr_all: {relative: 0.5}}
  "points=[30*": {iou: {absolute: 0.5}}
""",
    )
    rules = load_tolerances(file)
    assert rules.tolerance("crossing", "tpr_all").absolute == 0.03
    assert rules.tolerance("crossing", "iou").absolute == 0.005
    assert rules.tolerance("range_m=[2, 4)", "tpr_all").absolute == 0.05
    near = rules.tolerance("range_m=[0, 2)", "tpr_all")
    assert (near.absolute, near.relative) == (0.05, 0.5)
    found = [rules.tolerance(f"points={bin}", "iou").absolute for bin in ("[30, 100)", "3")]
    assert found == [0.5, 0.005], "brackets of a bin are no set of characters"


def test_a_file_says_which_metrics_decide(tmp_path):
    runs = one([0.9] * 6), one([0.1] * 6)
    (row,) = verdict_of(*runs).rows
    assert row.outcome is Outcome.FAILED
    file = own(tmp_path, "based_on: default-v1\nslices: {crossing: {tpr_all: {decides: false}}}\n")
    verdict = verdict_of(*runs, load_tolerances(file))
    (row,) = verdict.rows
    assert (row.outcome, row.reason) == (Outcome.SUSPECT, "worse than tolerated, but this row decides nothing")
    assert verdict.why_none.startswith("nothing was judged")
    file = own(tmp_path, "based_on: default-v1\nmetrics: {recall: {decides: true}, f1: {absolute: 0.01}}\n")
    rules = load_tolerances(file)
    assert rules.tolerance("range_m=[0, 2)", "recall").decides
    assert rules.tolerance("frames", "f1").absolute == 0.01
    assert not rules.tolerance("frames", "precision").decides


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("based_on: default-v2", "based_on: expected one of default-v1, rendered-v1, got 'default-v2'"),
        ("based_on: default-v1\nmin_recordings: 1", "min_recordings: expected greater than or equal to 6, got 1"),
        ("based_on: default-v1\nslices: {crossing: {beauty: {absolute: 1}}}", "slices.crossing.beauty"),
        ("based_on: default-v1\nslices: {crossing: {iou: {absolut: 1}}}", "slices.crossing.iou.absolut"),
        ("based_on: default-v1\nmetrics: {iou: {better: higher}}", "metrics.iou.better: expected no such key"),
        ("based_on: default-v1\nmetrics: {iou: {absolute: .nan}}", "metrics.iou.absolute"),
        ("based_on: default-v1\nmetrics: {iuo: {absolute: 1}}", "own.yaml: metrics.iuo.[key]: expected a metric"),
        ("based_on: default-v1\nslices: {crossing: {iou: {relative: 5}}}", "less than 1, got 5"),
        ("based_on: default-v1\nmetrics: {iou: {absolute: 5}}", "5 never fails"),
        ("name: own", "expected a value, got nothing"),
        ("- a", "expected keys and values, got list"),
        ("a: [", "expected YAML"),
    ],
)
def test_mistakes_name_the_field(tmp_path, text, message):
    with pytest.raises(DataError) as fault:
        load_tolerances(own(tmp_path, text))
    assert message in str(fault.value)


def test_rules_that_are_of_no_row_are_listed_in_the_verdict(tmp_path):
    file = own(
        tmp_path,
        """
based_on: default-v1
name: ours
metrics: {recall: {absolute: 0.02}, tpr_all: {absolute: 0.02}}
slices:
  "object_class=pedestrain": {tpr_all: {absolute: 0.03}}
  crossing: {tpr_all: {absolute: 0.03}, iou: {absolute: 0.03}}
""",
    )
    verdict = verdict_of(one([0.5] * 6), one([0.5] * 6), load_tolerances(file))
    (found,) = [check for check in verdict.checks if check.name == "tolerances"]
    assert found.outcome is Outcome.SUSPECT
    assert found.message == "rules of no row: recall, tpr_all of object_class=pedestrain, iou of crossing"
    assert verdict.passed
    assert f"note: {found.message}" in change_lines(verdict)
    every = verdict_of(one([0.5] * 6), one([0.5] * 6), load_tolerances())
    assert "tolerances" not in [check.name for check in every.checks]
