"""Several methods on one image."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from bench.errors import UsageError
from bench.reporting.side_by_side import Side, draw_side_by_side
from tests.reporting.factories import busy_frame, fisheye_image, segmentation


def side(label, *, reference=None, note=""):
    reference = reference or busy_frame()
    frame = SimpleNamespace(pixels=fisheye_image(), segmentation=segmentation(reference), reference=reference)
    return Side(label=label, processed=frame, note=note)


def test_each_side_is_named_and_the_picture_says_which_image_it_is():
    figure = draw_side_by_side([side("ours"), side("theirs", note="IoU 41.0 %"), side("third")], title="worst")
    assert figure.texts[0].get_text() == "worst\ndemo, camera front, 1.20 s"
    heads = [axes.get_title() for axes in figure.axes]
    assert heads == [
        "ours\nfalse positives 8.7 % of the image",
        "theirs\nIoU 41.0 %",
        heads[0].replace("ours", "third"),
    ]
    rows = [round(axes.get_position().y0, 3) for axes in figure.axes]
    assert rows[0] == rows[1] > rows[2]
    assert len(figure.legends) == 1


def test_sides_of_different_images_are_refused():
    other = replace(busy_frame(), timestamp_ns=1_300_000_000)
    with pytest.raises(UsageError, match="expected one image, got 2"):
        draw_side_by_side([side("a"), side("b", reference=other)])
