"""When a change fails, and when it does not."""

import math
from dataclasses import replace

import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.evaluation.comparison import PairedChange, compare_sums
from bench.gate.baseline import RunSums
from bench.gate.judge import judge
from bench.gate.verdict import Outcome
from tests.evaluation.runs import random_sums
from tests.gate.factories import ALL_DECIDE, RULES, TOLERATED, one, scored, sums, verdict_of


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ([0.5] * 6, [0.48] * 6, Outcome.FAILED),  # 2 points, tolerated is max(1, 2 % of 50) = 1
        ([0.5] * 6, [0.49] * 6, Outcome.PASSED),  # exactly what is tolerated
        ([0.9] * 6, [0.882] * 6, Outcome.PASSED),  # 2 % of 90 are 1.8 points
        ([0.9] * 6, [0.881] * 6, Outcome.FAILED),
        ([0.5] * 6, [0.6] * 6, Outcome.IMPROVED),
        ([0.5] * 6, [0.505] * 6, Outcome.PASSED),  # better within tolerance is not worth telling
        ([0.5] * 20, [0.3] * 6 + [0.5] * 16, Outcome.FAILED),  # enough recordings to exclude no change
        ([0.5] * 20, [0.3] * 3 + [0.5] * 17, Outcome.SUSPECT),
    ],
)
def test_a_loss_fails_beyond_what_is_tolerated_and_beyond_chance(before, after, expected):
    verdict = verdict_of(one(before), one(after))
    assert [row.outcome for row in verdict.rows] == [expected]
    assert verdict.passed == (expected is not Outcome.FAILED)


def test_a_loss_in_one_of_six_recordings_fails_only_where_equal_inputs_give_equal_results():
    before, after = one([0.5] * 6), one([0.5] * 5 + [0.0])
    verdict = verdict_of(before, after)
    (row,) = verdict.rows
    assert (row.outcome, row.worst_recordings[0].recording) == (Outcome.SUSPECT, "drive-5")
    assert row.ci95[0] < 0 < row.ci95[1]
    assert verdict.passed
    assert "1 suspect" in verdict.headline
    strict = RULES.model_copy(update={"suspect": "fail"})
    assert not verdict_of(before, after, strict).passed
    assert verdict_of(before, one([0.5] * 5 + [0.45]), strict).passed  # 0.8 points of all, 1 tolerated


LOSS = [0.5] * 4 + [0.47, 0.46, 0.45, 0.44]  # p = 0.0413, one-sided half of it


def with_other_kinds(values, kinds):
    slices = {f"kind-{k}": {"tpr_all": sums([0.5] * 8)} for k in range(kinds)}
    return scored(slices | {"crossing": {"tpr_all": sums(values)}})


@pytest.mark.parametrize(("others", "expected"), [(0, Outcome.FAILED), (1, Outcome.FAILED), (2, Outcome.SUSPECT)])
def test_the_more_rows_decide_the_clearer_a_loss_must_be(others, expected):
    verdict = verdict_of(with_other_kinds([0.5] * 8, others), with_other_kinds(LOSS, others))
    row = next(row for row in verdict.rows if row.slice_name == "crossing")
    assert row.outcome is expected
    assert row.p_holm == pytest.approx(0.0413 / 2 * (others + 1), abs=2e-4)
    assert row.p_value == pytest.approx(0.0413, abs=2e-4)
    assert verdict.passed == (expected is Outcome.SUSPECT)
    chance = "worse than tolerated, but among so many metrics it may be chance: p = 0.06"
    chance += ", corrected for testing many metrics (Holm)"
    assert row.reason == (chance if expected is Outcome.SUSPECT else "")


def test_rows_that_decide_nothing_count_for_nothing():
    def run(values):
        others = {f"range_m=[{k}, {k + 1})": {"tpr_all": sums([0.5] * 8)} for k in range(20)}
        return scored(others | {"crossing": {"tpr_all": sums(values), "detection_rate_10": sums(values)}})

    rows = {(row.slice_name, row.metric): row for row in verdict_of(run([0.5] * 8), run(LOSS)).rows}
    assert rows["crossing", "tpr_all"].outcome is Outcome.FAILED
    assert rows["crossing", "detection_rate_10"].outcome is Outcome.SUSPECT
    assert [row.p_holm is None for row in rows.values()].count(False) == 1


