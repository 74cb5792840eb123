import numpy as np
import pytest
from shapely import box

from bench.errors import ShapeError
from bench.reference.records import Status
from bench.reporting.canvas import figure_bytes
from bench.reporting.count_view import PixelClass, draw_counts, pixel_classes
from tests.reporting.factories import busy_frame, fisheye_image, reference_frame, reference_object, segmentation


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
    figure = draw_counts(fisheye_image(), reference=reference_frame(objects), detected=detected)
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert texts == ["a: TPR 50 %, IoU 33 %"]
    assert figure.axes[0].get_title() == "false-positive coverage 0.0 % of the image"


def test_the_same_bytes_twice():
    reference = busy_frame()
    detected = segmentation(reference).mask_at(640, 480)
    first, second = (
        figure_bytes(draw_counts(fisheye_image(), reference=reference, detected=detected), "png") for _ in range(2)
    )
    assert first == second
