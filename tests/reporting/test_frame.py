"""The one drawing of a frame: what each pixel counts as, how it is drawn, names and legend; panels, clusters, files."""

from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import AxesImage
from matplotlib.quiver import Quiver
from shapely import box

from bench.records.reference import Category, Status
from bench.records.segmentation import Segmentation
from bench.reporting.figures import figure_pixels
from bench.reporting.frame import (
    AREAS,
    Layers,
    PixelClass,
    draw_cluster,
    draw_frames,
    draw_panels,
    overlay_areas,
    pixel_classes,
    reference_layers,
    scored_layers,
)
from bench.reporting.frame_pictures import example_frames, write_frame_pictures
from tests.reporting.factories import (
    banded_frame,
    busy_frame,
    cluster,
    fisheye_image,
    reference_frame,
    reference_object,
    segmentation,
)
from tests.support.result_rows import evaluated, object_row, objects_table


def processed(reference, detected):
    answer = Segmentation(cell_size_px=1, mask=detected)
    return SimpleNamespace(pixels=fisheye_image(), segmentation=answer, reference=reference)


def drawn(reference, detected, *, name="demo, camera front, 1.20 s"):
    return draw_frames([scored_layers(processed(reference, detected))], name=name)


def legend_of(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_a_mask_tints_its_pixels_and_no_others():
    image = np.full((4, 4), 100, dtype=np.uint8)
    mask = np.eye(4, dtype=bool)
    tinted = overlay_areas(image, {"#ff0000": mask}, strength=1.0)
    assert (tinted[mask] == (0, 0, 255)).all()  # BGR
    assert (tinted[~mask] == 100).all()
    assert (image == 100).all()


def test_pixel_classes_are_the_areas_of_the_metrics():
    objects = [
        reference_object("a", box(300, 200, 309, 209)),
        reference_object("b", box(400, 200, 409, 209), status=Status.IGNORED),
    ]
    detected = np.zeros((480, 640), dtype=bool)
    detected[200:205, 300:420] = True  # half of a, half of b, and what lies around them
    detected[0, 0] = True  # outside the field of view
    classes = pixel_classes(reference_frame(objects), detected=detected)
    at = {(202, 302): "TRUE_POSITIVE", (208, 302): "FALSE_NEGATIVE", (202, 350): "FALSE_POSITIVE",
          (202, 402): "IGNORED", (208, 402): "IGNORED", (300, 302): "BACKGROUND", (0, 0): "OUTSIDE"}  # fmt: skip
    assert {place: PixelClass(classes[place]).name for place in at} == at
    counts = {"TRUE_POSITIVE": 50, "FALSE_NEGATIVE": 50, "FALSE_POSITIVE": 5 * 120 - 2 * 50}
    assert {name: np.count_nonzero(classes == PixelClass[name]) for name in counts} == counts


def test_bands_and_left_out_areas_are_told_from_ignored_objects_and_every_area_has_its_colour():
    frame = banded_frame()
    left_out = (frame.labels == 0) & ~frame.ignored & frame.valid & (np.arange(640) < 280)
    frame = replace(frame, ignored=frame.ignored | left_out, left_out=left_out)
    for detected in (np.zeros(frame.labels.shape, dtype=bool), np.ones(frame.labels.shape, dtype=bool)):
        classes = pixel_classes(frame, detected=detected)
        assert np.count_nonzero(classes == PixelClass.UNKNOWN) == frame.objects[0].unknown_px
        assert (classes[200:210, 330:340] == PixelClass.IGNORED).all()
        assert ((classes == PixelClass.LEFT_OUT) == left_out).all()
    dark = replace(
        scored_layers(processed(frame, np.zeros((480, 640), dtype=bool))), pixels=np.zeros((480, 640), np.uint8)
    )
    figure = draw_frames([dark], name="demo")
    left, top, width, height = (round(v) for v in figure.axes[0].get_window_extent().bounds)
    assert (width, height) == (640, 480), "a pixel is a pixel"
    picture = figure_pixels(figure)
    picture = picture[picture.shape[0] - top - height :][:480, left : left + 640].astype(int)
    blue, _, red = np.moveaxis(picture, 2, 0)
    assert (red > blue + 50)[frame.unknown].all(), "yellow"
    assert (blue > red + 50)[frame.labels == 1].all(), "missed"
    assert (np.abs(red - blue) < 3)[frame.left_out].all(), "grey"
    assert picture[frame.left_out].std() > 10, "hatched"
    assert picture[300:400, 300:400].std() < 1
    assert picture[200, 560].mean() > 2 * picture[0, 0].mean(), "what is outside is darker"


def test_a_picture_names_image_objects_and_their_values():
    objects = [
        reference_object("a", box(300, 200, 309, 209)),
        reference_object("b", box(400, 200, 409, 209), status=Status.IGNORED),
        reference_object("c", box(450, 200, 459, 209), status=Status.STATIC),
    ]
    detected = np.zeros((480, 640), dtype=bool)
    detected[200:205, 300:320] = True  # TP 50, FN 50, FP 50
    figure = drawn(reference_frame(objects), detected)
    assert [text.get_text() for text in figure.axes[0].texts] == ["a: TPR 50 %, IoU 33 %", "b: beyond range"]
    assert figure.texts[0].get_text() == "demo, camera front, 1.20 s"
    assert figure.axes[0].get_title() == "false positives 0.0 % of the image"
    unscored = ["unknown band", "ignored object", "not annotated", "not evaluated"]
    assert legend_of(figure) == ["found", "missed", "wrongly marked", *unscored]
    alone = draw_frames([reference_layers(fisheye_image(), reference_frame(objects), label="paper-v1")], name="demo")
    assert [text.get_text() for text in alone.axes[0].texts] == ["a: crossing", "b: beyond range"]
    assert alone.axes[0].get_title() == "paper-v1\n1 of 3 annotated objects evaluated"
    assert legend_of(alone) == ["reference", *unscored]


def test_an_outline_is_drawn_where_it_hides_no_band():
    busy = drawn(busy_frame(), busy_frame().labels > 0, name="a long name of a recording " * 4)
    assert len(busy.axes[0].patches) == 4
    assert busy.texts[0].get_window_extent().width < busy.bbox.width
    assert not drawn(banded_frame(), banded_frame().labels > 0).axes[0].patches


def test_several_methods_beside_each_other():
    frame = scored_layers(processed(busy_frame(), segmentation(busy_frame()).mask_at(640, 480)), label="ours")
    figure = draw_frames([frame, replace(frame, label="theirs", note="IoU 41.0 %")], name="demo")
    assert [text.get_text() for text in figure.texts] == ["demo"]
    heads = [axes.get_title() for axes in figure.axes]
    assert heads == ["ours\nfalse positives 2.7 % of the image", "theirs\nIoU 41.0 %"]
    left, right = (axes.get_position() for axes in figure.axes)
    assert (left.y0, left.y1) == (right.y0, right.y1)
    assert left.x1 < right.x0
    assert len(figure.legends) == 1


def test_a_film_keeps_its_size_whatever_is_seen():
    plain = Layers(pixels=fisheye_image(), reference=None, label="own", note="no score: no image before it")
    scored = replace(scored_layers(processed(busy_frame(), busy_frame().labels > 0)), label="own")
    sizes = {tuple(draw_frames([layers], name="demo").get_size_inches()) for layers in (plain, scored)}
    assert len(sizes) == 1


def seen_by_deuteranopes(colour):
    """Lab of "#rrggbb" without the green receptors (Vienot, Brettel and Mollon 1999, on linear light)."""
    linear = np.array(to_rgb(colour)) ** 2.2
    seen = np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]]) @ linear
    red_green_blue = np.clip(seen, 0, 1)[None, None] ** (1 / 2.2)
    return cv2.cvtColor(red_green_blue.astype(np.float32), cv2.COLOR_RGB2LAB)[0, 0]