@pytest.mark.parametrize(
    ("before", "after", "reason"),
    [
        (one([0.9] * 6, cases=1), one([0.0] * 6, cases=1), "6 cases, 10 are needed"),
        (one([0.9]), one([0.0]), "cases of both in 1 recording, 6 are needed"),
        (one([0.9] * 5), one([0.0] * 5), "cases of both in 5 recordings, 6 are needed"),
        (one([0.9] * 6, metric="f1"), one([0.0] * 6, metric="f1"), "no tolerance is stated"),
        (scored({}), one([0.0] * 6), "not in the baseline"),
        (one([0.9] * 6, metric="tpr"), one([], metric="tpr"), "0 cases, 10 are needed"),
        (one([0.0] * 6, cases=0), one([0.0] * 6, cases=0), "0 cases, 10 are needed"),
    ],
)
def test_too_little_to_judge_is_told_with_the_reason(before, after, reason):
    (row,) = verdict_of(before, after).rows
    assert (row.outcome, row.reason) == (Outcome.NOT_JUDGED, reason)


def test_a_metric_over_pixels_counts_its_images():
    def with_images(value, images):
        counted = {"false_positive_coverage": {"drive-0": (0.0, images)}}
        return scored({"frames": {"precision": sums([value] * 6, cases=5000)} | counted})

    runs = ((with_images(0.9, images), with_images(0.1, images)) for images in (9.0, 10.0))
    few, many = ({row.metric: row.outcome for row in verdict_of(*pair, ALL_DECIDE).rows} for pair in runs)
    assert (few["precision"], many["precision"]) == (Outcome.NOT_JUDGED, Outcome.FAILED)


def test_the_worst_comes_first_in_units_of_what_is_tolerated():
    before = scored({"crossing": {"tpr_all": sums([0.5] * 6), "iou": sums([0.2] * 6)}})
    after = scored({"crossing": {"tpr_all": sums([0.45] * 6), "iou": sums([0.15] * 6)}})
    assert [row.metric for row in verdict_of(before, after).rows_with(Outcome.FAILED)] == ["iou", "tpr_all"]


def drawn(seed: int, **options: int) -> RunSums:
    return replace(scored({}), sums=random_sums(seed, **options))


def test_the_gate_has_the_changes_intervals_and_p_values_of_compare():
    before, after = drawn(1), drawn(2)
    compared = compare_sums(before.sums, after.sums)[[*PairedChange.__slots__]]
    rows = [{name: getattr(row, name) for name in compared} for row in verdict_of(before, after).rows]
    pd.testing.assert_frame_equal(pd.DataFrame(rows, index=compared.index, dtype=object), compared, check_dtype=False)


def test_every_metric_of_a_run_has_a_tolerance_and_every_tolerance_a_metric():
    rows = verdict_of(drawn(1), drawn(1)).rows
    assert {row.metric for row in rows if not math.isnan(row.allowed)} == {*TOLERATED}
    assert {row.metric for row in rows} == {*TOLERATED, "f1"}  # F1 follows from precision and recall


@settings(max_examples=3, deadline=None)  # each judges some 150 metrics
@given(seed=st.integers(0, 1000))
def test_a_run_never_fails_against_itself(seed):
    run = drawn(seed, recordings=7, images=3)
    verdict = verdict_of(run, run)
    assert verdict.passed
    assert {row.outcome for row in verdict.rows} <= {Outcome.PASSED, Outcome.NOT_JUDGED}
    assert any(row.outcome is Outcome.PASSED for row in verdict.rows)


@settings(max_examples=40, deadline=None)
@given(
    before=st.lists(st.floats(0, 1), min_size=6, max_size=9),
    loss=st.floats(0.0, 1.0),
    metric=st.sampled_from(TOLERATED),
)
def test_what_fails_is_worse_than_tolerated_and_beyond_doubt(before, loss, metric):
    after = [max(0.0, value - loss * (number % 3)) for number, value in enumerate(before)]
    runs = [scored({"crossing": {metric: sums(values)}}) for values in (before, after)]
    (row,) = judge(*runs, tolerances=ALL_DECIDE).rows
    assert not math.isnan(row.worsening)
    if row.ci95 is None:
        assert before == pytest.approx(after, abs=1e-10)
    low, high = row.ci95 or (0.0, 0.0)
    if row.outcome is Outcome.FAILED:
        assert row.worsening > row.allowed
        assert low > 0 or high < 0
    if row.outcome is Outcome.SUSPECT:
        assert row.worsening > row.allowed
        assert low <= 0 <= high or row.p_holm > 0.05
