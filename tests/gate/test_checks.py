"""A score over other objects, images or data is no better score."""

from dataclasses import replace

import pytest

from bench.errors import UsageError
from bench.evaluation.summary import ProtocolOfRun
from bench.gate import Outcome, load_tolerances
from bench.gate.brief import change_lines
from tests.gate.factories import ALL_DECIDE, RULES, changed, one, scored, sums, verdict_of
from tests.support.manifests import method_of_run

COUNTS = {
    "all_moving": {"tracks": {"drive-0": (7.0, 40.0)}},
    "status=evaluated": {"annotated": {"drive-0": (40.0, 40.0)}, "images": {"drive-0": (20.0, 20.0)}},
    "status=static": {"annotated": {"drive-0": (20.0, 20.0)}},
    "status=failed": {"images": {"drive-0": (10.0, 10.0)}},
}


def counted(metric="", difference=0.0):
    """A run with these counts; of one metric both of its numbers differ in its first slice with that many."""
    slices = {name: dict(own) for name, own in COUNTS.items()}
    for called in {"tracks": ["all_moving"], "annotated": ["status=static"], "images": ["status=evaluated"]}.get(
        metric, []
    ):
        slices[called][metric] = {"drive-0": tuple(term + difference for term in slices[called][metric]["drive-0"])}
    return scored(slices)


def check(before, after, name, rules=RULES):
    verdict = verdict_of(before, after, rules)
    return next(found for found in verdict.checks if found.name == name), verdict


@pytest.mark.parametrize(
    ("metric", "told"),
    [
        ("tracks", "3 object-frames fewer in all_moving (37, were 40); 3 tracks fewer in all_moving (4, were 7)"),
        (
            "annotated",
            "3 annotated objects fewer in all_moving (57, were 60); 3 static fewer in all_moving (17, were 20)",
        ),
        ("images", "3 images fewer in frames (27, were 30); 3 scored images fewer in frames (17, were 20)"),
    ],
)
def test_fewer_objects_or_images_fail(metric, told):
    found, verdict = check(counted(), counted(metric, -3.0), "counts")
    assert found.outcome is Outcome.FAILED
    assert found.message == f"reference changed: {told}"
    assert not verdict.passed


def test_more_objects_fail_too():
    found, _ = check(counted(), counted("tracks", 1.0), "counts")
    assert "1 object-frames more in all_moving (41, were 40)" in found.message


def test_what_only_the_run_has_fails_too():
    found, _ = check(scored({}), counted(), "counts")
    assert "40 object-frames more in all_moving (40, were 0)" in found.message


def test_a_metric_over_fewer_cases_fails_though_it_scores_better():
    before, after = one([0.5] * 6), one([1.0] * 6, cases=8)
    found, verdict = check(before, after, "cases")
    assert found.message == "metrics are over other cases: tpr_all: 12 cases fewer in crossing (48, were 60)"
    assert verdict.rows[0].outcome is Outcome.IMPROVED
    assert not verdict.passed


def test_as_many_cases_of_other_recordings_fail():
    before = one([0.5] * 6)
    moved = {**sums([0.5] * 6), "drive-0": (5.0, 11.0), "drive-1": (5.0, 9.0)}
    found, verdict = check(before, scored({"crossing": {"tpr_all": moved}}), "cases")
    assert "spread otherwise over the recordings" in found.message
    assert not verdict.passed


def test_metrics_over_detections_may_change_their_cases():
    _, verdict = check(one([0.5] * 6, metric="tpr"), one([0.5] * 6, metric="tpr", cases=8), "cases", ALL_DECIDE)
    assert verdict.passed


def test_a_metric_or_a_slice_that_is_gone_fails():
    found, verdict = check(one([0.5] * 6), scored({}), "metrics")
    assert found.message == "in the baseline, but not in the run: tpr_all of crossing"
    assert not verdict.passed


def test_another_reference_fails():
    found, verdict = check(one([0.5] * 6), changed(one([0.5] * 6), reference="x" * 64), "reference_digest")
    assert "reference changed" in found.message
    assert not verdict.passed


def test_other_images_are_told_with_their_numbers():
    frames = [{"frames": {"false_positive_coverage": sums([0.2] * 6, cases=n)}} for n in (29, 27)]
    after = scored(frames[1], reference="x" * 64)
    found, verdict = check(scored(frames[0]), after, "reference_digest")
    assert found.message.startswith(
        "reference changed: other images were scored, 162 where the baseline has 174, and a gate compares equal ones; "
        "they differ in 6 of 6 recordings, the first 'drive-0' with 27 (was 29)"
    )
    assert not verdict.passed


def test_other_data_fail_unless_the_rules_say_report():
    after = changed(one([0.5] * 6), data="x" * 64)
    found, verdict = check(one([0.5] * 6), after, "data_digest")
    assert (found.outcome, verdict.passed) == (Outcome.FAILED, False)
    found, verdict = check(one([0.5] * 6), after, "data_digest", load_tolerances("rendered-v1"))
    assert (found.outcome, verdict.passed) == (Outcome.SUSPECT, True)