def test_areas_stay_apart_for_the_colour_blind():
    for one, other in combinations([area.colour for area in AREAS.values()], 2):
        assert np.linalg.norm(seen_by_deuteranopes(one) - seen_by_deuteranopes(other)) > 20, (one, other)
    alike = [seen_by_deuteranopes(colour) for colour in ("#ff0000", "#8e8e00")]  # red and olive: the simulation bites
    assert np.linalg.norm(alike[0] - alike[1]) < 10


# Panels and clusters.


@pytest.fixture(scope="module")
def panels():
    """Those of a method that shows its parts, and of one that does not; neither changes its image."""
    image, reference = fisheye_image(), busy_frame()
    figures = [
        draw_panels(SimpleNamespace(pixels=image, segmentation=segmentation(reference, parts=p), reference=reference))
        for p in (True, False)
    ]
    assert np.array_equal(image, fisheye_image())
    return figures


def test_the_seven_rows_of_the_paper_and_fewer_of_a_method_without_parts(panels):
    constraints = ["(II) epipolar", "(III) positive depth", "(IV) positive height", "(V) anti-parallel"]
    assert [[axes.get_ylabel() for axes in figure.axes] for figure in panels] == [
        ["(I) flow", *constraints, "(VI) likelihood", "(VII) segmentation"],
        ["(I) likelihood", "(II) segmentation"],
    ]


