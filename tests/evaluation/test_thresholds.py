"""Histograms of a likelihood: the curve over all thresholds, and what needs no threshold, against counting by pixel."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from bench.evaluation.counts import BINS, EDGES, PAPER_THRESHOLD, SCORE_EDGES, find_bins
from bench.evaluation.rows import to_frame
from bench.evaluation.scorer import SequenceScorer
from bench.evaluation.thresholds import ThresholdFreeMetrics, ThresholdSweep, threshold_free_metrics, threshold_sweep
from bench.records.segmentation import Segmentation
from tests.evaluation.frames import mask, picture, reference_frame
from tests.evaluation.runs import PAPER, random_run, scored, shuffled, summary_of

AT_PAPER = int(np.flatnonzero(EDGES == PAPER_THRESHOLD)[0])
HALF = 0.5
Values = NDArray[np.float64]


def frames_of(*images: tuple[str, object], cell: int = 1, is_score: bool = False, recording: str = "drive") -> pa.Table:
    """The frames table of drawings and likelihoods; the mask is what lies above the usual threshold."""
    scorer = SequenceScorer(PAPER)
    for number, (drawing, values) in enumerate(images):
        likelihood = np.array(values, dtype=np.float32)
        moving = likelihood > (HALF if is_score else PAPER_THRESHOLD)
        told = Segmentation(cell_size_px=cell, mask=moving, likelihood=likelihood, likelihood_is_score=is_score)
        scorer.add(reference_frame(picture(drawing), timestamp_ns=number, recording=recording), told)
    return scorer.finish()[1]


def scores_of(*images: tuple[str, Values], recording: str = "drive-1") -> pa.Table:
    return frames_of(*images, is_score=True, recording=recording)


def sweep_of(*images: tuple[str, object]) -> ThresholdSweep:
    return sweep_over(frames_of(*images))


def sweep_over(frames: pa.Table) -> ThresholdSweep:
    sweep = threshold_sweep([to_frame(frames)])
    assert sweep is not None
    return sweep


def test_edges_are_log_spaced_from_zero_to_infinity_over_the_papers_threshold() -> None:
    assert (EDGES[0], EDGES[-1], len(EDGES)) == (0.0, np.inf, BINS + 1)
    assert PAPER_THRESHOLD in EDGES
    assert EDGES[-2] > math.pi
    assert np.allclose(np.diff(np.log10(EDGES[1:-1])), 0.05)


@pytest.mark.parametrize(("edges", "most"), [(EDGES, 1e6), (SCORE_EDGES, 1)], ids=["likelihood", "score"])
@given(data=st.data())
def test_a_likelihood_and_a_score_lie_in_their_bins(
    edges: NDArray[np.float64], most: float, data: st.DataObject
) -> None:
    values = data.draw(st.lists(st.floats(0, most, width=32), min_size=1, max_size=20))
    bins = find_bins(np.array(values, dtype=np.float32), edges)
    for value, k in zip(values, bins.tolist(), strict=True):
        assert edges[k] < value <= edges[k + 1] or (k == 0 and value == 0)


def test_what_is_no_likelihood_is_above_no_threshold() -> None:
    values = np.array([np.nan, -1.0, 0.0, np.inf], dtype=np.float32)
    assert find_bins(values).tolist() == [0, 0, 0, BINS - 1]


def test_a_curve_to_check_by_hand() -> None:
    # G: one pixel at 1e-3 and one at 1e-5; outside: one at 1e-4, five at 0.
    sweep = sweep_of(("11..\n....", [[1e-3, 1e-5, 1e-4, 0], [0, 0, 0, 0]]))
    above = {t: int(np.flatnonzero(t < EDGES)[0]) for t in (1e-6, 2e-5, 2e-4, 2e-3)}
    points = [(sweep.recall[k], sweep.false_positive_coverage[k]) for k in above.values()]
    assert points == [(1.0, 1 / 8), (0.5, 1 / 8), (0.5, 0.0), (0.0, 0.0)]
    assert (sweep.recall[0], sweep.false_positive_coverage[0]) == (1.0, 6 / 8)


def test_the_curve_passes_through_the_operating_point_of_the_run() -> None:
    draw = np.random.default_rng(1)
    drawings = ["11..\n11..\n....\n2...", "....\n.111\n.111\n...."]
    values = [(10 ** draw.uniform(-5, -2, (4, 4))).tolist() for _ in drawings]
    frames = frames_of(*zip(drawings, values, strict=True))
    rows, sweep = frames.to_pylist(), sweep_over(frames)
    tp, fp, fn = (sum(row[name] for row in rows) for name in ("tp_px", "fp_px", "fn_px"))
    assert tp > 0
    assert fp > 0
    assert sweep.recall[AT_PAPER] == tp / (tp + fn)
    assert sweep.false_positive_coverage[AT_PAPER] == pytest.approx(np.mean([row["fp_px"] / 16 for row in rows]))


def test_cells_weigh_as_many_pixels_as_they_have_in_each_region() -> None:
    # Cells of 2 px over 3 x 5 pixels; the last column and row are cut by the border.
    frames = frames_of(("11...\n1....\n.....", [[1.0, 1e-4, 0.5], [0, 0, 1e-5]]), cell=2)
    (row,) = frames.to_pylist()
    reference, outside = (np.array(row[f"likelihood_{name}_px"]) for name in ("reference", "outside"))
    bins = find_bins(np.array([1.0, 1e-4, 0.5, 1e-5, 0.0], dtype=np.float32))
    assert reference[bins].tolist() == [3, 0, 0, 0, 0]
    assert outside[bins].tolist() == [1, 4, 2, 1, 4]
    assert reference.sum() + outside.sum() == row["valid_px"] == 15


def test_ignored_and_invalid_pixels_are_in_neither_histogram() -> None:
    scorer = SequenceScorer(PAPER)
    frame = reference_frame(picture("1..."), ignored=mask(".x.."), valid=mask("xxx."))
    scorer.add(frame, Segmentation(cell_size_px=1, mask=mask("xxxx"), likelihood=np.ones((1, 4), dtype=np.float32)))
    (row,) = scorer.finish()[1].to_pylist()
    assert (sum(row["likelihood_reference_px"]), sum(row["likelihood_outside_px"])) == (1, 1)


def test_images_of_different_sizes_count_alike_in_coverage() -> None:
    small, large = frames_of(("..", [[1, 0]])), frames_of((".....\n.....", [[1] * 5, [0] * 5]), recording="left")
    frames = pa.concat_tables([small, large])
    sweep = sweep_over(frames)
    assert sweep.false_positive_coverage[AT_PAPER] == 0.5
    summary = summary_of((scored([])[0], frames))
    assert summary.false_positives.coverage.value == 0.5


def test_a_method_without_likelihood_has_nulls_and_no_curve() -> None:
    _, frames = scored([(reference_frame(picture("1.")), mask("x."))])
    assert frames["likelihood_reference_px"].null_count == frames["likelihood_outside_px"].null_count == 1
    assert threshold_sweep([to_frame(frames)]) is None
    assert threshold_free_metrics([to_frame(frames)]) is None
    assert threshold_sweep([to_frame(random_run(1)[1])]) is None


# ---- without a threshold


def free_of(frames: pa.Table) -> ThresholdFreeMetrics:
    found = threshold_free_metrics([to_frame(frames)])
    assert found is not None
    return found


def exactly(positive: Values, negative: Values) -> tuple[float, float]:
    """Both figures from all scores, one threshold at a time."""
    precision, recall, rate = [], [0.0], []
    for threshold in np.unique(np.concatenate([positive, negative]))[::-1]:
        tp, fp = np.count_nonzero(positive >= threshold), np.count_nonzero(negative >= threshold)
        precision.append(tp / (tp + fp))
        recall.append(tp / len(positive))
        rate.append(fp / len(negative))
    enough = next(k for k, r in enumerate(recall[1:]) if r >= 0.95)
    return float(np.sum(np.array(precision) * np.diff(recall))), rate[enough]


def test_score_edges_lie_evenly_over_the_odds_around_one_half() -> None:
    assert (SCORE_EDGES[0], SCORE_EDGES[-1], len(SCORE_EDGES)) == (0.0, np.inf, BINS + 1)
    inner = SCORE_EDGES[1:-1]
    assert HALF in inner
    assert np.allclose(np.diff(np.log10(inner / (1 - inner))), 0.05)
    assert np.allclose(inner, 1 - inner[::-1])


def test_figures_to_check_by_hand() -> None:
    # G: 0.9 and 0.4; outside: 0.7, five at 0.1. Half the recall at precision 1, half at 2/3; 95 % recall needs both.
    found = free_of(scores_of(("11..\n....", np.array([[0.9, 0.4, 0.7, 0.1], [0.1] * 4]))))
    assert found.auprc.value == pytest.approx(0.5 + 0.5 * 2 / 3)
    assert found.fpr95.value == pytest.approx(1 / 6)
    assert (found.auprc.cases, found.fpr95.cases, found.images) == (2, 6, 1)
    assert found.auprc.ci95 is None


@given(st.integers(0, 10_000), st.booleans())
def test_where_each_value_has_a_bin_the_figures_are_those_of_all_thresholds(seed: int, is_score: bool) -> None:
    draw, edges = np.random.default_rng(seed), SCORE_EDGES if is_score else EDGES
    middles = np.sqrt(edges[1:-2] * edges[2:-1]).astype(np.float32)
    moving = np.zeros((4, 16), dtype=bool)
    moving[:2, :8] = True
    values = middles[draw.integers(0, len(middles) // 2, (4, 16)) + moving * draw.integers(0, len(middles) // 2)]
    drawing = f"{'1' * 8 + '.' * 8}\n" * 2 + f"{'.' * 16}\n{'.' * 16}"
    found = free_of(frames_of((drawing, values), is_score=is_score))
    expected = exactly(values[moving].astype(np.float64), values[~moving].astype(np.float64))
    assert (found.auprc.value, found.fpr95.value) == pytest.approx(expected)


def test_intervals_are_by_recording_and_the_order_of_rows_does_not_matter() -> None:
    draw = np.random.default_rng(7)
    tables = []
    for r in range(6):
        images = [("11..\n1...", np.clip(draw.random((2, 4)) + [[0.13 * r] * 2 + [0] * 2] * 2, 0, 1)) for _ in range(5)]
        tables.append(scores_of(*images, recording=f"drive-{r}"))
    frames = pa.concat_tables(tables)
    found = free_of(frames)
    for figure in (found.auprc, found.fpr95):
        assert figure.ci95 is not None
        assert figure.ci95[0] < figure.value < figure.ci95[1]
    assert found.auprc.recordings == found.fpr95.recordings == 6
    assert free_of(shuffled(frames, 3)) == found
    five = free_of(pa.concat_tables(tables[:5])).auprc
    assert (five.ci95, five.recordings) == (None, 5)
    six_times_the_same = pa.concat_tables([tables[1].set_column(0, "recording", t["recording"]) for t in tables])
    same, unseen = free_of(six_times_the_same).auprc, 1 - 0.05 ** (1 / 6)
    assert same.ci95 == pytest.approx((same.value * (1 - unseen), same.value + unseen * (1 - same.value)))


def test_without_objects_or_without_negatives_there_is_no_figure() -> None:
    assert np.isnan(sweep_of(("..", [[1, 0]])).recall).all()
    nothing = free_of(scores_of(("....", np.full((1, 4), 0.3))))
    assert math.isnan(nothing.auprc.value)
    assert math.isnan(nothing.fpr95.value)
    everything = free_of(scores_of(("1111", np.full((1, 4), 0.3))))
    assert everything.auprc.value == 1.0
    assert math.isnan(everything.fpr95.value)
    for found in (nothing, everything):
        again = ThresholdFreeMetrics.model_validate_json(found.model_dump_json())
        assert again.model_dump_json() == found.model_dump_json()
