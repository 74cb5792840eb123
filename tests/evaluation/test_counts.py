"""Counts of one image: examples to check by hand, a brute-force twin, and the laws; then a sequence of images."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray
from scipy import ndimage

from bench.errors import ShapeError
from bench.evaluation.counts import (
    ChanceScorer,
    FrameCounts,
    ObjectCounts,
    count_frame,
    share_in_proportion,
)
from bench.evaluation.rows import FRAMES_SCHEMA, OBJECTS_SCHEMA
from bench.evaluation.scorer import SequenceScorer
from bench.records.reference import IgnoreReason, ReferenceFrame, Status
from bench.records.segmentation import Segmentation
from bench.times import SECOND_NS
from tests.evaluation.frames import (
    frames,
    ignored_object,
    mask,
    masks,
    picture,
    reference_frame,
    reference_object,
    static_object,
)
from tests.evaluation.runs import PAPER, scored


def count(frame: ReferenceFrame, detected: NDArray[np.bool_]) -> tuple[FrameCounts, tuple[ObjectCounts, ...]]:
    return count_frame(frame, detected, component_size_px=3)


def test_one_object_half_detected_with_a_spill_and_a_blob_elsewhere() -> None:
    frame = reference_frame(picture("11......\n11......\n........"))
    counts, (item,) = count(frame, mask(".xxx....\n.x....xx\n.......x"))
    assert (item.tp, item.fn, item.fp) == (2, 2, 2)
    assert (counts.tp_px, counts.fn_px, counts.fp_px, counts.fp_unattached_px) == (2, 2, 5, 3)
    assert (counts.fp_components, counts.fp_large_components, counts.fp_largest_px) == (2, 0, 3)
    assert (counts.width, counts.height, counts.valid_px, counts.reference_px, counts.detected_px) == (8, 3, 24, 4, 7)


def test_a_shared_component_is_split_by_overlap_and_stays_whole() -> None:
    frame = reference_frame(picture("1.....22\n........"))
    counts, (one, two) = count(frame, mask("xxxxxxxx\n........"))
    # 5 false pixels over overlaps 1 and 2: 1 2/3 and 3 1/3, so the spare pixel goes to the larger remainder.
    assert (one.fp, two.fp, counts.fp_px) == (2, 3, 5)


def test_a_mask_of_another_size_is_refused_with_the_frame_named() -> None:
    with pytest.raises(ShapeError, match=r"drive, front, 0 ns: expected a mask of \(1, 4\).*got \(1, 3\)"):
        count(reference_frame(picture("....")), mask("..."))


@given(frames(), masks)
def test_counts_agree_with_plain_loops(frame: ReferenceFrame, detected: NDArray[np.bool_]) -> None:
    counts, objects = count(frame, detected)
    expected, expected_objects = brute_force(frame, detected)
    assert {name: getattr(counts, name) for name in expected} == expected
    assert objects == expected_objects
    assert sum(item.fp for item in objects) + counts.fp_unattached_px == counts.fp_px
    assert [item.tp + item.fn for item in objects] == [item.region_px for item in frame.objects]


def brute_force(frame: ReferenceFrame, detected: NDArray[np.bool_]) -> tuple[dict[str, int], tuple[ObjectCounts, ...]]:
    """The definitions once more, pixel by pixel and with exact fractions, whatever order the objects have."""
    height, width = frame.labels.shape
    pixels = [(v, u) for v in range(height) for u in range(width)]
    mask_px = {p for p in pixels if detected[p] and frame.valid[p]}
    regions = [{p for p in pixels if frame.labels[p] == k + 1} for k in range(len(frame.objects))]
    false = {p for p in mask_px if frame.labels[p] == 0 and not frame.ignored[p]}
    shares = [0] * len(regions)
    sizes, unattached = [], 0
    labels, components = ndimage.label(detected & frame.valid, structure=np.ones((3, 3)))
    for number in range(1, components + 1):
        component = {p for p in pixels if labels[p] == number}
        size = len(component & false)
        sizes.append(size)
        overlaps = {k: len(component & region) for k, region in enumerate(regions) if component & region}
        unattached += 0 if overlaps else size
        exact = {k: Fraction(size * overlap, sum(overlaps.values())) for k, overlap in overlaps.items()}
        spare = size - sum(int(share) for share in exact.values()) if exact else 0
        first = sorted(exact, key=lambda k: (-(exact[k] % 1), frame.objects[k].track_id))[:spare]
        for k, share in exact.items():
            shares[k] += int(share) + (k in first)
    objects = tuple(
        ObjectCounts(tp=len(region & mask_px), fn=len(region - mask_px), fp=share)
        for region, share in zip(regions, shares, strict=True)
    )
    totals = {
        "valid_px": np.count_nonzero(frame.valid),
        "ignored_px": np.count_nonzero(frame.ignored & frame.valid),
        "detected_px": len(mask_px),
        "reference_px": sum(len(region) for region in regions),
        "tp_px": sum(item.tp for item in objects),
        "fn_px": sum(item.fn for item in objects),
        "fp_px": len(false),
        "fp_unattached_px": unattached,
        "fp_components": sum(size > 0 for size in sizes),
        "fp_large_components": sum(size > 3 for size in sizes),
        "fp_largest_px": max(sizes, default=0),
    }
    assert all((o.status is Status.EVALUATED) == bool(r) for o, r in zip(frame.objects, regions, strict=True))
    return totals, objects


@given(st.integers(0, 400_000), npst.arrays(np.int64, st.integers(1, 6), elements=st.integers(0, 300_000)))
def test_shares_are_exact_in_sum_and_within_a_pixel_of_the_proportion(amount: int, weight: NDArray[np.int64]) -> None:
    shares = share_in_proportion(np.array([amount]), weights=weight[None])
    assert shares.sum() == (amount if weight.any() else 0)
    exact = amount * weight / max(weight.sum(), 1)
    assert (np.abs(shares - exact) < 1).all()
    assert not shares[weight == 0].any()


def test_exact_masks_are_counted_beside_the_answer() -> None:
    frame, scorer = reference_frame(picture("111.....")), SequenceScorer(PAPER)
    scorer.add(frame, Segmentation(cell_size_px=1, mask=mask("x.......")), exact=mask(".xxxx..."))
    (row,) = scorer.finish()[0].to_pylist()
    assert (row["tp"], row["fn"], row["fp"]) == (1, 2, 0)
    assert (row["ceiling_tp"], row["ceiling_fp"]) == (2, 2)


# The chance level scores objects against the mask of another frame.

PIXELS = 12


@given(st.sets(st.integers(0, 100), max_size=PIXELS - 1), st.integers(1, 60))
def test_chance_agrees_with_a_search_over_all_frames(times: set[int], lag_ns: int) -> None:
    """A lag earlier, for the first frames a lag later; the n-th mask has n + 1 pixels, so that the count names it."""
    times_ns, scorer, expected = sorted(times), ChanceScorer(lag_ns=lag_ns), {}
    for n, t in enumerate(times_ns):
        objects = [reference_object("a"), ignored_object("far")]
        frame = reference_frame(picture("1" * PIXELS), objects=objects, timestamp_ns=t)
        scorer.add(frame, np.arange(PIXELS)[None] <= n)
        earlier = [n for n, other in enumerate(times_ns) if other <= t - lag_ns]
        later = [n for n, other in enumerate(times_ns) if other >= t + lag_ns]
        if earlier or later:
            expected[t] = {"a": (earlier[-1] if earlier else later[0]) + 1}
    assert scorer.finish() == expected


# From frames to the two tables.


def test_every_annotated_object_has_a_row() -> None:
    objects = [reference_object("a"), ignored_object("b", IgnoreReason.FEW_POINTS), static_object("c")]
    frame = reference_frame(picture("11.."), objects=objects, ignored=mask("..x."))
    table, _ = scored([(frame, mask(".x.x"))])
    rows = table.to_pylist()
    assert table.schema == OBJECTS_SCHEMA
    assert [(r["track_id"], r["status"], r["reason"], r["category"]) for r in rows] == [
        ("a", "evaluated", None, "crossing"),
        ("b", "ignored", "too_few_points", "crossing"),
        ("c", "static", None, None),
    ]
    assert [(r["region_px"], r["tp"], r["fn"], r["fp"]) for r in rows] == [(2, 1, 1, 0), (0, 0, 0, 0), (0, 0, 0, 0)]


def test_cells_are_spread_over_the_image() -> None:
    scorer = SequenceScorer(PAPER)
    frame = reference_frame(np.zeros((4, 6), dtype=np.int32), valid=mask("xxxxxx\nxxxxxx\nxxxxxx\n......"))
    marked = {"mask": mask("x..\n..."), "undefined": mask("...\n.x.")}
    cause = np.array([[1, 0, 0], [0, 0, 0]], dtype=np.uint8)
    scorer.add(frame, Segmentation(cell_size_px=2, **marked, causes=("depth", "epipolar"), cause=cause))
    (row,) = scorer.finish()[1].to_pylist()
    assert (row["fp_px"], row["undefined_px"], row["valid_px"]) == (4, 2, 18)
    assert row["fp_by_cause"] == [("depth", 0), ("epipolar", 4)]


def test_an_image_left_out_says_why() -> None:
    scorer = SequenceScorer(PAPER)
    scorer.leave_out(recording="drive", camera="front", timestamp_ns=7, status="failed", problem="truncated image")
    objects, images = scorer.finish()
    assert len(objects) == 0
    assert images.schema == FRAMES_SCHEMA
    (row,) = images.to_pylist()
    assert (row["timestamp_ns"], row["status"], row["problem"], row["fp_px"]) == (7, "failed", "truncated image", 0)


def test_chance_comes_from_the_mask_a_second_away() -> None:
    objects = [reference_object("a"), static_object("b")]
    early = reference_frame(picture("11.."), objects=objects)
    late = reference_frame(picture("..11"), objects=objects, timestamp_ns=SECOND_NS)
    table, _ = scored([(early, mask("xxx.")), (late, mask(".xxx"))])
    assert table["chance_tp"].to_pylist() == [1, None, 1, None]
