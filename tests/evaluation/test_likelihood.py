"""The curve over all thresholds, from histograms."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from bench.errors import ShapeError
from bench.evaluation import SequenceScorer, summarise, threshold_free_metrics, threshold_sweep
from bench.evaluation.counts import BINS, EDGES, PAPER_THRESHOLD, SCORE_EDGES, find_bins
from bench.records.segmentation import Segmentation
from tests.evaluation.frames import mask, picture, reference_frame
from tests.evaluation.runs import PAPER, random_run, scored, shuffled

AT_PAPER = int(np.flatnonzero(EDGES == PAPER_THRESHOLD)[0])


def frames_of(*images: tuple[str, list[list[float]]], cell: int = 1, camera: str = "front") -> pa.Table:
    """The frames table of drawings and likelihoods; the mask is what lies above the paper's threshold."""
    scorer = SequenceScorer(PAPER)
    for number, (drawing, values) in enumerate(images):
        likelihood = np.array(values, dtype=np.float32)
        frame = reference_frame(picture(drawing), timestamp_ns=number, camera=camera)
        told = Segmentation(cell_size_px=cell, mask=likelihood > PAPER_THRESHOLD, likelihood=likelihood)
        scorer.add(frame, told)
    return scorer.finish()[1]


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


def test_edges_and_their_neighbours_lie_in_their_bins() -> None:
    edges = EDGES[1:-1].astype(np.float32)
    values = np.concatenate([np.nextafter(edges, np.float32(0)), edges, np.nextafter(edges, np.float32(9))])
    expected = np.searchsorted(EDGES[1:-1], values.astype(np.float64), side="left")
    assert np.array_equal(find_bins(values), expected)


def test_what_is_no_likelihood_is_above_no_threshold() -> None:
    values = np.array([np.nan, -1.0, 0.0, np.inf], dtype=np.float32)
    assert find_bins(values).tolist() == [0, 0, 0, BINS - 1]


def test_a_curve_to_check_by_hand() -> None:
    # G: one pixel at 1e-3 and one at 1e-5; outside: one at 1e-4, five at 0.
    sweep = threshold_sweep(frames_of(("11..\n....", [[1e-3, 1e-5, 1e-4, 0], [0, 0, 0, 0]])))
    assert sweep is not None
    above = {t: int(np.flatnonzero(t < EDGES)[0]) for t in (1e-6, 2e-5, 2e-4, 2e-3)}
    points = [(sweep.recall[k], sweep.precision[k], sweep.false_positive_coverage[k]) for k in above.values()]
    assert points[:3] == [(1.0, 2 / 3, 1 / 8), (0.5, 0.5, 1 / 8), (0.5, 1.0, 0.0)]
    assert points[3][0] == 0
    assert math.isnan(points[3][1])
    assert (sweep.thresholds[0], sweep.recall[0], sweep.precision[0]) == (0.0, 1.0, 2 / 8)
    # Half the recall at precision 1, half at 2/3.
    assert sweep.auprc == pytest.approx(0.5 + 0.5 * 2 / 3)


def test_the_curve_passes_through_the_operating_point_of_the_run() -> None:
    draw = np.random.default_rng(1)
    drawings = ["11..\n11..\n....\n2...", "....\n.111\n.111\n...."]
    values = [(10 ** draw.uniform(-5, -2, (4, 4))).tolist() for _ in drawings]
    frames = frames_of(*zip(drawings, values, strict=True))
    rows, sweep = frames.to_pylist(), threshold_sweep(frames)
    assert sweep is not None
    tp, fp, fn = (sum(row[name] for row in rows) for name in ("tp_px", "fp_px", "fn_px"))
    assert tp > 0
    assert fp > 0
    assert sweep.recall[AT_PAPER] == tp / (tp + fn)
    assert sweep.precision[AT_PAPER] == tp / (tp + fp)
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
    small, large = frames_of(("..", [[1, 0]])), frames_of((".....\n.....", [[1] * 5, [0] * 5]), camera="left")
    frames = pa.concat_tables([small, large])
    sweep = threshold_sweep(frames)
    assert sweep is not None
    assert sweep.frames == 2
    assert sweep.false_positive_coverage[AT_PAPER] == 0.5
    summary = summarise(scored([])[0], frames, protocol=PAPER)
    assert summary.false_positives.coverage.value == 0.5


def test_without_objects_there_is_no_recall() -> None:
    sweep = threshold_sweep(frames_of(("..", [[1, 0]])))
    assert sweep is not None
    assert np.isnan(sweep.recall).all()
    assert math.isnan(sweep.auprc)
    assert sweep.precision[AT_PAPER] == 0


def test_a_method_without_likelihood_has_nulls_and_no_curve() -> None:
    _, frames = scored([(reference_frame(picture("1.")), mask("x."))])
    assert frames["likelihood_reference_px"].null_count == frames["likelihood_outside_px"].null_count == 1
    assert threshold_sweep(frames) is None
    assert threshold_free_metrics(frames) is None
    assert threshold_sweep(random_run(1)[1]) is None


def test_the_order_of_the_rows_changes_nothing() -> None:
    draw = np.random.default_rng(3)
    images = [("11..\n....", (10 ** draw.uniform(-6, 0, (2, 4))).tolist()) for _ in range(7)]
    frames = frames_of(*images)
    one, other = threshold_sweep(frames), threshold_sweep(shuffled(frames, 2))
    assert one is not None
    assert other is not None
    for name in ("recall", "precision", "false_positive_coverage", "auprc"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@given(st.integers(0, 50))
def test_curves_fall_with_the_threshold(seed: int) -> None:
    draw = np.random.default_rng(seed)
    sweep = threshold_sweep(frames_of(("11..\n....", (10 ** draw.uniform(-7, 1, (2, 4))).tolist())))
    assert sweep is not None
    assert falls(sweep.recall)
    assert falls(sweep.false_positive_coverage)
    assert 0 < sweep.auprc <= 1


def falls(values: NDArray[np.float64]) -> bool:
    return bool((np.diff(values) <= 0).all())


def test_cells_that_do_not_tile_the_image_are_refused() -> None:
    scorer = SequenceScorer(PAPER)
    told = Segmentation(cell_size_px=2, mask=mask("xx\nxx"), likelihood=np.zeros((2, 1), dtype=np.float32))
    with pytest.raises(ShapeError, match=r"likelihood of \(2, 2\) \(rows, columns\) cells, got \(2, 1\)"):
        scorer.add(reference_frame(picture("....\n....\n....\n....")), told)
