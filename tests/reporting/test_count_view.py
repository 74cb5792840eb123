from itertools import combinations
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from shapely import box

from bench.errors import ShapeError
from bench.records.reference import Status
from bench.records.segmentation import Segmentation
from bench.reporting.canvas import figure_bytes, rgb
from bench.reporting.overlay import AREA_COLOURS, PixelClass, pixel_classes
from bench.reporting.side_by_side import Side, draw_side_by_side
from tests.reporting.factories import (
    banded_frame,
    busy_frame,
    fisheye_image,
    reference_frame,
    reference_object,
    segmentation,
)


def drawn(reference, detected):
    answer = Segmentation(cell_size_px=1, mask=detected)
    frame = SimpleNamespace(pixels=fisheye_image(), segmentation=answer, reference=reference)
    return draw_side_by_side([Side(processed=frame)])


def test_pixel_classes_are_the_areas_of_the_metrics():
    objects = [
        reference_object("a", box(300, 200, 309, 209)),
        reference_object("b", box(400, 200, 409, 209), status=Status.IGNORED),
    ]
    reference = reference_frame(objects)
    detected = np.zeros((480, 640), dtype=bool)
    detected[200:205, 300:420] = True  # half of a, half of b, and what lies around them
    detected[0, 0] = True  # outside the field of view
    classes = pixel_classes(reference, detected=detected)
    assert classes[202, 302] == PixelClass.TRUE_POSITIVE
    assert classes[208, 302] == PixelClass.FALSE_NEGATIVE
    assert classes[202, 350] == PixelClass.FALSE_POSITIVE
    assert classes[202, 402] == PixelClass.IGNORED
    assert classes[208, 402] == PixelClass.IGNORED
    assert classes[300, 302] == PixelClass.BACKGROUND
    assert classes[0, 0] == PixelClass.OUTSIDE
    assert np.count_nonzero(classes == PixelClass.TRUE_POSITIVE) == 50
    assert np.count_nonzero(classes == PixelClass.FALSE_NEGATIVE) == 50
    assert np.count_nonzero(classes == PixelClass.FALSE_POSITIVE) == 5 * 120 - 2 * 50


def test_a_mask_of_another_size_is_refused():
    with pytest.raises(ShapeError, match="detected"):
        pixel_classes(busy_frame(), detected=np.zeros((10, 10), dtype=bool))


def test_the_picture_names_the_figures_of_the_frame():
    objects = [reference_object("a", box(300, 200, 309, 209))]
    detected = np.zeros((480, 640), dtype=bool)
    detected[200:205, 300:320] = True  # TP 50, FN 50, FP 50
    figure = drawn(reference_frame(objects), detected)
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert texts == ["a: TPR 50 %, IoU 33 %"]
    assert figure.texts[0].get_text() == "demo, camera front, 1.20 s"
    assert figure.axes[0].get_title() == "false positives 0.0 % of the image"


def test_a_band_counts_neither_way_and_the_legend_says_so():
    frame = banded_frame()
    for detected in (np.zeros(frame.labels.shape, dtype=bool), np.ones(frame.labels.shape, dtype=bool)):
        classes = pixel_classes(frame, detected=detected)
        assert np.count_nonzero(classes == PixelClass.UNKNOWN) == frame.objects[0].unknown_px
        assert (classes[200:210, 330:340] == PixelClass.IGNORED).all()
    core = frame.labels > 0
    figure = drawn(frame, core)
    assert [text.get_text() for text in figure.axes[0].texts] == ["a: TPR 100 %, IoU 100 %"]
    told = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert "unknown band, counts neither way" in told
    assert "reference polygon" not in told  # it runs amid the band


def seen_by_deuteranopes(colour):
    """Lab of "#rrggbb" without the green receptors (Vienot, Brettel and Mollon 1999, on linear light)."""
    linear = (np.array(rgb(colour)) / 255.0) ** 2.2
    seen = np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]]) @ linear
    red_green_blue = np.clip(seen, 0, 1)[None, None] ** (1 / 2.2)
    return cv2.cvtColor(red_green_blue.astype(np.float32), cv2.COLOR_RGB2LAB)[0, 0]


def test_areas_stay_apart_for_the_colour_blind():
    for one, other in combinations(AREA_COLOURS.values(), 2):
        assert np.linalg.norm(seen_by_deuteranopes(one) - seen_by_deuteranopes(other)) > 20, (one, other)
    alike = [seen_by_deuteranopes(colour) for colour in ("#ff0000", "#8e8e00")]  # red and olive: the simulation bites
    assert np.linalg.norm(alike[0] - alike[1]) < 10


def test_the_same_bytes_twice():
    reference = busy_frame()
    detected = segmentation(reference).mask_at(640, 480)
    first, second = (figure_bytes(drawn(reference, detected), "png") for _ in range(2))
    assert first == second
