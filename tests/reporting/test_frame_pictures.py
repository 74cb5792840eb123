"""The files of a frame, and the frames that show a run."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

from bench.evaluation.rows import objects_table
from bench.records.reference import Category
from bench.reporting.frame_pictures import example_frames, write_frame_pictures
from tests.reporting.factories import busy_frame, cluster, fisheye_image, reference_frame, segmentation
from tests.support.result_rows import object_row


def test_the_frame_where_an_object_fills_most_pixels_tells_of_its_category():
    rows = [object_row(n) | {"region_px": px} for n, px in enumerate((100, 300, 200))]
    rows.append(object_row(3) | {"region_px": 900, "status": "ignored"})
    assert example_frames(objects_table(rows)) == {Category.CROSSING: ("drive-1", "front", 100)}


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
    files = write_frame_pictures(processed, pipeline, tmp_path / "pictures", made_by="method own, protocol paper-v1")
    names = ["panels.png", "areas.png", "cluster-.._x_y.png"]
    assert [file.name for file in files] == names
    assert sorted(names) == sorted(file.name for file in (tmp_path / "pictures").iterdir())
