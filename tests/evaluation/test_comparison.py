"""What changed between two runs: metrics from their tables of sums, object-frames from their rows."""

from __future__ import annotations

import math

import pandas as pd
import pyarrow as pa
import pytest

from bench.evaluation.comparison import (
    CHANGES,
    PairedChange,
    compare_sums,
    holm,
    improvements_by_recording,
    object_changes,
    pair_sums,
)
from bench.evaluation.sums import KEY, TERMS
from tests.evaluation.frames import ignored_object, mask, picture, reference_frame, reference_object, static_object
from tests.evaluation.runs import random_run, random_sums, scored, shuffled, summary_of
from tests.support.result_rows import evaluated

Sums = dict[str, tuple[float, float]]  # numerator and denominator by recording


def table(by_recording: Sums, *, metric: str = "tpr_all") -> pd.DataFrame:
    rows = [("category", "crossing", name, metric, float(n), float(d)) for name, (n, d) in by_recording.items()]
    return pd.DataFrame(rows, columns=[*KEY, *TERMS])


def change_of(before: Sums, after: Sums, *, metric: str = "tpr_all") -> PairedChange:
    """The change of one metric, a mean where it is false_positive_components."""
    compared = compare_sums(table(before, metric=metric), table(after, metric=metric))
    return PairedChange(**compared.loc["category", "crossing", metric][[*PairedChange.__slots__]])


def test_every_value_of_the_summaries_that_has_a_direction_is_compared() -> None:
    runs = random_run(1), random_run(2)
    compared = compare_sums(random_sums(1), random_sums(2))
    for side, run in zip(("before", "after"), runs, strict=True):
        summary = summary_of(run)
        for name, row in summary.categories.items():
            for metric in row.metric_names():
                assert (("category", name, metric) in compared.index) == ("chance" not in metric)
                if "chance" not in metric:
                    found, expected = compared.loc["category", name, metric], row.metric(metric)
                    assert found[side] == pytest.approx(expected.value, nan_ok=True, abs=1e-12)
                    assert found[f"cases_{side}"] == expected.cases
        found = compared.loc["frames", "frames", "false_positive_coverage"]
        assert found[side] == pytest.approx(summary.false_positives.coverage.value, abs=1e-12)
        assert compared.loc["frames", "frames", "f1"][side] == pytest.approx(summary.segmentation.f1.value, abs=1e-12)


def test_better_is_said_by_the_direction_of_the_metric() -> None:
    fewer, more = {"a": (1, 4)}, {"a": (3, 4)}
    for metric, gain in (("iou", 0.5), ("false_positive_coverage", -0.5)):
        found = compare_sums(table(fewer, metric=metric), table(more, metric=metric)).iloc[0]
        assert (found["difference"], found["improvement"]) == (0.5, gain)


def test_a_shift_of_every_recording_is_seen() -> None:
    names = [f"drive-{k}" for k in range(8)]
    before = {name: (4 + k % 3, 10) for k, name in enumerate(names)}
    after = {name: (6 + k % 3, 10) for k, name in enumerate(names)}
    found = change_of(before, after)
    assert found.difference == pytest.approx(0.2)
    # As of nine recordings with differences 0.2, eight times, and 0: Student's t of 8 degrees is 2.306.
    assert found.ci95 == pytest.approx((0.2 * (8 - 2.306) / 9, 0.2 * (8 + 2.306) / 9), abs=1e-4)
    assert found.p_value == 2 / 2**8
    assert (found.cases_before, found.cases_after, found.recordings) == (80, 80, 8)
    back = change_of(after, before)
    assert (back.difference, back.p_value) == (-found.difference, found.p_value)


def test_rounding_of_equal_sums_is_no_change() -> None:
    before, after = ({f"drive-{k}": (found, 1) for k in range(8)} for found in (0.1 + 0.2, 0.3))
    found = change_of(before, after)
    assert (found.difference, found.ci95, found.p_value) == (0.0, None, 1.0)


def test_everything_found_against_nothing_is_a_difference_from_six_recordings_on() -> None:
    names = [f"drive-{k}" for k in range(6)]
    nothing, everything = (dict.fromkeys(names, (share, 10)) for share in (0, 10))
    found = change_of(nothing, everything)
    assert found.ci95 == pytest.approx(((6 - 2.4469) / 7, 1.0), abs=1e-4)
    assert found.p_value == 2 / 2**6
    fewer = change_of(*(dict.fromkeys(names[:5], (s, 10)) for s in (0, 10)))
    assert (fewer.difference, fewer.ci95, fewer.p_value, fewer.recordings) == (1.0, None, None, 5)


def test_a_mean_without_an_upper_end_may_change_by_more_than_one() -> None:
    names = [f"drive-{k}" for k in range(6)]
    before, after = ({n: (10 * (k + shift), 10) for k, n in enumerate(names)} for shift in (2, 5))
    same = change_of(before, after, metric="false_positive_components")
    assert (same.difference, same.p_value) == (3.0, 2 / 2**6)
    assert same.ci95 == pytest.approx((3 * (6 - 2.4469) / 7, 3 * (6 + 2.4469) / 7), abs=1e-4)
    odd = {n: (10 * (k + 5 + k % 2), 10) for k, n in enumerate(names)}
    found = change_of(before, odd, metric="false_positive_components")
    # Differences 3 and 4, three times each: standard error sqrt(0.3 / 6), Student's t of 5 degrees 2.5706.
    assert found.ci95 == pytest.approx((3.5 - 2.5706 * 0.05**0.5, 3.5 + 2.5706 * 0.05**0.5), abs=1e-4)


