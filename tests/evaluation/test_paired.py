"""The sums behind the figures, and what changed between two runs."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.evaluation import MetricSums, PairedChange, RecordingSums, holm, paired_change, recording_sums, summarise
from bench.evaluation.intervals import MEAN_CHANGE
from bench.evaluation.summary import Summary
from tests.evaluation.frames import ignored_object, mask, picture, reference_frame, reference_object, static_object
from tests.evaluation.runs import PAPER, joined, random_run, scored, shuffled

few = settings(max_examples=8, deadline=None)

# Names in the summary of what the sheet calls otherwise.
FALSE_POSITIVES = {
    "false_positive_coverage": "coverage",
    "false_positive_coverage_valid": "coverage_valid",
    "false_positive_frame_rate": "frame_rate",
    "false_positive_components": "components_per_frame",
}
SEGMENTATION = {"segmentation_iou": "iou", "precision": "precision", "recall": "recall"}
OBJECT_METRICS = {
    *("detection_rate", "detection_rate_10", "detection_rate_50"),
    *("tpr", "tpr_all", "iou", "iou_detected"),
}


def recording_sums_of(seed: int, **options: int) -> RecordingSums:
    return recording_sums(*random_run(seed, **options), protocol=PAPER)


def sums(by_recording: dict[str, tuple[float, float]]) -> MetricSums:
    return MetricSums(
        numerators={name: float(n) for name, (n, _) in by_recording.items()},
        denominators={name: float(d) for name, (_, d) in by_recording.items()},
    )


def expected_figures(summary: Summary) -> dict[tuple[str, str], tuple[float, int]]:
    """Slice and metric -> value and cases, as the summary has them."""
    rows = summary.categories | {"all_moving": summary.all_moving}
    rows |= {f"{split}={name}": row for split, named in summary.breakdowns.items() for name, row in named.items()}
    found = {(name, metric): row.metric(metric) for name, row in rows.items() for metric in OBJECT_METRICS}
    false = {"frames": summary.false_positives}
    for split, named in summary.false_positive_breakdowns.items():
        false |= {f"{split}={name}": row for name, row in named.items()}
    found |= {(name, m): getattr(row, short) for name, row in false.items() for m, short in FALSE_POSITIVES.items()}
    found |= {("frames", metric): getattr(summary.segmentation, short) for metric, short in SEGMENTATION.items()}
    return {key: (figure.value, figure.cases) for key, figure in found.items()}


@pytest.mark.parametrize("seed", [1, 2])
def test_every_figure_of_the_summary_that_the_sheet_has_is_the_same(seed: int) -> None:
    run = random_run(seed)
    sheet, expected = recording_sums(*run, protocol=PAPER), expected_figures(summarise(*run, protocol=PAPER))
    for (name, metric), (value, cases) in expected.items():
        found = sheet.slices[name][metric]
        assert (found.value, found.cases) == (pytest.approx(value, nan_ok=True), cases), (name, metric)
    # Only the pixel figures of a breakdown's images are not in the summary.
    extra = {(s, m) for s, metrics in sheet.slices.items() for m in metrics} - expected.keys()
    assert {metric for _, metric in extra} == set(SEGMENTATION)


def test_sums_and_counts_to_check_by_hand() -> None:
    objects = [reference_object("a"), static_object("s"), ignored_object("i")]
    one = reference_frame(picture("11..\n11.."), objects=objects, recording="one")
    two = reference_frame(picture("1111"), recording="two")
    tables = joined([scored([(one, mask(".x..\n.x.x"))]), scored([(two, mask("...."))])])
    sheet = recording_sums(*tables, protocol=PAPER)
    crossing = sheet.slices["crossing"]
    assert crossing["detection_rate"] == sums({"one": (1, 1), "two": (0, 1)})
    assert crossing["tpr"] == sums({"one": (0.5, 1)})
    assert crossing["tpr_all"] == sums({"one": (0.5, 1), "two": (0, 1)})
    assert sheet.slices["frames"]["false_positive_coverage"] == sums({"one": (1 / 8, 1), "two": (0, 1)})
    assert sheet.slices["frames"]["segmentation_iou"] == sums({"one": (2, 5), "two": (0, 4)})
    assert sheet.slices["overtaking"]["iou"] == sums({})
    assert math.isnan(sheet.slices["overtaking"]["iou"].value)
    assert sheet.counts["all_moving"] == {
        "object_frames": 2,
        "tracks": 2,
        "recordings": 2,
        "annotated": 4,
        "static": 1,
        "ignored": 1,
    }
    assert sheet.counts["frames"] == {"frames": 2, "images": 2, "evaluated": 2, "failed": 0, "skipped": 0}
    assert sheet.counts["camera=front"]["frames"] == sheet.counts["camera=front"]["object_frames"] == 2


def test_a_sheet_survives_its_file_and_has_no_nan() -> None:
    text = recording_sums_of(3).model_dump_json()
    assert RecordingSums.model_validate_json(text) == recording_sums_of(3)
    assert "NaN" not in text
    assert "null" not in text


@few
@given(st.integers(0, 1000))
def test_the_order_of_the_rows_changes_no_byte(seed: int) -> None:
    objects, images = random_run(seed % 5)
    turned = recording_sums(shuffled(objects, seed), shuffled(images, seed + 1), protocol=PAPER)
    assert turned.model_dump_json() == recording_sums(objects, images, protocol=PAPER).model_dump_json()


def test_a_run_of_nothing_has_slices_without_cases() -> None:
    sheet = recording_sums(*scored([]), protocol=PAPER)
    assert sheet.slices["crossing"]["iou"] == sums({})
    assert sheet.counts["all_moving"]["annotated"] == 0


def test_identical_runs_do_not_differ() -> None:
    sheet = recording_sums_of(4, recordings=6)
    for metric, found in sheet.slices["all_moving"].items():
        same = paired_change(found, found)
        assert (same.difference, same.ci95, same.p_value) == (0.0, None, 1.0), metric


def test_a_shift_of_every_recording_is_seen() -> None:
    names = [f"drive-{k}" for k in range(8)]
    before = sums({name: (4 + k % 3, 10) for k, name in enumerate(names)})
    after = sums({name: (6 + k % 3, 10) for k, name in enumerate(names)})
    found = paired_change(before, after)
    assert found.difference == pytest.approx(0.2)
    # As of nine recordings with differences 0.2, eight times, and 0: Student's t of 8 degrees is 2.306.
    assert found.ci95 == pytest.approx((0.2 * (8 - 2.306) / 9, 0.2 * (8 + 2.306) / 9), abs=1e-4)
    assert found.p_value == 2 / 2**8
    assert (found.cases_before, found.cases_after, found.recordings) == (80, 80, 8)
    back = paired_change(after, before)
    assert (back.difference, back.p_value) == (-found.difference, found.p_value)


def test_everything_found_against_nothing_is_a_difference_from_six_recordings_on() -> None:
    names = [f"drive-{k}" for k in range(6)]
    nothing, everything = (sums(dict.fromkeys(names, (share, 10))) for share in (0, 10))
    found = paired_change(nothing, everything)
    assert found.ci95 == pytest.approx(((6 - 2.4469) / 7, 1.0), abs=1e-4)
    assert found.p_value == 2 / 2**6
    fewer = paired_change(*(sums(dict.fromkeys(names[:5], (s, 10))) for s in (0, 10)))
    assert (fewer.difference, fewer.ci95, fewer.p_value, fewer.recordings) == (1.0, None, None, 5)


def test_a_mean_without_an_upper_end_may_change_by_more_than_one() -> None:
    names = [f"drive-{k}" for k in range(6)]
    before, after = (sums({n: (10 * (k + shift), 10) for k, n in enumerate(names)}) for shift in (2, 5))
    same = paired_change(before, after, within=MEAN_CHANGE)
    assert (same.difference, same.p_value) == (3.0, 2 / 2**6)
    assert same.ci95 == pytest.approx((3 * (6 - 2.4469) / 7, 3 * (6 + 2.4469) / 7), abs=1e-4)
    odd = sums({n: (10 * (k + 5 + k % 2), 10) for k, n in enumerate(names)})
    found = paired_change(before, odd, within=MEAN_CHANGE)
    # Differences 3 and 4, three times each: standard error sqrt(0.3 / 6), Student's t of 5 degrees 2.5706.
    assert found.ci95 == pytest.approx((3.5 - 2.5706 * 0.05**0.5, 3.5 + 2.5706 * 0.05**0.5), abs=1e-4)


def test_hard_and_easy_recordings_cancel_in_pairs() -> None:
    """Rates from 0.1 to 0.9, each a little better after: hidden by single intervals, plain in pairs."""
    before = sums({f"drive-{k}": (10 * k, 100) for k in range(1, 10)})
    after = sums({f"drive-{k}": (10 * k + 2 + k % 2, 100) for k in range(1, 10)})
    found = paired_change(before, after)
    assert found.ci95 is not None
    assert 0.02 <= found.ci95[0] < found.difference < found.ci95[1] <= 0.03


def test_one_recording_gives_a_difference_and_no_verdict() -> None:
    found = paired_change(sums({"a": (1, 4)}), sums({"a": (3, 4)}))
    assert found == PairedChange(
        before=0.25, after=0.75, difference=0.5, ci95=None, p_value=None, cases_before=4, cases_after=4, recordings=1
    )


def test_cases_in_one_run_only_give_no_interval() -> None:
    both = sums({f"drive-{k}": (k, 8) for k in range(6)})
    found = paired_change(both, sums({"drive-0": (3, 4)}))
    assert (found.ci95, found.p_value, found.recordings) == (None, None, 1)
    empty = paired_change(both, sums({}))
    assert math.isnan(empty.after)
    assert math.isnan(empty.difference)
    assert (empty.ci95, empty.cases_after) == (None, 0)


def test_recordings_with_cases_of_one_run_count_in_the_change_and_not_as_recordings_of_both() -> None:
    shared = {f"drive-{k}": (k % 3, 4) for k in range(6)}
    found = paired_change(sums(shared), sums(shared | {"other": (0, 40)}))
    assert found.recordings == 6
    assert found.difference < 0
    assert found.ci95 is not None
    assert found.ci95[0] < found.difference < found.ci95[1]


@few
@given(st.integers(0, 100), st.randoms(use_true_random=False))
def test_a_change_does_not_depend_on_the_order_of_recordings(seed: int, random: object) -> None:
    before, after = (recording_sums_of(s, recordings=7).slices["all_moving"]["iou"] for s in (seed % 5, seed % 5 + 1))
    names = list(before.denominators)
    random.shuffle(names)  # type: ignore[attr-defined]
    turned = sums({name: (before.numerators[name], before.denominators[name]) for name in names})
    assert paired_change(turned, after) == paired_change(before, after)


def test_holm_by_a_textbook_example() -> None:
    # Four tests, p = 0.01, 0.04, 0.03, 0.005: times 4, 3, 2, 1 in ascending order, never falling.
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


def test_holm_counts_only_tests_and_stays_below_one() -> None:
    assert holm([None, 0.04, None]) == [None, 0.04, None]
    assert holm([0.7, 0.6]) == [1.0, 1.0]
    assert holm([]) == []


@given(st.lists(st.floats(0, 1), max_size=8))
def test_holm_never_lowers_and_keeps_the_order(p_values: list[float]) -> None:
    corrected = holm(p_values)
    assert all(c is not None and p <= c <= 1 for p, c in zip(p_values, corrected, strict=True))
    order = sorted(range(len(p_values)), key=p_values.__getitem__)
    assert [corrected[k] for k in order] == sorted(c for c in corrected if c is not None)
