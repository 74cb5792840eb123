"""The adapter of KITTI's raw drives: a miniature with known truth, and the real tracklets."""

from functools import partial

import numpy as np
import pytest

from bench.adapters.kitti_raw import CLASSES, read_tracklets
from bench.errors import DataError
from bench.evaluation.protocol import load_protocol
from bench.records.recording import COMPLETELY, NOT_ANNOTATED
from bench.reference.build import ReferenceBuilder
from tests.support import data_sets
from tests.support import tiny_kitti_raw as tiny
from tests.support.real import REAL, needs_real


@pytest.fixture
def root(tmp_path):
    return tiny.write_data_set(tmp_path / "kitti")


opened = partial(data_sets.opened, "kitti-raw")


def test_sensors_stand_where_the_calibration_puts_them_and_each_has_its_own_times(root):
    recording = opened(root)
    camera = recording.cameras["image_02"]
    assert recording.vehicle_from_lidar.translation_m == pytest.approx(tiny.LIDAR_M)
    assert camera.vehicle_from_camera.translation_m == pytest.approx(tiny.CAMERA_M)
    assert camera.vehicle_from_camera.rotation @ [0, 0, 1] == pytest.approx([1, 0, 0])  # looks ahead
    assert (camera.model.focal, camera.model.principal_point) == ((72.0, 72.0), tiny.CENTRE_PX)
    assert (camera.model.width, camera.model.height) == (tiny.WIDTH, tiny.HEIGHT)

    assert [image.timestamp_ns for image in recording.images["image_02"]] == [tiny.time_ns(n) for n in range(8)]
    later = [tiny.time_ns(n, tiny.SCAN_LATER_NS) for n in range(8)]
    assert [sweep.timestamp_ns for sweep in recording.sweeps] == later
    assert recording.frame_interval_ns == tiny.PERIOD_NS


def test_the_vehicle_goes_where_latitude_and_longitude_say(root):
    recording = opened(root)
    times_ns = np.array([tiny.time_ns(n) for n in range(tiny.FRAMES)])
    rotations, positions_m, valid = recording.trajectory.at(times_ns)
    assert valid.all()
    assert positions_m == pytest.approx(np.array([tiny.ego_m(int(time)) for time in times_ns]), abs=1e-4)
    assert rotations[3] == pytest.approx(tiny.rotation_z(tiny.HEADING_RAD))


def test_boxes_and_how_they_move(root):
    car, van = opened(root).tracks
    assert (car.track_id, car.object_class, van.track_id, van.object_class) == ("Car 1", "vehicle", "Van 1", "vehicle")
    assert len(car.states) == tiny.FRAMES - 1
    state = car.states[3]
    assert state.timestamp_ns == tiny.time_ns(4, tiny.SCAN_LATER_NS)
    assert state.shape.vehicle_from_object.translation_m == pytest.approx(tiny.car_in_vehicle_m(state.timestamp_ns))
    assert state.shape.size_m == pytest.approx(tiny.CAR_SIZE_M)
    assert state.velocity_mps == pytest.approx([tiny.CAR_MPS, 0, 0], abs=1e-3)
    assert van.states[3].velocity_mps == pytest.approx([0, 0, 0], abs=1e-3)


def test_points_have_their_times_by_a_scanner_that_turns_to_the_left(root):
    recording = opened(root)
    image = recording.images["image_02"][4]
    builder = ReferenceBuilder(recording, "image_02", load_protocol("paper-v1").reference)
    car = tiny.car_in_vehicle_m(image.timestamp_ns) + tiny.surface()
    assert builder.geometry("Car 1", image).cluster_vehicle == pytest.approx(car, abs=0.005)  # else up to 7 cm off
    sweep = recording.sweeps[4].read()
    left = sweep.points_lidar[:, 1] > 0
    assert (sweep.time_offset_ns[left] > 0).all()
    assert (sweep.time_offset_ns[~left] <= 0).all()


def test_a_drive_without_tracklets_is_not_annotated_and_one_without_images_says_which_it_looked_for(root):
    assert opened(root).annotated == COMPLETELY
    (root / tiny.DATE / tiny.DRIVE / "tracklet_labels.xml").unlink()
    recording = opened(root)
    assert (recording.annotated, recording.tracks) == (NOT_ANNOTATED, ())
    with pytest.raises(DataError, match=r"expected images of image_03, got none"):
        opened(root, cameras=["image_03"])


@needs_real
def test_real_tracklets():
    (file,) = (REAL / "kitti_raw").rglob("tracklet_labels.xml")
    tracklets = read_tracklets(file)
    assert len(tracklets) == 15
    assert {tracklet.label for tracklet in tracklets} <= set(CLASSES)
