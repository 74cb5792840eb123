"""A score over other objects, images or data is no better score; and what is told of runs that differ."""

from dataclasses import replace
from pathlib import Path

import pytest

from bench.errors import UsageError
from bench.evaluation.summary import ProtocolOfRun
from bench.gate.baseline import how_to_compare
from bench.gate.tolerances import load_tolerances
from bench.gate.verdict import Outcome
from bench.reporting.verdict import change_lines
from tests.gate.factories import ALL_DECIDE, RULES, changed, one, scored, sums, verdict_of
from tests.support.manifests import method_of_run

RENDERED = load_tolerances("rendered-v1")
SAME = one([0.5] * 6)
DRIVES = {f"drive-{k}": "0" * 16 for k in range(6)}
FAILURES = ("recording 'a': no calibration", "recording 'b': no lidar")


def check(before, after, name, rules=RULES):
    verdict = verdict_of(before, after, rules)
    return next(found for found in verdict.checks if found.name == name), verdict


def counted(*, tracks=(7.0, 40.0), static=20.0, evaluated=20.0):
    """A run with these counts: objects and object-frames, annotated objects that stand, images that are scored."""
    return scored(
        {
            "all_moving": {"tracks": {"drive-0": tracks}},
            "status=evaluated": {"annotated": {"drive-0": (40.0, 40.0)}, "images": {"drive-0": (evaluated, evaluated)}},
            "status=static": {"annotated": {"drive-0": (static, static)}},
            "status=failed": {"images": {"drive-0": (10.0, 10.0)}},
        }
    )


SLICES = {f"points={k}": {"tracks": {"drive-0": (0.0, 9.0)}} for k in range(7)}


FEWER = "reference changed: 3 object-frames fewer in all_moving (37, were 40); 3 tracks fewer in all_moving (4, were 7)"
NOT_ALIKE = {  # baseline, run, and what the check says
    "reference": [
        (counted(), counted(tracks=(4.0, 37.0)), FEWER),
        (counted(), counted(static=17.0), ": 3 annotated objects fewer in status=static (17, were 20)"),
        (counted(), counted(evaluated=17.0), ": 3 images fewer in status=evaluated (17, were 20)"),
        (counted(), counted(tracks=(7.0, 41.0)), "1 object-frames more in all_moving (41, were 40)"),
        (scored({}), counted(), "40 object-frames more in all_moving (40, were 0)"),
        (scored(SLICES), scored({}), "; and 2 more"),
        (SAME, scored({}), "reference changed: 60 cases of tpr_all fewer in crossing (0, were 60)"),
        (SAME, changed(SAME, reference="x" * 64), "reference changed: digest xxxxxxxxxxxx, was "),
        (SAME, one([1.0] * 6, cases=8), "reference changed: 12 cases of tpr_all fewer in crossing (48, were 60)"),
    ],
    "failures": [(SAME, replace(SAME, failures=FAILURES), f"the run has 2 failures: {FAILURES[0]}; {FAILURES[1]}")],
}


@pytest.mark.parametrize(
    ("name", "before", "after", "told"), [(name, *row) for name, rows in NOT_ALIKE.items() for row in rows]
)
def test_what_was_not_measured_alike_fails_whatever_the_score(name, before, after, told):
    found, verdict = check(before, after, name)
    assert found.outcome is Outcome.FAILED
    assert told in found.message
    assert not verdict.passed


def test_a_metric_over_other_cases_fails_by_no_score_of_its_own():
    assert verdict_of(SAME, one([1.0] * 6, cases=8)).rows[0].outcome is Outcome.IMPROVED
    detected = one([0.5] * 6, metric="tpr"), one([0.5] * 6, metric="tpr", cases=8)
    assert verdict_of(*detected, ALL_DECIDE).passed, "over detections"


SOME = (
    "recordings changed: 'drive-4' (1 of 6); recordings new: 'later' (1 of 7); recordings missing: 'gone' (1 of 7); "
    "digest "
)
ALL = "recordings changed: 'drive-0', 'drive-1', 'drive-2', 'drive-3' and 2 more (6 of 6); digest"


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        (DRIVES | {"gone": "1" * 16}, DRIVES | {"drive-4": "2" * 16, "later": "3" * 16}, SOME),
        (DRIVES, dict.fromkeys(DRIVES, "4" * 16), ALL),
    ],
)
def test_other_data_fail_with_their_recordings_unless_the_rules_say_report(before, after, told):
    runs = changed(SAME, recordings=before), changed(SAME, recordings=after)
    found, verdict = check(*runs, "data")
    assert (found.outcome, verdict.passed) == (Outcome.FAILED, False)
    assert found.message.startswith(f"data changed: other images, sweeps, labels, calibration or ego-motion; {told}")
    assert [*verdict.changes] == ["data"]
    assert verdict.changes["data"].startswith(told)
    found, verdict = check(*runs, "data", RENDERED)
    assert (found.outcome, verdict.passed) == (Outcome.SUSPECT, True)


