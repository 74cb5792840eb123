from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from shapely import box

from bench.errors import ShapeError
from bench.reporting.overlay import LINE_PX, PixelClass, overlay_areas, overlay_polygons, pixel_classes, unknown_bands
from bench.reporting.video import draw_frame, draw_reference
from tests.reporting.factories import banded_frame, busy_frame, segmentation


def test_a_mask_tints_its_pixels_and_no_others():
    image = np.full((4, 4), 100, dtype=np.uint8)
    mask = np.eye(4, dtype=bool)
    tinted = overlay_areas(image, {"#ff0000": mask}, strength=1.0)
    assert (tinted[mask] == (0, 0, 255)).all()  # BGR
    assert (tinted[~mask] == 100).all()
    assert (image == 100).all()


def test_a_polygon_lies_on_the_pixels_that_its_corners_name():
    drawn = overlay_polygons(np.zeros((20, 20), dtype=np.uint8), polygons=[box(5, 5, 10, 12)], colours=["#ffffff"])
    v, u = np.nonzero(drawn[:, :, 0] > 200)
    assert (u.min(), u.max(), v.min(), v.max()) == (5, 10, 5, 12)
    assert not drawn[8, 8].any()


def test_bands_are_told_from_ignored_objects():
    frame = banded_frame()
    bands = unknown_bands(frame)
    assert np.count_nonzero(bands == 1) == np.count_nonzero(bands) == frame.objects[0].unknown_px
    assert (bands[198:212, 298:312] + frame.labels[198:212, 298:312] == 1).all()
    assert frame.ignored[205, 335]
    assert not unknown_bands(busy_frame()).any()  # ignored objects alone


def test_areas_that_are_left_out_are_no_band():
    frame = banded_frame()
    frame = replace(frame, ignored=frame.ignored | ((frame.labels == 0) & (np.arange(640) < 320)))
    classes = pixel_classes(frame, detected=frame.labels > 0)
    assert np.count_nonzero(classes == PixelClass.UNKNOWN) == frame.objects[0].unknown_px
    drawn = draw_reference(np.zeros((480, 640), dtype=np.uint8), frame, "demo")[:480].astype(int)
    blue, green, red = np.moveaxis(drawn, 2, 0)
    grey = (blue == green) & (green == red) & (red > 0)
    below = frame.valid & (np.arange(480) > 300)[:, None]
    assert (grey == (np.arange(640) < 320))[below].all(), "ignored"
    assert (blue < red)[frame.unknown].all(), "yellow"


def test_one_overlay_for_pictures_and_videos_shows_the_areas_and_the_bands():
    reference = banded_frame()
    nothing = segmentation(reference)
    nothing = replace(nothing, mask=np.zeros_like(nothing.mask))
    frame = SimpleNamespace(pixels=np.zeros((480, 640), dtype=np.uint8), segmentation=nothing, reference=reference)
    drawn = draw_frame(frame, "demo")
    assert drawn.shape == (480 + 3 * LINE_PX, 640, 3)
    blue, _, red = np.moveaxis(drawn[:480], 2, 0)
    assert (red > 0)[unknown_bands(reference) > 0].all(), "yellow"
    inside = np.s_[202:208, 302:308]
    assert (blue[inside] > red[inside]).all(), "missed"


def test_sizes_must_agree():
    with pytest.raises(ShapeError, match="mask"):
        overlay_areas(np.zeros((4, 4), dtype=np.uint8), {"#ff0000": np.zeros((3, 4), dtype=bool)})
