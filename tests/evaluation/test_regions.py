"""An image taken apart, and pixels counted by cell."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray

from bench.evaluation.counts import count_by_cell, find_regions
from bench.records.reference import ReferenceFrame
from tests.evaluation.frames import frames, mask, masks


def test_cells_to_check_by_hand() -> None:
    found = count_by_cell(mask("xx.x.\nx...x\n....x"), 2)
    assert found.tolist() == [[3, 1, 1], [0, 0, 1]]
    assert found.dtype == np.int64


@pytest.mark.parametrize("cell", [1, 5, 8, 16, 300])
def test_no_cell_overflows(cell: int) -> None:
    assert count_by_cell(np.ones((600, 900), dtype=bool), cell).sum() == 600 * 900


@given(npst.arrays(bool, st.tuples(st.integers(1, 20), st.integers(1, 20))), st.integers(1, 9))
def test_cells_hold_what_a_loop_finds(region: NDArray[np.bool_], cell: int) -> None:
    rows, columns = (range(0, size, cell) for size in region.shape)
    expected = [[int(region[v : v + cell, u : u + cell].sum()) for u in columns] for v in rows]
    assert count_by_cell(region, cell).tolist() == expected


@given(frames(), masks)
def test_every_valid_pixel_is_in_one_region(frame: ReferenceFrame, detected: NDArray[np.bool_]) -> None:
    regions = find_regions(frame, detected)
    parts = regions.moving.astype(int) + regions.outside + (frame.ignored & frame.valid)
    assert np.array_equal(parts, frame.valid.astype(int))
    assert np.array_equal(regions.true, regions.moving & detected)
    assert np.array_equal(regions.false, regions.outside & detected)
    within = np.zeros_like(regions.moving)
    within[regions.window] = True
    assert not (regions.moving & ~within).any()
    assert regions.moving.any() or not within.any()