def test_changed_settings_are_told_by_their_dotted_names_and_fail_nothing():
    settings = {"weights": {"epipolar": 0.5}, "threshold": 6e-4}
    verdict = verdict_of(SAME, changed(SAME, method=method_of_run("spherical", settings=settings)))
    assert verdict.changes == {"settings": "weights.epipolar = 0.5, was 1.0"}
    assert verdict.passed


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"name": "other"}, "data set 'demo', the run of 'other': they do not compare"),
        ({"split": "night"}, "split none, the run of 'night': they do not compare"),
        (
            {"protocol": ProtocolOfRun(name="paper-v1", version=1, digest="e" * 64)},
            r"protocol paper-v1 version 1 \(075012207d4a\), the run of paper-v1 version 1 \(eeeeeeeeeeee\): they",
        ),
    ],
)
def test_another_data_set_split_or_protocol_is_refused(changes, told):
    with pytest.raises(UsageError, match=f"the baseline is of {told}.*or replace it with --update"):
        verdict_of(SAME, changed(SAME, **changes))


def rendered_elsewhere(pixels=0.0, rebinned=0.0, static=0.0):
    """Baseline and run of other data and another reference: in the first of six recordings that much is otherwise."""

    def made(pixels, rebinned, static, **changes):
        drives = sums([0.5] * 6, cases=50)
        slices = {
            "frames": {"recall": {**sums([0.5] * 6, cases=20_000), "drive-0": (10_000.0, 20_000.0 + pixels)}},
            "all_moving": {"tracks": drives, "tpr_all": drives},
            "range_m=[2, 4)": {"tracks": {**drives, "drive-0": (20.0, 50.0 - rebinned)}},
            "range_m=[4, 6)": {"tracks": {**drives, "drive-0": (20.0, 50.0 + rebinned)}},
            "status=static": {"annotated": {"drive-0": (20.0 + static, 20.0 + static)}},
        }
        return scored(slices, **changes)

    return made(0, 0, 0), made(pixels, rebinned, static, data="x" * 64, reference="x" * 64)


def test_a_reference_that_differs_by_what_a_processor_tips_is_noted():
    found, verdict = check(*rendered_elsewhere(20, 3), "reference", RENDERED)
    assert (found.outcome, verdict.passed) == (Outcome.SUSPECT, True)
    told = "differ in 1 of 6 recordings, by at most 0.1 %, and 3 of 300 object-frames lie in another bin; the metrics"
    assert told in found.message
    assert any(told in line for line in change_lines(verdict))


@pytest.mark.parametrize("changes", [{"pixels": 21}, {"pixels": -21}, {"rebinned": 4}, {"static": 1}])
def test_a_reference_that_differs_by_more_fails(changes):
    found, verdict = check(*rendered_elsewhere(**changes), "reference", RENDERED)
    assert (found.outcome, verdict.passed) == (Outcome.FAILED, False)
    assert found.message.startswith("reference changed: ")


def test_no_difference_of_the_reference_is_small_where_the_data_are_the_same_or_stay():
    before, after = rendered_elsewhere(1)
    same_data = changed(after, recordings=before.manifest.dataset.recordings)
    assert check(before, same_data, "reference", RENDERED)[0].outcome is Outcome.FAILED
    assert check(before, after, "reference")[0].outcome is Outcome.FAILED


def own(digest):
    return {"method": method_of_run("own", code_digest=digest)}


@pytest.mark.parametrize(
    ("before", "after", "code"),
    [
        ({}, {}, ""),
        (
            {"commit": "c0ffee+"},
            {},
            ", with the benchmark of commit c0ffee with changed files",
        ),
        (
            {"commit": None},
            {},
            ", with the benchmark of version 0 of an unknown commit",
        ),
        (own("1"), own("2"), ", with the code that 'own' had then"),
    ],
)
def test_how_to_look_at_a_change_is_told(before, after, code):
    told = how_to_compare(scored({}, **before).manifest, scored({}, **after).manifest, folder=Path("run"))
    assert told[0] == f"to compare image by image, repeat the baseline's run{code}:"
    assert [line.split()[1] for line in told[1:]] == ["run", "compare"]
    assert told[1].endswith("--out reports/runs/baseline --no-pictures --overwrite"), "as often as it is asked for"
    other_data = changed(SAME, data="x" * 64).manifest
    assert how_to_compare(SAME.manifest, other_data, folder=Path("run")) == ()
