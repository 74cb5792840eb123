"""Misses and false positives by place in the image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from bench.evaluation import ImageMap, SequenceScorer, add_image_maps
from bench.evaluation.counts import CELL_PX
from bench.records.reference import ReferenceFrame
from bench.records.segmentation import Segmentation
from tests.evaluation.frames import frames, masks, reference_frame
from tests.evaluation.runs import PAPER


def image_map(pairs: Sequence[tuple[ReferenceFrame, NDArray[np.bool_]]]) -> ImageMap:
    scorer = SequenceScorer(PAPER)
    for number, (frame, detected) in enumerate(pairs):
        scorer.add(replace(frame, timestamp_ns=number), Segmentation(cell_size_px=1, mask=detected))
    found = scorer.image_map()
    assert found is not None
    return found


def frame_and_mask(*, camera: str = "front", width: int = 20) -> tuple[ReferenceFrame, NDArray[np.bool_]]:
    """16 rows; G in rows 4 to 11 of the first 8 columns, found in rows 8 to 11; two false pixels in the last cell."""
    labels = np.zeros((16, width), dtype=np.int32)
    labels[4:12, :8] = 1
    detected = np.zeros((16, width), dtype=bool)
    detected[8:12, :8] = True
    detected[15, -2:] = True
    return reference_frame(labels, camera=camera), detected


def test_a_map_to_check_by_hand() -> None:
    found = image_map([frame_and_mask()] * 3)
    assert (found.camera, found.width, found.height, found.cell_px, found.frames) == ("front", 20, 16, 8, 3)
    assert found.reference_px.tolist() == [[96, 0, 0], [96, 0, 0]]
    assert found.missed_px.tolist() == [[96, 0, 0], [0, 0, 0]]
    assert found.false_px.tolist() == [[0, 0, 0], [0, 0, 6]]
    np.testing.assert_array_equal(found.missed_rate, [[1, np.nan, np.nan], [0, np.nan, np.nan]])
    # The last column of cells is 4 px wide.
    assert found.false_rate.tolist() == [[0, 0, 0], [0, 0, 2 / 32]]


def test_a_sequence_without_scored_frames_has_no_map() -> None:
    assert SequenceScorer(PAPER).image_map() is None


@given(st.lists(st.tuples(frames(), masks), min_size=1, max_size=4))
def test_maps_sum_to_the_counts_of_the_frames(pairs: list[tuple[ReferenceFrame, NDArray[np.bool_]]]) -> None:
    scorer = SequenceScorer(PAPER)
    for number, (frame, detected) in enumerate(pairs):
        scorer.add(replace(frame, timestamp_ns=number), Segmentation(cell_size_px=1, mask=detected))
    found, table = scorer.image_map(), scorer.finish()[1]
    assert found is not None
    assert found.frames == len(pairs)
    for grid, column in ((found.reference_px, "reference_px"), (found.missed_px, "fn_px"), (found.false_px, "fp_px")):
        assert int(grid.sum()) == sum(table[column].to_pylist())


def test_units_add_up_whatever_their_order() -> None:
    parts = [
        image_map([frame_and_mask()]),
        image_map([frame_and_mask(camera="left")]),
        image_map([frame_and_mask()] * 2),
        image_map([frame_and_mask(width=24)]),
    ]
    one, other = add_image_maps(parts), add_image_maps(parts[::-1])
    assert [(m.camera, m.width, m.frames) for m in one] == [("front", 20, 3), ("front", 24, 1), ("left", 20, 1)]
    whole = image_map([frame_and_mask()] * 3)
    for maps in (one, other):
        for name in ("reference_px", "missed_px", "false_px"):
            np.testing.assert_array_equal(getattr(maps[0], name), getattr(whole, name))
    assert parts[0].frames == 1
    assert int(parts[0].reference_px.sum()) == 8 * CELL_PX
