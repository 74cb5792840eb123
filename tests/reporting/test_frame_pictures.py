"""Panels, clusters and the pictures of a run."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
from matplotlib.image import AxesImage
from matplotlib.quiver import Quiver

from bench.evaluation.rows import objects_table
from bench.records.reference import Category
from bench.reporting.frame import draw_cluster, draw_panels
from bench.reporting.frame_pictures import example_frames, write_frame_pictures
from tests.reporting.factories import busy_frame, cluster, fisheye_image, reference_frame, segmentation
from tests.support.result_rows import object_row


def panels(*, parts: bool = True, image=None):
    reference = busy_frame()
    answer = segmentation(reference, parts=parts)
    pixels = fisheye_image() if image is None else image
    return draw_panels(SimpleNamespace(pixels=pixels, segmentation=answer, reference=reference))


def row_labels(figure):
    return [axes.get_ylabel() for axes in figure.axes]


def test_the_seven_rows_of_the_paper_and_fewer_of_a_method_without_parts():
    assert row_labels(panels(parts=False)) == ["(I) likelihood", "(II) segmentation"]
    assert row_labels(panels()) == [
        "(I) flow",
        "(II) epipolar",
        "(III) positive depth",
        "(IV) positive height",
        "(V) anti-parallel",
        "(VI) likelihood",
        "(VII) segmentation",
    ]


def test_the_likelihood_saturates_at_two_hundredths():
    images = [a for axes in panels(parts=False).axes for a in axes.get_children() if isinstance(a, AxesImage)]
    assert images[0].norm.vmin == 0.0
    assert images[0].norm.vmax == 0.02
    assert images[0].norm(0.5) == 1.0
    assert list(images[0].get_extent()) == [-0.5, 639.5, 479.5, -0.5], "cells cover the pixels that they tile"


def test_arrows_end_at_the_current_pixel_and_show_the_motion_forward_in_time():
    (arrows,) = [a for axes in panels().axes for a in axes.get_children() if isinstance(a, Quiver)]
    below = arrows.V[arrows.Y > 400]  # flow to the previous image points up there, so the motion points down
    assert (below > 0).all()
    assert arrows.pivot == "tip"


def test_objects_are_labelled_off_each_other_inside_the_picture():
    axes = panels(parts=False).axes[-1]
    assert {text.get_text().partition(":")[0] for text in axes.texts} == {t.track_id for t in busy_frame().objects}
    boxes = [text.get_window_extent() for text in axes.texts]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    assert all(axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1 for box in boxes)


def test_the_input_is_left_alone():
    image = fisheye_image()
    panels(image=image)
    assert np.array_equal(image, fisheye_image())


def test_the_frame_where_an_object_fills_most_pixels_tells_of_its_category():
    rows = [object_row(n) | {"region_px": px} for n, px in enumerate((100, 300, 200))]
    rows.append(object_row(3) | {"region_px": 900, "status": "ignored"})
    assert example_frames(objects_table(rows)) == {Category.CROSSING: ("drive-1", "front", 100)}


def test_every_picture_of_a_frame_stays_in_the_folder_whatever_the_track_is_called(tmp_path):
    strange = busy_frame().objects[0]
    reference = reference_frame([replace(strange, track_id="../x y")])
    processed = SimpleNamespace(
        image=SimpleNamespace(moving_path=None),
        pixels=fisheye_image(),
        segmentation=segmentation(reference),
        reference=reference,
    )
    view = SimpleNamespace(**cluster())
    pipeline = Mock()
    pipeline.references.geometry.return_value = view.geometry
    pipeline.recording.vehicle_outline_m = view.vehicle_outline_m
    files = write_frame_pictures(processed, pipeline, tmp_path / "pictures", made_by="method own, protocol paper-v1")
    names = ["panels.png", "areas.png", "cluster-.._x_y.png"]
    assert [file.name for file in files] == names
    assert sorted(names) == sorted(file.name for file in (tmp_path / "pictures").iterdir())


def test_a_cluster_from_above_and_its_object_enlarged():
    shown = cluster()
    figure = draw_cluster(**shown)
    plan, picture = figure.axes
    assert plan.get_xlabel() == "y (m), left of the ego vehicle"
    assert plan.get_xlim()[0] > plan.get_xlim()[1]  # y grows to the left
    assert plan.get_ylim()[0] < plan.get_ylim()[1]  # x grows upwards
    u_min, v_min, u_max, v_max = shown["polygon"].bounds
    (left, right), (bottom, top) = picture.get_xlim(), picture.get_ylim()
    assert left < u_min < u_max < right
    assert top < v_min < v_max < bottom
