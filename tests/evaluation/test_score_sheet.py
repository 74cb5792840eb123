"""The sums behind the figures, and what changed between two runs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.evaluation import MetricSums, PairedChange, ScoreSheet, holm, paired_change, score_sheet, summarise
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


def sheet_of(seed: int, **options: int) -> ScoreSheet:
    return score_sheet(*random_run(seed, **options), protocol=PAPER)


def sums(by_recording: dict[str, tuple[float, float]]) -> MetricSums:
    return MetricSums(
        numerators={name: float(n) for name, (n, _) in by_recording.items()},
        denominators={name: float(d) for name, (_, d) in by_recording.items()},
    )


def change(before: MetricSums, after: MetricSums, *, seed: int = 0) -> PairedChange:
    return paired_change(before, after, draws=2000, seed=seed)


def expected_figures(summary: Summary) -> dict[tuple[str, str], tuple[float, int]]:
    """Slice and metric -> value and cases, as the summary has them."""
    rows = summary.categories | {"all_moving": summary.all_moving}
    rows |= {f"{split}={name}": row for split, named in summary.breakdowns.items() for name, row in named.items()}
    found = {(name, metric): row.figure(metric) for name, row in rows.items() for metric in OBJECT_METRICS}
    false = {"frames": summary.false_positives}
    for split, named in summary.false_positive_breakdowns.items():
        false |= {f"{split}={name}": row for name, row in named.items()}
    found |= {(name, m): getattr(row, short) for name, row in false.items() for m, short in FALSE_POSITIVES.items()}
    found |= {("frames", metric): getattr(summary.segmentation, short) for metric, short in SEGMENTATION.items()}
    return {key: (figure.value, figure.cases) for key, figure in found.items()}


@pytest.mark.parametrize("seed", [1, 2])
def test_every_figure_of_the_summary_that_the_sheet_has_is_the_same(seed: int) -> None:
    run = random_run(seed)
    sheet, expected = score_sheet(*run, protocol=PAPER), expected_figures(summarise(*run, protocol=PAPER))
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
    sheet = score_sheet(*tables, protocol=PAPER)
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
    text = sheet_of(3).model_dump_json()
    assert ScoreSheet.model_validate_json(text) == sheet_of(3)
    assert "NaN" not in text
    assert "null" not in text


@few
@given(st.integers(0, 1000))
def test_the_order_of_the_rows_changes_no_byte(seed: int) -> None:
    objects, images = random_run(seed % 5)
    turned = score_sheet(shuffled(objects, seed), shuffled(images, seed + 1), protocol=PAPER)
    assert turned.model_dump_json() == score_sheet(objects, images, protocol=PAPER).model_dump_json()


def test_a_run_of_nothing_has_slices_without_cases() -> None:
    sheet = score_sheet(*scored([]), protocol=PAPER)
    assert sheet.slices["crossing"]["iou"] == sums({})
    assert sheet.counts["all_moving"]["annotated"] == 0


def test_identical_runs_do_not_differ() -> None:
    sheet = sheet_of(4)
    for metric, found in sheet.slices["all_moving"].items():
        same = change(found, found)
        assert (same.difference, same.ci95, same.p_value) == (0.0, (0.0, 0.0), 1.0), metric


def test_a_shift_of_every_recording_is_seen() -> None:
    names = [f"drive-{k}" for k in range(8)]
    before = sums({name: (4 + k % 3, 10) for k, name in enumerate(names)})
    after = sums({name: (6 + k % 3, 10) for k, name in enumerate(names)})
    found = change(before, after)
    assert found.difference == pytest.approx(0.2)
    assert found.ci95 == (pytest.approx(0.2), pytest.approx(0.2))
    assert found.p_value == 2 / 2001
    assert (found.cases_before, found.cases_after, found.recordings) == (80, 80, 8)
    back = change(after, before)
    assert (back.difference, back.p_value) == (-found.difference, found.p_value)


def test_hard_and_easy_recordings_cancel_in_pairs() -> None:
    """Rates from 0.1 to 0.9, each a little better after: hidden by single intervals, plain in pairs."""
    before = sums({f"drive-{k}": (10 * k, 100) for k in range(1, 10)})
    after = sums({f"drive-{k}": (10 * k + 2 + k % 2, 100) for k in range(1, 10)})
    found = change(before, after)
    assert found.ci95 is not None
    assert 0.02 <= found.ci95[0] <= found.ci95[1] <= 0.03


def test_one_recording_gives_a_difference_and_no_verdict() -> None:
    found = change(sums({"a": (1, 4)}), sums({"a": (3, 4)}))
    assert found == PairedChange(
        before=0.25, after=0.75, difference=0.5, ci95=None, p_value=None, cases_before=4, cases_after=4, recordings=1
    )


def test_cases_in_one_run_only_give_no_interval() -> None:
    both = sums({"a": (1, 4), "b": (2, 4)})
    found = change(both, sums({"a": (3, 4)}))
    assert (found.ci95, found.p_value, found.recordings) == (None, None, 2)
    empty = change(both, sums({}))
    assert math.isnan(empty.after)
    assert math.isnan(empty.difference)
    assert (empty.ci95, empty.cases_after) == (None, 0)


def test_draws_that_leave_one_run_without_cases_are_left_out() -> None:
    found = change(sums({"a": (1, 2), "b": (1, 2)}), sums({"c": (2, 2), "d": (2, 2)}))
    assert found.ci95 == (0.5, 0.5)
    assert found.recordings == 4


@few
@given(st.integers(0, 100), st.randoms(use_true_random=False))
def test_a_change_does_not_depend_on_the_order_of_recordings(seed: int, random: object) -> None:
    before, after = (sheet_of(s, recordings=5).slices["all_moving"]["iou"] for s in (seed % 5, seed % 5 + 1))
    names = list(before.denominators)
    random.shuffle(names)  # type: ignore[attr-defined]
    turned = sums({name: (before.numerators[name], before.denominators[name]) for name in names})
    assert change(turned, after, seed=seed) == change(before, after, seed=seed)


def test_the_same_seed_gives_the_same_verdict_and_another_a_close_one() -> None:
    before, after = (sheet_of(seed, recordings=12).slices["all_moving"]["tpr_all"] for seed in (1, 2))
    assert change(before, after, seed=3) == change(before, after, seed=3)
    one, other = change(before, after, seed=3), change(before, after, seed=4)
    assert one != other
    assert one.ci95 == pytest.approx(other.ci95, abs=0.02)
    assert one.p_value == pytest.approx(other.p_value, abs=0.06)


def test_runs_that_differ_by_chance_alone_are_rejected_in_about_one_case_of_twenty() -> None:
    """300 pairs of runs over 40 drives; which run is "before" is a coin toss in each drive."""
    draw, rejected = np.random.default_rng(5), 0
    for seed in range(300):
        rate = draw.beta(3, 2, size=40)
        counts = draw.binomial(50, rate, size=(2, 40))
        swapped = draw.random(40) < 0.5
        one, other = np.where(swapped, counts[::-1], counts)
        runs = [sums({f"drive-{k:02}": (c, 50) for k, c in enumerate(run)}) for run in (one, other)]
        found = paired_change(runs[0], runs[1], draws=500, seed=seed)
        assert found.p_value is not None
        rejected += found.p_value < 0.05
    assert 0.02 <= rejected / 300 <= 0.10


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
