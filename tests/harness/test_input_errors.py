"""Errors of what a method is told reach the method alone, and no stored answer or reader mistakes them."""

import pytest

from bench.errors import DataError, UnknownNameError, UsageError
from bench.harness import read_run
from bench.recordings import InputErrors, load_card
from bench.recordings.input_errors import named_input_errors
from tests.support import runs
from tests.support.runs import IMAGES


@pytest.fixture
def score(tiny_card, tmp_path):
    def scored(out, method="spherical", **errors):
        options = {"input_errors": named_input_errors(errors), "overwrite": True}
        return runs.score(tiny_card, tmp_path / out, method=method, **options)

    return scored


def test_a_run_with_errors_is_none_without(tiny_card, tmp_path, score):
    """Answers and data are told apart, and a reader is told of the errors."""
    told, found = [], []
    for errors in ({}, {"yaw_rate_bias_degps": 3.0}, {"yaw_rate_bias_degps": 2.0}):
        found.append(score("run", **errors))
        told.append(read_run(tmp_path / "run").manifest.dataset.input_errors)
    plain, *wrong = found
    assert [run.provenance.images_asked for run in found] == [IMAGES] * 3
    assert told == [{}, {"yaw_rate_bias_degps": 3.0}, {"yaw_rate_bias_degps": 2.0}]
    assert len({run.all_moving.model_dump_json() for run in (plain, *wrong)}) == 3
    assert wrong[1].caveats.endswith("The method was told errors of its input: yaw_rate_bias_degps 2.")
    assert plain.caveats == load_card(str(tiny_card)).content.caveats
    with pytest.raises(DataError, match="yaw_rate_bias_degps = 3"):
        runs.score(tiny_card, tmp_path / "run", input_errors=named_input_errors({"yaw_rate_bias_degps": 3.0}))
    assert score("run").model_dump_json(exclude={"provenance"}) == plain.model_dump_json(exclude={"provenance"})


def test_errors_reach_the_method_and_not_the_reference(score, tmp_path):
    true, wrong = score("true"), score("wrong", pitch_rate_degps=4)
    assert wrong.false_positives.coverage.value > true.false_positives.coverage.value + 0.1
    assert {name: row.object_frames for name, row in true.categories.items()} == {
        name: row.object_frames for name, row in wrong.categories.items()
    }
    assert read_run(tmp_path / "wrong").manifest.method == read_run(tmp_path / "true").manifest.method


def test_another_method_can_be_told_errors(score):
    assert score("run", method="everything", speed_scale_percent=10).all_moving.tpr_all.value == 1.0


def test_errors_are_named_numbers():
    assert named_input_errors({}) == InputErrors()
    assert named_input_errors({"pitch_deg": 1}) == InputErrors(pitch_deg=1.0)
    with pytest.raises(UnknownNameError, match="did you mean 'pitch_deg'"):
        named_input_errors({"pitch_degree": 1})
    for error in ("far", True, float("nan"), float("inf")):
        with pytest.raises(UsageError, match="input error pitch_deg: expected a number, got "):
            named_input_errors({"pitch_deg": error})
    with pytest.raises(UsageError, match="expected a number of at least 0, got -1"):
        named_input_errors({"image_noise_grey": -1})
