"""The aiMotive adapter: a made-up sequence by hand, and the real sample."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.cameras.model import RollingShutter
from bench.cameras.spheres import UnifiedCamera
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.lidar.sweep import deskew, interpolation_timestamps
from bench.recordings import load_card, open_dataset, read_image
from bench.reference.grid import find_grid
from tests.support import data_sets
from tests.support import tiny_aimotive as tiny
from tests.support.cards import write_card
from tests.support.planting import change_json
from tests.support.real import needs_real


@pytest.fixture
def folder(tmp_path):
    return tiny.write_data_set(tmp_path)


opened = partial(data_sets.opened, "aimotive", **tiny.OPTIONS)


def change_calibration(folder, **sensors):
    change_json(folder / "sensor/calibration/calibration.json", lambda content: content.update(sensors))


def test_camera_and_road(folder, tmp_path):
    camera = opened(tmp_path).cameras[tiny.CAMERA]
    assert camera.model == UnifiedCamera(
        width=64, height=36, xi=1.02, focal=(28.0, 25.0), principal_point=(32.0, 17.5), radial=(0.027, -0.08)
    )
    assert camera.vehicle_from_camera.matrix == pytest.approx(np.array(tiny.BODY_FROM_CAMERA))
    assert camera.road.height_m == pytest.approx(1.5)
    assert camera.ego_body[30:].all()
    assert not camera.ego_body[:30].any()


def test_images_and_sweeps_have_the_times_of_the_boxes(folder, tmp_path):
    recording = opened(tmp_path)
    images = recording.images[tiny.CAMERA]
    assert [image.timestamp_ns for image in images] == [tiny.START_NS + i * tiny.STEP_NS for i in range(3)]
    assert read_image(images[1], recording.cameras[tiny.CAMERA]) == pytest.approx(50, abs=1)
    (reference,) = recording.sweeps
    sweep = reference.read()
    assert sweep.timestamp_ns == tiny.START_NS
    assert sweep.time_offset_ns.tolist() == [-67_894_000, 32_355_000]
    assert sweep.points_lidar == pytest.approx(np.array([[2.0, -3.0, 1.0], [2.5, -3.0, 1.0]]))


def test_velocity_over_the_ground_is_the_egos_plus_the_relative_one(folder, tmp_path):
    (track,) = opened(tmp_path).tracks
    assert (track.track_id, track.object_class, len(track.states)) == ("1", "vehicle", 3)
    for state in track.states:
        assert state.velocity_mps == pytest.approx([24.0, 0.25, 0.0])
        assert state.yaw_rate_radps == pytest.approx(tiny.TURN_RADPS)
    assert track.states[0].shape.size_m.tolist() == [5.0, 2.0, 2.2]
    assert track.states[0].shape.vehicle_from_object.translation_m.tolist() == [2.0, -4.0, 1.0]


def test_field_of_view_size_and_rolling_shutter_come_from_the_card(folder, tmp_path):
    shutter = {"readout_s": 0.02, "direction": "left"}
    options = {"field_of_view_deg": {tiny.CAMERA: 180}, "rolling_shutter": {tiny.CAMERA: shutter}}
    recording = opened(tmp_path, evaluated_size_px=[32, 18], **options)
    camera = recording.cameras[tiny.CAMERA]
    assert camera.rolling_shutter == RollingShutter(**shutter)
    assert (camera.model.width, camera.model.height) == (32, 18)
    assert camera.stored_size_px == (64, 36)
    assert camera.model.limit_angle_rad == pytest.approx(np.pi / 2)
    assert camera.ego_body[15:].all()
    assert read_image(recording.images[tiny.CAMERA][2], camera).shape == (18, 32)


def test_an_object_twice_in_a_frame_and_an_image_without_boxes(folder, tmp_path):
    change_json(tiny.box_file(folder, 1), lambda content: content["CapturedObjects"].append(tiny.box(0)))
    with pytest.raises(DataError, match=r"0000101\.json: CapturedObjects\.1\.ObjectId: expected each object once"):
        opened(tmp_path)
    change_json(tiny.box_file(folder, 1), lambda content: content["CapturedObjects"].pop())
    tiny.box_file(folder, 2).unlink()
    with pytest.raises(DataError, match=r"M_FISHEYE_R_0000102\.jpg: expected dynamic/box/3d_body/frame_0000102\.json"):
        opened(tmp_path)


def test_two_sequences_of_one_name_are_refused(folder, tmp_path):
    (tmp_path / "data/val/daytime" / folder.name).mkdir(parents=True)
    card = write_card(tmp_path, adapter="aimotive", root=".", options=tiny.OPTIONS)
    with pytest.raises(DataError, match="expected recordings of different names, got '20260101-000000-tiny@Car' twice"):
        open_dataset(load_card(card))


def test_ego_motion_stays_inside_the_data_set(folder, tmp_path):
    with pytest.raises(DataError, match=r"options\.ego_motion\.file: expected a relative path without '\.\.'"):
        opened(tmp_path, ego_motion={"file": "../speed.csv"})


# A place in the Black Forest, and the axes east, north and up there.
LATITUDE_DEG, LONGITUDE_DEG, ECCENTRICITY_SQUARED = 48.0, 8.0, 0.00669437999014
EARTH_FROM_LOCAL = Rotation.from_euler("ZX", [90 + LONGITUDE_DEG, 90 - LATITUDE_DEG], degrees=True).as_matrix()
EAST, NORTH, UP = EARTH_FROM_LOCAL.T
NORMAL_RADIUS_M = 6_378_137.0 / np.sqrt(1.0 - ECCENTRICITY_SQUARED * UP[2] ** 2)
PLACE_M = NORMAL_RADIUS_M * np.array([1.0, 1.0, 1.0 - ECCENTRICITY_SQUARED]) * UP


def egomotion(frame):
    """Northwards at 30 m/s on level ground."""
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([NORTH, -EAST, UP])
    pose[:3, 3] = PLACE_M + NORTH * tiny.EGO_MPS * frame * tiny.STEP_NS / 1e9
    return {"RT_ECEF_body": pose.tolist(), "time_host": "unused"}


@pytest.fixture
def own_odometry(folder):
    file = folder / "sensor/gnssins/egomotion.json"
    file.parent.mkdir(parents=True)
    file.write_text(json.dumps({str(tiny.FIRST_FRAME + n): egomotion(n) for n in range(-1, 3)}))
    return file


def test_the_data_sets_own_odometry(own_odometry, tmp_path):
    recording = opened(tmp_path, ego_motion=None)
    trajectory = recording.trajectory
    assert trajectory.timestamps_ns.tolist() == [tiny.START_NS + n * tiny.STEP_NS for n in range(3)]
    for n in range(3):
        time_ns = tiny.START_NS + n * tiny.STEP_NS
        pose = trajectory.world_from_vehicle(time_ns)
        assert pose.rotation[:, 2] == pytest.approx([0, 0, 1], abs=1e-6)  # upright, though the earth is round
        assert pose.translation_m[2] == pytest.approx(0, abs=1e-4)
        assert trajectory.velocity_vehicle_mps(time_ns) == pytest.approx([tiny.EGO_MPS, 0, 0], abs=1e-4)
    (track,) = recording.tracks
    assert track.states[0].velocity_mps == pytest.approx([24.0, 0.25, 0.0], abs=1e-4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2]", "expected an object, got [1, 2]"),
        ('{"1": {}, "../x": {}}', "expected poses of two frames at least, of those from 100 to 102, got 0"),
        ('{"100": {}}', "100.RT_ECEF_body: expected a value, got nothing"),
        (f'{{"100": {{"RT_ECEF_body": {[[2, 0, 0, 0]] * 4}}}}}', "100.RT_ECEF_body: expected a rotation without scale"),
    ],
    ids=range(4),
)
def test_faults_of_the_odometry(own_odometry, tmp_path, text, message):
    own_odometry.write_text(text)
    with pytest.raises(DataError) as caught:
        opened(tmp_path, ego_motion=None)
    assert "egomotion.json: " in str(caught.value)
    assert message in str(caught.value)


def test_without_a_choice_every_fisheye_camera_of_a_sequence_is_evaluated(folder, tmp_path):
    change_calibration(folder, F_MIDLONGRANGECAM_CL=tiny.calibration()[tiny.CAMERA] | {"model": "opencv_pinhole"})
    (folder / "sensor/camera/F_MIDLONGRANGECAM_CL").mkdir()
    assert set(opened(tmp_path, cameras=None).cameras) == {tiny.CAMERA}


# The points are in body axes; the mounting of the one lidar tells where the beams start.

MOUNTING = RigidTransform.from_yaw(1.5, (1.2, 0.1, 1.7))


def lidar(matrix=MOUNTING.matrix):
    return {"sensor_type": "lidar", "RT_body_from_sensor": np.asarray(matrix).tolist()}


ORIGIN = np.eye(4)
LIDARS = [
    ({"M_LIDAR_M": lidar()}, MOUNTING.matrix),
    ({}, ORIGIN),
    ({"LEFT": lidar(), "RIGHT": lidar()}, ORIGIN),
    ({"M_LIDAR_M": [1, 2]}, ORIGIN),
]


@pytest.mark.parametrize(("sensors", "beams"), LIDARS)
def test_beams_start_at_the_one_lidar_and_points_stay_where_they_are(folder, tmp_path, sensors, beams):
    change_calibration(folder, **sensors)
    recording = opened(tmp_path)
    assert recording.lidar_from_sensor.matrix == pytest.approx(beams)
    assert np.array_equal(recording.vehicle_from_lidar.matrix, ORIGIN)


@pytest.mark.parametrize(("matrix", "field"), [(2 * ORIGIN, ".RT_body_from_sensor"), (np.eye(3), ""), ("here", "")])
def test_a_mounting_that_is_none_is_refused(folder, tmp_path, matrix, field):
    change_calibration(folder, M_LIDAR_M=lidar(matrix))
    with pytest.raises(DataError, match=f"M_LIDAR_M{field}"):
        opened(tmp_path)


@pytest.fixture
def real():
    (handle,) = open_dataset(load_card(Path(__file__).parents[2] / "datasets/aimotive-sample.yaml"))
    return handle.open()


@needs_real
def test_the_real_sample_opens(real):
    camera = real.cameras["M_FISHEYE_R"]
    images = real.images["M_FISHEYE_R"]
    assert (len(images), len(real.sweeps), len(real.tracks)) == (50, 16, 8)
    assert np.diff([image.timestamp_ns for image in images]) == pytest.approx(66.67e6, abs=0.05e6)
    assert read_image(images[0], camera).shape == (352, 640)
    assert camera.road.height_m == pytest.approx(1.414 + 0.04, abs=0.001)
    assert {track.object_class for track in real.tracks} == {"vehicle"}
    # The van is passed at 6 m/s.
    van = next(track for track in real.tracks if track.track_id == "1")
    velocities_mps = np.array([state.velocity_mps for state in van.states])
    assert velocities_mps == pytest.approx(np.tile([23.8, 0, 0], (50, 1)), abs=0.5)


@needs_real
@pytest.mark.parametrize("index", range(0, 8, 3))
def test_points_moved_to_the_exposure_fill_the_vans_box(real, index):
    """The van is 5.3 m long; uncorrected, its points would lie up to 1.6 m ahead of or behind the box."""
    sweep = real.sweeps[index].read()
    assert -70e6 < sweep.time_offset_ns.min() < -66e6
    assert 31e6 < sweep.time_offset_ns.max() < 34e6
    van = next(track for track in real.tracks if track.track_id == "1")
    state = next(state for state in van.states if state.timestamp_ns == sweep.timestamp_ns)
    interpolation_ns = interpolation_timestamps(sweep.times_ns)
    rotations, positions_m, _ = real.trajectory.at(interpolation_ns)
    now = real.trajectory.world_from_vehicle(sweep.timestamp_ns)
    poses = {"interpolation_ns": interpolation_ns, "rotations": rotations, "positions_m": positions_m}
    points_world = deskew(sweep.points_lidar, sweep.times_ns, **poses)
    age_s = sweep.time_offset_ns / 1e9
    moved = now.inverse().apply(points_world - age_s[:, None] * now.rotate(state.velocity_mps))
    points_object = state.shape.vehicle_from_object.inverse().apply(moved)
    half_m = state.shape.size_m / 2
    x, y, z = points_object.T
    # The flank, above the sill and well inside the neighbouring lane.
    near = (np.abs(y) < half_m[1]) & (z > 0.4 - half_m[2]) & (z < half_m[2]) & (np.abs(x) < 8.0)
    inside = np.abs(points_object[near][:, 0]) < half_m[0] + 0.1
    assert near.sum() > 5000
    assert inside.mean() > 0.99


@needs_real
def test_the_rows_of_beams_on_the_real_van_are_found(real):
    """One return in four had no neighbour beside it while directions were taken from the body's origin."""
    sweep = real.sweeps[1].read()
    points = sweep.points_lidar.astype(np.float64)
    x, y, z = points.T
    van = points[(np.abs(x - 2.0) < 2.0) & (y < -2.5) & (y > -5.0) & (z > 0.3)]
    linked = {
        name: np.mean(find_grid(seen).neighbours[0] >= 0)
        for name, seen in {"beams": real.lidar_from_sensor.inverse().apply(van), "body": van}.items()
    }
    assert linked["beams"] > 0.95
    assert linked["body"] < 0.85