def test_recordings_with_other_data_are_named():
    drives = {f"drive-{k}": "0" * 16 for k in range(6)}
    before = changed(one([0.5] * 6), recordings=drives | {"gone": "1" * 16})
    now = drives | {"drive-4": "2" * 16, "later": "3" * 16}
    after = changed(one([0.5] * 6), recordings=now)
    found, verdict = check(before, after, "data_digest")
    told = (
        "recordings changed: 'drive-4' (1 of 6); recordings new: 'later' (1 of 7); "
        "recordings missing: 'gone' (1 of 7); digest "
    )
    assert found.message.startswith(f"data changed: other images, sweeps, labels, calibration or ego-motion; {told}")
    assert [change.text.startswith(told) for change in verdict.changes] == [True]
    rendered = changed(before, recordings=dict.fromkeys(drives, "4" * 16))
    found, _ = check(changed(before, recordings=drives), rendered, "data_digest")
    assert "changed: 'drive-0', 'drive-1', 'drive-2', 'drive-3' and 2 more (6 of 6); digest" in found.message


def test_a_run_with_failures_fails():
    after = replace(one([0.5] * 6), failures=("recording 'a': no calibration", "recording 'b': no lidar"))
    found, verdict = check(one([0.5] * 6), after, "failures")
    assert found.message.startswith("the run has 2 failures: recording 'a': no calibration;")
    assert not verdict.passed


def test_changed_settings_are_told_by_their_dotted_names_and_fail_nothing():
    settings = {"weights": {"epipolar": 0.5}, "threshold": 6e-4}
    after = changed(one([0.5] * 6), method=method_of_run("spherical", settings=settings))
    found, verdict = check(one([0.5] * 6), after, "method")
    assert found.message == "method changed: weights.epipolar = 0.5, was 1.0"
    assert verdict.passed


def test_a_long_list_is_cut_with_its_count():
    slices = {f"points={k}": {"tracks": {"drive-0": (0.0, 9.0)}} for k in range(6)}
    found, _ = check(scored(slices), scored({}), "counts")
    assert found.message.endswith("; and 2 more")


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"name": "other"}, "data set 'demo', the run of 'other': they do not compare; name a baseline of 'other'"),
        ({"split": "night"}, "split none, the run of 'night': they do not compare; score with no --split, or replace"),
        (
            {"protocol": ProtocolOfRun(name="paper-v1", version=1, digest="e" * 64)},
            "the baseline is of protocol paper-v1 version 1",
        ),
        (
            {"protocol": ProtocolOfRun(name="surface-v1", version=1, digest="e" * 64)},
            "they do not compare; score with --protocol paper-v1, or replace the baseline with --update",
        ),
    ],
)
def test_another_data_set_split_or_protocol_is_refused(changes, told):
    with pytest.raises(UsageError, match=told):
        verdict_of(one([0.5] * 6), changed(one([0.5] * 6), **changes))


def rendered_elsewhere(pixels=0.0, rebinned=0.0, static=0.0):
    """Baseline and run of other data and another reference: in the first of six recordings that much is otherwise."""

    def made(pixels, rebinned, static, **changes):
        drives = sums([0.5] * 6, cases=40)
        slices = {
            "frames": {"recall": {**sums([0.5] * 6, cases=20_000), "drive-0": (10_000.0, 20_000.0 + pixels)}},
            "all_moving": {"tracks": drives, "tpr_all": drives},
            "range_m=[2, 4)": {"tracks": {**drives, "drive-0": (20.0, 40.0 - rebinned)}},
            "range_m=[4, 6)": {"tracks": {**drives, "drive-0": (20.0, 40.0 + rebinned)}},
            "status=static": {"annotated": {"drive-0": (20.0 + static, 20.0 + static)}},
        }
        return scored(slices, **changes)

    return made(0, 0, 0), made(pixels, rebinned, static, data="x" * 64, reference="x" * 64)


def test_a_reference_that_differs_by_what_a_processor_tips_is_noted():
    found, verdict = check(*rendered_elsewhere(20, 1), "reference_digest", load_tolerances("rendered-v1"))
    assert (found.outcome, verdict.passed) == (Outcome.SUSPECT, True)
    told = "differ in 1 of 6 recordings, by at most 0.1 %, and 1 of 240 object-frames lie in another bin; the metrics"
    assert told in found.message
    assert any(told in line for line in change_lines(verdict))


@pytest.mark.parametrize("changes", [{"pixels": 21}, {"pixels": -21}, {"rebinned": 3}, {"static": 1}])
def test_a_reference_that_differs_by_more_fails(changes):
    found, verdict = check(*rendered_elsewhere(**changes), "reference_digest", load_tolerances("rendered-v1"))
    assert (found.outcome, verdict.passed) == (Outcome.FAILED, False)
    assert found.message.startswith("reference changed: ")


def test_no_difference_of_the_reference_is_small_where_the_data_are_the_same_or_stay():
    before, after = rendered_elsewhere(1)
    same_data = changed(after, recordings=before.manifest.dataset.recordings)
    assert check(before, same_data, "reference_digest", load_tolerances("rendered-v1"))[0].outcome is Outcome.FAILED
    assert check(before, after, "reference_digest")[0].outcome is Outcome.FAILED