def test_the_likelihood_saturates_at_two_hundredths(panels):
    likelihood, *_ = (a for axes in panels[1].axes for a in axes.get_children() if isinstance(a, AxesImage))
    assert (likelihood.norm.vmin, likelihood.norm.vmax, likelihood.norm(0.5)) == (0.0, 0.02, 1.0)
    assert list(likelihood.get_extent()) == [-0.5, 639.5, 479.5, -0.5], "cells cover the pixels that they tile"


def test_arrows_end_at_the_current_pixel_and_show_the_motion_forward_in_time(panels):
    (arrows,) = [a for axes in panels[0].axes for a in axes.get_children() if isinstance(a, Quiver)]
    below = arrows.V[arrows.Y > 400]  # flow to the previous image points up there, so the motion points down
    assert (below > 0).all()
    assert arrows.pivot == "tip"


def test_objects_are_labelled_off_each_other_inside_the_picture(panels):
    axes = panels[1].axes[-1]
    assert {text.get_text().partition(":")[0] for text in axes.texts} == {t.track_id for t in busy_frame().objects}
    boxes = [text.get_window_extent() for text in axes.texts]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    assert all(axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1 for box in boxes)


def test_a_cluster_from_above_and_its_object_enlarged():
    shown = cluster()
    plan, picture = draw_cluster(**shown).axes
    assert plan.get_xlabel() == "y (m), left of the ego vehicle"
    assert plan.get_xlim()[0] > plan.get_xlim()[1]  # y grows to the left
    assert plan.get_ylim()[0] < plan.get_ylim()[1]  # x grows upwards
    u_min, v_min, u_max, v_max = shown["polygon"].bounds
    (left, right), (bottom, top) = picture.get_xlim(), picture.get_ylim()
    assert left < u_min < u_max < right
    assert top < v_min < v_max < bottom


def test_the_frame_where_an_object_fills_most_pixels_tells_of_its_category():
    rows = [object_row(n) | {"region_px": px} for n, px in enumerate((100, 300, 200))]
    rows.append(object_row(3) | {"region_px": 900, "status": "ignored"})
    assert example_frames([evaluated(objects_table(rows))]) == {Category.CROSSING: ("drive-1", "front", 100)}


def test_every_picture_of_a_frame_stays_in_the_folder_whatever_the_track_is_called(tmp_path):
    strange = replace(busy_frame().objects[0], track_id="../x y")
    reference = reference_frame([strange])
    processed = SimpleNamespace(
        image=SimpleNamespace(moving_path=None),
        pixels=fisheye_image(),
        segmentation=segmentation(reference),
        reference=reference,
    )
    pipeline = Mock()
    pipeline.references.geometry.return_value = cluster()["geometry"]
    pipeline.recording.vehicle_outline_m = cluster()["vehicle_outline_m"]
    files = write_frame_pictures(
        reference, processed.image, pipeline, tmp_path / "pictures", made_by="method own", processed=processed
    )
    names = ["panels.png", "areas.png", "cluster-.._x_y.png"]
    assert [file.name for file in files] == names
    assert sorted(names) == sorted(file.name for file in (tmp_path / "pictures").iterdir())
