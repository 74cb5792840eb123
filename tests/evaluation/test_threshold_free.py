"""Area under precision over recall, and the false-positive rate at 95 % recall, against counting pixel by pixel."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from bench.evaluation import SequenceScorer, ThresholdFreeMetrics, threshold_free_metrics, threshold_sweep
from bench.evaluation.counts import BINS, SCORE_EDGES
from bench.records.reference import ReferenceFrame
from bench.records.segmentation import Segmentation
from tests.evaluation.frames import picture, reference_frame
from tests.evaluation.runs import PAPER, shuffled

HALF = 0.5
Values = NDArray[np.float64]


def frames_of(*images: tuple[str, Values], is_score: bool = True, recording: str = "drive-1") -> pa.Table:
    scorer = SequenceScorer(PAPER)
    for number, (drawing, values) in enumerate(images):
        likelihood = np.asarray(values, dtype=np.float32)
        frame = reference_frame(picture(drawing), timestamp_ns=number)
        assert isinstance(frame, ReferenceFrame)
        told = Segmentation(cell_size_px=1, mask=likelihood > HALF, likelihood=likelihood, likelihood_is_score=is_score)
        scorer.add(frame, told)
    table = scorer.finish()[1]
    return table.set_column(0, "recording", pa.array([recording] * len(table)))


def summary_of(frames: pa.Table) -> ThresholdFreeMetrics:
    found = threshold_free_metrics(frames)
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
    found = summary_of(frames_of(("11..\n....", np.array([[0.9, 0.4, 0.7, 0.1], [0.1] * 4]))))
    assert found.auprc.value == pytest.approx(0.5 + 0.5 * 2 / 3)
    assert found.fpr95.value == pytest.approx(1 / 6)
    assert (found.auprc.cases, found.fpr95.cases, found.images) == (2, 6, 1)
    assert found.auprc_bounds == pytest.approx((found.auprc.value,) * 2)
    assert found.fpr95_bounds == pytest.approx((1 / 6,) * 2)
    assert found.auprc.ci95 is None


def test_bounds_of_a_single_bin_to_check_by_hand() -> None:
    # All eight in one bin. Least: six wrong ones first, then 1/7 and 2/8. Most: both right ones first.
    found = summary_of(frames_of(("11..\n....", np.full((2, 4), 0.3))))
    assert found.auprc.value == pytest.approx(2 / 8)
    assert found.auprc_bounds == pytest.approx((0.5 * (1 / 7 + 2 / 8), 1.0))
    assert found.fpr95_bounds == (0.0, 1.0)
    assert found.fpr95.value == 1.0


@given(st.integers(0, 10_000), st.floats(0.2, 6.0), st.booleans())
def test_the_exact_figures_lie_within_the_bounds(seed: int, spread: float, is_score: bool) -> None:
    draw = np.random.default_rng(seed)
    logits = draw.normal(0, spread, (4, 16))
    logits[:2, :8] += 1.5
    values = (1 / (1 + np.exp(-logits)) if is_score else 10 ** (logits - 4)).astype(np.float32)
    values[draw.random((4, 16)) < 0.2] = 0.0
    moving = np.zeros((4, 16), dtype=bool)
    moving[:2, :8] = True
    found = summary_of(frames_of((f"{'1' * 8 + '.' * 8}\n" * 2 + f"{'.' * 16}\n{'.' * 16}", values), is_score=is_score))
    auprc, fpr95 = exactly(values[moving].astype(np.float64), values[~moving].astype(np.float64))
    assert found.auprc_bounds[0] - 1e-12 <= auprc <= found.auprc_bounds[1] + 1e-12
    assert found.fpr95_bounds[0] <= fpr95 <= found.fpr95_bounds[1] == found.fpr95.value
    assert found.auprc_bounds[0] - 1e-12 <= found.auprc.value <= found.auprc_bounds[1] + 1e-12


def test_the_area_is_that_of_the_curve() -> None:
    draw = np.random.default_rng(5)
    frames = frames_of(*[("11..\n1...", draw.random((2, 4))) for _ in range(9)])
    sweep = threshold_sweep(frames)
    assert sweep is not None
    assert summary_of(frames).auprc.value == pytest.approx(sweep.auprc)


def test_intervals_are_by_recording_and_the_order_of_rows_does_not_matter() -> None:
    draw = np.random.default_rng(7)
    tables = []
    for r in range(6):
        images = [("11..\n1...", np.clip(draw.random((2, 4)) + [[0.13 * r] * 2 + [0] * 2] * 2, 0, 1)) for _ in range(5)]
        tables.append(frames_of(*images, recording=f"drive-{r}"))
    frames = pa.concat_tables(tables)
    found = summary_of(frames)
    for figure in (found.auprc, found.fpr95):
        assert figure.ci95 is not None
        assert figure.ci95[0] < figure.value < figure.ci95[1]
    assert found.auprc.recordings == found.fpr95.recordings == 6
    assert summary_of(shuffled(frames, 3)) == found
    five = summary_of(pa.concat_tables(tables[:5])).auprc
    assert (five.ci95, five.recordings) == (None, 5)
    six_times_the_same = pa.concat_tables([tables[1].set_column(0, "recording", t["recording"]) for t in tables])
    same, unseen = summary_of(six_times_the_same).auprc, 1 - 0.05 ** (1 / 6)
    assert same.ci95 == pytest.approx((same.value * (1 - unseen), same.value + unseen * (1 - same.value)))


def test_without_objects_or_without_negatives_there_is_no_figure() -> None:
    nothing = summary_of(frames_of(("....", np.full((1, 4), 0.3))))
    assert math.isnan(nothing.auprc.value)
    assert math.isnan(nothing.fpr95.value)
    everything = summary_of(frames_of(("1111", np.full((1, 4), 0.3))))
    assert everything.auprc.value == 1.0
    assert math.isnan(everything.fpr95.value)
    for found in (nothing, everything):
        again = ThresholdFreeMetrics.model_validate_json(found.model_dump_json())
        assert again.model_dump_json() == found.model_dump_json()
