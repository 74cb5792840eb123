"""Predictions of other sizes than the image's."""

from pathlib import Path

import numpy as np
import pytest

from bench.methods.predictions.files import ImageSizes, WrongSizeError, on_cells

FILE = Path("a.png")
SIZES = ImageSizes(evaluated_px=(8, 4), stored_px=(16, 8))


@pytest.mark.parametrize("size", [(8, 4), (4, 2), (2, 1), (16, 8), (24, 12), (32, 16), (80, 40)])
def test_whole_fractions_and_multiples_pass(size):
    SIZES.refuse_unfit(size, file=FILE)


@pytest.mark.parametrize("size", [(4, 8), (1, 1), (8, 8), (7, 4), (12, 6), (0, 0), (4, 1), (160_000, 4)])
def test_others_are_refused_with_both_sizes(size):
    with pytest.raises(WrongSizeError, match=rf"8 x 4 or 16 x 8 px, or a whole fraction .* got {size[0]} x {size[1]}"):
        SIZES.refuse_unfit(size, file=FILE)


def test_a_multiple_may_not_be_of_any_size():
    with pytest.raises(WrongSizeError, match="at most 67108864 pixels, got 160000 x 80000"):
        SIZES.refuse_unfit((160_000, 80_000), file=FILE)


def test_a_smaller_map_is_cells():
    mask = np.array([[True, False, False, True], [False, True, False, False]])
    cells, cell_px = on_cells(mask, SIZES)
    assert cell_px == 2
    np.testing.assert_array_equal(cells, mask)


def test_a_larger_map_is_the_mean_of_each_pixels_block():
    large = np.zeros((12, 24), dtype=np.float32)
    large[0:3, 3:6] = np.arange(9).reshape(3, 3) / 8
    cells, cell_px = on_cells(large, SIZES)
    assert cell_px == 1
    assert cells.shape == (4, 8)
    assert cells[0, 1] == 0.5
    assert np.count_nonzero(cells) == 1


def test_half_of_a_block_is_half():
    large = np.zeros((8, 16), dtype=bool)
    large[0, 0:2] = large[2, 2] = True
    cells, _ = on_cells(large, SIZES)
    assert (cells[0, 0], cells[1, 1]) == (0.5, 0.25)


def test_a_map_that_fits_the_stored_size_only_goes_by_way_of_it():
    sizes = ImageSizes(evaluated_px=(6, 3), stored_px=(8, 4))
    small = np.zeros((2, 4), dtype=bool)
    small[:, :2] = True  # the left half, at any size
    for scale in (1, 2, 4):  # half of the stored size, the stored size, twice the stored size
        scaled = np.repeat(np.repeat(small, scale, axis=0), scale, axis=1)
        cells, cell_px = on_cells(scaled, sizes)
        assert (cell_px, cells.shape) == (1, (3, 6))
        np.testing.assert_array_equal(cells >= 0.5, np.arange(6)[None, :].repeat(3, axis=0) < 3)
