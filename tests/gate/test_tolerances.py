"""The rules as files."""

import hashlib
from importlib import resources

import pytest

from bench.errors import DataError, UnknownNameError
from bench.gate import Outcome, known_tolerances, load_tolerances
from tests.gate.factories import one, verdict_of

# Released files are never edited, only superseded.
RELEASED = {
    "default-v1": "76eafa76ecf106b3af30b7335368f85762230f589be40489594f76d32bb18722",
    "rendered-v1": "866696e6b27ec6dd0b90c52382c2bb1a3b695df5e1d4127c6cea5c608d5b6cd3",
}


def own(tmp_path, text):
    file = tmp_path / "own.yaml"
    file.write_text(text)
    return file


def test_released_files_hold():
    folder = resources.files("bench.gate") / "tolerances"
    found = {name: hashlib.sha256((folder / f"{name}.yaml").read_bytes()).hexdigest() for name in known_tolerances()}
    assert found == RELEASED


def test_rendered_differs_from_default_in_one_rule():
    default, rendered = load_tolerances(), load_tolerances("rendered-v1")
    assert rendered == default.model_copy(update={"name": "rendered-v1", "changed_data": "report"})


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
""",
    )
    rules = load_tolerances(file)
    assert rules.tolerance("crossing", "tpr_all").absolute == 0.03
    assert rules.tolerance("crossing", "iou").absolute == 0.005
    assert rules.tolerance("range_m=[2, 4)", "tpr_all").absolute == 0.05
    near = rules.tolerance("range_m=[0, 2)", "tpr_all")
    assert (near.absolute, near.relative, near.better) == (0.05, 0.5, "higher")
    assert rules.metrics.keys() == load_tolerances().metrics.keys()


def test_brackets_of_a_bin_are_no_set_of_characters(tmp_path):
    file = own(tmp_path, 'based_on: default-v1\nslices: {"points=[30*": {iou: {absolute: 0.5}}}\n')
    rules = load_tolerances(file)
    assert rules.tolerance("points=[30, 100)", "iou").absolute == 0.5
    assert rules.tolerance("points=3", "iou").absolute == 0.005


def test_a_metric_that_is_not_to_be_judged_is_reported(tmp_path):
    file = own(tmp_path, "based_on: default-v1\nslices: {crossing: {tpr_all: {judged: false}}}\n")
    (row,) = verdict_of(one([0.9] * 4), one([0.1] * 4), load_tolerances(file)).rows
    assert (row.outcome, row.reason) == (Outcome.NOT_JUDGED, "the tolerances say so")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("based_on: default-v2", "based_on: expected one of default-v1, rendered-v1, got 'default-v2'"),
        ("based_on: default-v1\nmin_recordings: 1", "min_recordings: expected greater than or equal to 2, got 1"),
        ("based_on: default-v1\nslices: {crossing: {beauty: {absolute: 1}}}", "slices.crossing.beauty"),
        ("based_on: default-v1\nslices: {crossing: {iou: {absolut: 1}}}", "slices.crossing.iou.absolut"),
        ("based_on: default-v1\nmetrics: {iou: {better: more, absolute: 0, relative: 0}}", "metrics.iou.better"),
        ("based_on: default-v1\nmetrics: {iou: {better: lower, absolute: .nan, relative: 0}}", "metrics.iou.absolute"),
        ("name: own", "expected a value, got nothing"),
        ("- a", "expected keys and values, got list"),
        ("a: [", "expected YAML"),
    ],
)
def test_mistakes_name_the_field(tmp_path, text, message):
    with pytest.raises(DataError) as fault:
        load_tolerances(own(tmp_path, text))
    assert message in str(fault.value)


def test_an_unknown_name_lists_the_known():
    with pytest.raises(UnknownNameError, match="did you mean 'default-v1'"):
        load_tolerances("default-v9")