def test_hard_and_easy_recordings_cancel_in_pairs() -> None:
    """Rates from 0.1 to 0.9, each a little better after: hidden by single intervals, plain in pairs."""
    before = {f"drive-{k}": (10 * k, 100) for k in range(1, 10)}
    after = {f"drive-{k}": (10 * k + 2 + k % 2, 100) for k in range(1, 10)}
    found = change_of(before, after)
    assert found.ci95 is not None
    assert 0.02 <= found.ci95[0] < found.difference < found.ci95[1] <= 0.03


def test_a_comparison_says_over_which_cases_and_images_a_metric_is() -> None:
    before, after = table({"a": (1, 4), "b": (2, 6)}), table({"a": (1, 6), "b": (2, 4)})
    precise = table({"a": (50, 100)}, metric="precision").assign(breakdown="frames", slice="frames")
    images = table({"a": (1, 3)}, metric="false_positive_coverage").assign(breakdown="frames", slice="frames")
    found = compare_sums(pd.concat([before, precise, images]), after)
    row = found.loc["category", "crossing", "tpr_all"]
    assert (row["cases_before"], row["cases_after"]) == (10, 10)
    gone = found.loc["frames", "frames", "precision"]
    assert (gone["cases_before"], gone["cases_after"], gone["frames_before"], gone["frames_after"]) == (100, 0, 3, 0)


def test_the_recordings_that_lost_most_come_first_by_their_cases() -> None:
    before = {"a": (4, 4), "b": (20, 20), "c": (5, 10), "d": (1, 1)}
    after = {"a": (0, 4), "b": (10, 20), "c": (6, 10)}
    found = improvements_by_recording(pair_sums(table(before), table(after)))
    assert found[["recording", "before", "after"]].to_numpy().tolist() == [["b", 1, 0.5], ["a", 1, 0], ["c", 0.5, 0.6]]
    assert found["improvement"].tolist() == pytest.approx([-10, -4, 1])


def test_cases_in_one_run_only_give_no_interval() -> None:
    both = {f"drive-{k}": (k, 8) for k in range(6)}
    found = change_of(both, {"drive-0": (3, 4)})
    assert (found.ci95, found.p_value, found.recordings) == (None, None, 1)
    empty = change_of(both, {})
    assert math.isnan(empty.after)
    assert math.isnan(empty.difference)
    assert (empty.ci95, empty.cases_after) == (None, 0)


def test_recordings_with_cases_of_one_run_count_in_the_change_and_not_as_recordings_of_both() -> None:
    shared = {f"drive-{k}": (k % 3, 4) for k in range(6)}
    found = change_of(shared, shared | {"other": (0, 40)})
    assert found.recordings == 6
    assert found.difference < 0
    assert found.ci95 is not None
    assert found.ci95[0] < found.difference < found.ci95[1]


def test_a_change_does_not_depend_on_the_order_of_the_rows() -> None:
    before, after = random_sums(1), random_sums(2)
    turned = [side.sample(frac=1, random_state=1) for side in (before, after)]
    pd.testing.assert_frame_equal(compare_sums(*turned), compare_sums(before, after))


@pytest.mark.parametrize(
    ("p_values", "corrected"),
    [
        # Four tests: times 4, 3, 2, 1 in ascending order, never falling.
        ([0.01, 0.04, 0.03, 0.005], [0.03, 0.06, 0.06, 0.02]),
        ([None, 0.04, None], [None, 0.04, None]),
        ([0.7, 0.6], [1.0, 1.0]),
    ],
)
def test_holm_by_hand(p_values: list[float | None], corrected: list[float | None]) -> None:
    assert holm(p_values) == [p if p is None else pytest.approx(p) for p in corrected]


# Object-frames gained and lost.


def changes(before: pa.Table, after: pa.Table) -> pd.DataFrame:
    return object_changes(evaluated(before), evaluated(after))


def test_every_kind_of_change() -> None:
    objects = [reference_object(name) for name in "dcba"]
    frame = reference_frame(picture("1234\n1234"), objects=[*objects, static_object("s")])
    before, _ = scored([(frame, mask("xx..\n...."))])
    after, _ = scored([(frame, mask("x.x.\nx..."))])
    table = changes(before, after)
    assert list(table.columns) == CHANGES
    rows = table.to_dict("records")
    assert [(r["track_id"], r["change"]) for r in rows] == [
        *[("a", "neither"), ("b", "gained"), ("c", "lost"), ("d", "both")]
    ]
    expected = {"object_class": "pedestrian", "category": "crossing", "range_m": 3.0, "region_px": 2}
    expected |= {"coverage_before": 0.5, "coverage_after": 1, "detected_before": True, "detected_after": True}
    # Before, one component of two pixels touches c and d; after, d alone.
    assert rows[-1].items() >= (expected | {"iou_before": 0.5, "iou_after": 1.0}).items()


def test_what_one_run_alone_evaluated_is_no_change() -> None:
    both = reference_frame(picture("12"), objects=[reference_object("a"), reference_object("b")])
    one = reference_frame(picture("1."), objects=[reference_object("a"), ignored_object("b")])
    tables = [scored([(frame, mask("xx"))])[0] for frame in (both, one)]
    for sides in (tables, tables[::-1]):
        assert changes(*sides)[["track_id", "change"]].to_numpy().tolist() == [["a", "both"]]


def test_changes_are_the_same_in_any_order() -> None:
    (before, _), (after, _) = random_run(1), random_run(2)
    pd.testing.assert_frame_equal(changes(shuffled(before, 3), shuffled(after, 4)), changes(before, after))
