import numpy as np
from matplotlib.image import AxesImage
from matplotlib.quiver import Quiver

from bench.reporting.canvas import figure_bytes
from bench.reporting.panels import BAND_NOTE, draw_panels
from tests.reporting.factories import banded_frame, busy_frame, fisheye_image, segmentation


def panels(*, parts: bool = True, image=None):
    reference = busy_frame()
    pixels = fisheye_image() if image is None else image
    return draw_panels(pixels, segmentation=segmentation(reference, parts=parts), reference=reference)


def row_labels(figure):
    return [axes.get_ylabel() for axes in figure.axes]


def test_the_seven_rows_of_the_paper():
    assert row_labels(panels()) == [
        "(I) flow",
        "(II) epipolar",
        "(III) positive depth",
        "(IV) positive height",
        "(V) anti-parallel",
        "(VI) likelihood",
        "(VII) segmentation",
    ]


def test_a_method_without_parts_gets_fewer_panels():
    assert row_labels(panels(parts=False)) == ["(I) likelihood", "(II) segmentation"]


def test_a_line_explains_bands_where_there_are_any():
    reference = banded_frame()
    figure = draw_panels(fisheye_image(), segmentation=segmentation(reference, parts=False), reference=reference)
    assert row_labels(figure) == ["(I) likelihood", "(II) segmentation"]
    assert [axes.get_xlabel() for axes in figure.axes] == ["", BAND_NOTE]


def test_the_likelihood_saturates_at_two_hundredths():
    images = [a for axes in panels(parts=False).axes for a in axes.get_children() if isinstance(a, AxesImage)]
    assert images[0].norm.vmin == 0.0
    assert images[0].norm.vmax == 0.02
    assert images[0].norm(0.5) == 1.0


def test_cells_cover_the_pixels_that_they_tile():
    images = [a for axes in panels(parts=False).axes for a in axes.get_children() if isinstance(a, AxesImage)]
    assert list(images[0].get_extent()) == [-0.5, 639.5, 479.5, -0.5]


def test_arrows_end_at_the_current_pixel_and_show_the_motion_forward_in_time():
    (arrows,) = [a for axes in panels().axes for a in axes.get_children() if isinstance(a, Quiver)]
    below = arrows.V[arrows.Y > 400]  # flow to the previous image points up there, so the motion points down
    assert (below > 0).all()
    assert arrows.pivot == "tip"


def test_objects_are_labelled_with_category_and_track_inside_the_picture():
    axes = panels(parts=False).axes[-1]
    labels = {text.get_text() for text in axes.texts}
    assert labels == {"crossing pedestrian-1", "crossing pedestrian-2", "overtaking car-7", "preceding car-8"}
    boxes = [text.get_window_extent() for text in axes.texts]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    assert all(axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1 for box in boxes)


def test_the_same_bytes_twice_and_no_date():
    first, second = (figure_bytes(panels(parts=False), "svg") for _ in range(2))
    assert first == second
    assert b"<dc:date>" not in first


def test_the_input_is_left_alone():
    image = fisheye_image()
    panels(image=image)
    assert np.array_equal(image, fisheye_image())
