"""Times of rows, by hand."""

import numpy as np
import pytest

from bench.cameras import PinholeCamera, RollingShutter
from bench.errors import ShapeError

CAMERA = PinholeCamera(width=8, height=4, focal=(5.0, 5.0), principal_point=(3.5, 1.5))
CORNERS = np.array([[0.0, 0.0], [7.0, 0.0], [0.0, 3.0], [7.0, 3.0]])


@pytest.mark.parametrize(
    ("direction", "offsets_ms"),
    [
        ("down", [-15, -15, 15, 15]),  # four rows in 40 ms: 10 ms from row to row
        ("up", [15, 15, -15, -15]),
        ("right", [-17.5, 17.5, -17.5, 17.5]),  # eight columns: 5 ms
        ("left", [17.5, -17.5, 17.5, -17.5]),
    ],
)
def test_the_middle_row_has_the_time_of_the_image(direction, offsets_ms):
    shutter = RollingShutter(readout_s=0.04, direction=direction)
    assert shutter.row_time_offset_s(CORNERS, CAMERA) * 1e3 == pytest.approx(offsets_ms)
    assert shutter.row_time_offset_s(np.array([3.5, 1.5]), CAMERA) == 0.0


def test_the_size_at_which_an_image_is_evaluated_changes_no_time():
    shutter, large = RollingShutter(readout_s=0.04), CAMERA.scaled(24, 12)
    same_places = (CORNERS + 0.5) * 3 - 0.5
    assert shutter.row_time_offset_s(same_places, large) == pytest.approx(shutter.row_time_offset_s(CORNERS, CAMERA))


def test_pixels_beyond_the_image_have_the_time_of_its_border_and_unknown_ones_that_of_the_image():
    pixels = np.array([[[0.0, -100.0], [0.0, 100.0], [np.nan, np.nan]]])
    assert RollingShutter(readout_s=0.04).row_time_offset_s(pixels, CAMERA) == pytest.approx(
        np.array([[-0.02, 0.02, 0.0]])
    )


@pytest.mark.parametrize("wrong", [{"readout_s": 0.0}, {"readout_s": 25.0}, {"readout_s": np.nan}, {"direction": "in"}])
def test_what_is_no_readout_is_refused(wrong):
    with pytest.raises(ShapeError, match=next(iter(wrong))):
        RollingShutter(**({"readout_s": 0.025} | wrong))
