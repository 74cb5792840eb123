from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

from bench.evaluation.rows import objects_table
from bench.records.reference import Category
from bench.reporting.frame_pictures import draw_cluster, example_frames, write_frame_pictures
from tests.reporting.factories import busy_frame, cluster, fisheye_image, reference_frame, segmentation
from tests.support.result_rows import object_row


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
    names = ["panels.png", "areas.png", "overlay.png", "cluster-.._x_y.png"]
    assert [file.name for file in files] == names
    assert sorted(names) == sorted(file.name for file in (tmp_path / "pictures").iterdir())


def test_both_views_with_the_enlarged_object():
    figure = draw_cluster(**cluster())
    plan, picture = figure.axes
    assert plan.get_xlabel() == "y (m), left of the ego vehicle"
    assert plan.get_xlim()[0] > plan.get_xlim()[1]  # y grows to the left
    assert plan.get_ylim()[0] < plan.get_ylim()[1]  # x grows upwards
    assert len(picture.child_axes) == 1


def test_a_cluster_of_named_points_has_no_outline():
    with_outline, without = (draw_cluster(**cluster(outline=o)).axes[0].patches for o in (True, False))
    assert len(without) == len(with_outline) - 1
