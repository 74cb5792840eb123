"""Mistakes of the lidar's mounting, odometry and their clocks, planted into a small drive: each is named."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.geometry import RigidTransform
from bench.recordings import RecordingWriter
from bench.recordings.native import open_native
from bench.validation.findings import Finding, Undecided
from bench.validation.fits.readings import mounting_name
from bench.validation.fits.scan_matching import measured_motion, scan_steps
from bench.validation.fits.static_world import check_static_world, road_plane
from tests.support import drive
from tests.support.planting import change_bus, change_head, change_sweeps
from tests.support.tiny import VEHICLE_FROM_LIDAR
from tests.support.worlds import FORWARD


def told(root):
    return [one for one in check_static_world(open_native(root)) if isinstance(one, Finding)]


def test_sweeps_alone_measure_the_motion_whatever_ego_motion_says(root):
    change_bus(root, lambda row: row.update(speed_mps="1.0", yaw_rate_radps="-0.5"))
    steps = scan_steps(open_native(root))
    assert len(steps) == drive.SWEEPS - 1
    for step in steps:
        assert step.turn_rad[2] == pytest.approx(0.1 * drive.TURN_RADPS, abs=1e-3)
        sideways_m = 0.1 * drive.TURN_RADPS * VEHICLE_FROM_LIDAR.translation_m[0]
        path_vehicle = VEHICLE_FROM_LIDAR.rotate(step.path_m)
        assert path_vehicle[:2] == pytest.approx([0.1 * drive.SPEED_MPS, sideways_m], abs=0.02)


def test_the_inverse_of_a_turned_mounting(root):
    """The axes of the points lie 90 degrees to the left, the calibration gives them to the right."""
    axes = np.float32([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    change_sweeps(root, lambda sweep: replace(sweep, points_lidar=sweep.points_lidar @ axes.T))
    to_the_right = [0.5**0.5, 0.0, 0.0, -(0.5**0.5)]
    change_head(root, lambda head: head["lidar"]["vehicle_from_lidar"].update(quaternion_wxyz=to_the_right))
    (found,) = told(root)
    assert "the inverse of vehicle_from_lidar" in found.got


def with_poses(root, change):
    """The drive's own path as a file of poses, written by somebody who makes a mistake."""
    path = open_native(root).trajectory
    (root / "egomotion.csv").unlink()
    rotations, positions_m = change(path.rotations, path.positions_m)
    RecordingWriter(root).poses(path.timestamps_ns, rotations, positions_m)
    return root


def right_handed(rotations):
    flip = np.diag([1.0, -1.0, 1.0])
    return Rotation.from_matrix(flip @ rotations.as_matrix() @ flip)


MISREAD = {
    "quaternions w, x, y, z read as x, y, z, w": lambda r, p: (Rotation.from_quat(np.roll(r.as_quat(), 1, axis=1)), p),
    "vehicle_from_world, the inverse": lambda r, p: (r.inv(), -r.inv().apply(p)),
    "poses of left-handed axes, y to the right": lambda r, p: (right_handed(r), p * [1, -1, 1]),
    "positions with y to the right": lambda r, p: (r, p * [1, -1, 1]),
    "rotations to the right": lambda r, p: (right_handed(r), p),
    "poses of a camera's axes, z forward": lambda r, p: (
        Rotation.from_matrix(FORWARD @ r.as_matrix() @ FORWARD.T),
        p @ FORWARD.T,
    ),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name.endswith("z, w") else pytest.mark.slow) for name in MISREAD]
)
def test_poses_that_were_misread(root, name):
    (found,) = told(with_poses(root, MISREAD[name]))
    assert (found.check, found.field, found.file) == ("ego-motion-unit", "poses", str(root / "poses.csv"))
    assert f"if this is {name}" in found.got
    assert float(found.got.split(";")[1].split()[0]) < 3.0


def test_a_clean_drive_says_only_what_it_cannot_tell(root):
    """Constant speed and yaw rate are the same at any time."""
    undecided = list(check_static_world(open_native(root)))
    assert all(isinstance(one, Undecided) for one in undecided)
    assert "clock of lidar sweeps against ego-motion" in {one.about for one in undecided}
    assert told(with_poses(root, lambda r, p: (r, p))) == []  # poses that are right


def test_the_side_of_a_bus_beside_a_vehicle_that_stands_is_no_road(root):
    along_m, height_m = np.meshgrid(np.arange(-9.0, 9.0, 0.1), np.arange(-1.5, 1.5, 0.05))
    side = np.column_stack([along_m.ravel(), np.full(along_m.size, 1.5), height_m.ravel()]).astype(np.float32)
    first = open_native(root).sweeps[0].read().points_lidar
    seen = np.concatenate([first, side])
    seen = seen[seen[:, 1] < 1.6]
    change_sweeps(root, lambda sweep: drive.as_at_once(sweep.timestamp_ns, seen))
    change_bus(root, lambda row: row.update(speed_mps="0.0", yaw_rate_radps="0.0"))
    recording = open_native(root)
    wall = road_plane([recording.sweeps[0].read()], np.zeros(3))
    assert abs(wall[0][1]) > 0.99, "it has more returns than the road"
    assert not any("a road that is not below" in one.got for one in told(root))


def test_a_drive_without_sweeps_that_meet_says_why(root):
    recording = open_native(root)
    few = "0 of 4 sweeps follow another by 0.03 to 0.35 s, at least 6 are needed"
    for sweeps, why in ((recording.sweeps[::4], few), ((), "no lidar sweeps")):
        (undecided,) = check_static_world(replace(recording, sweeps=sweeps))
        assert undecided.why == why


@pytest.mark.parametrize(
    ("stated_deg", "fitted_deg", "name"),
    [
        (0.0, 0.5 * 180 / np.pi, "the lidar turned by +28.6 degrees about the vehicle's z"),
        (5.0, 0.0, "the lidar turned by -5.0 degrees about the vehicle's z"),  # its inverse is as far from the truth
        (5.0, -5.0, "the inverse of vehicle_from_lidar"),
    ],
)
def test_a_mounting_has_a_name(stated_deg, fitted_deg, name):
    stated, fitted = (RigidTransform.from_yaw(np.radians(yaw_deg)).rotation for yaw_deg in (stated_deg, fitted_deg))
    assert mounting_name(stated, fitted) == name


@pytest.fixture(scope="module")
def street(clean):
    return open_native(clean)


def errors(street, steps):
    return np.median(measured_motion(street, steps).errors, axis=0)


def test_the_speed_of_the_lidar_is_measured(street):
    trajectory = street.trajectory
    slower = replace(street, trajectory=replace(trajectory, positions_m=0.98 * trajectory.positions_m))
    change = errors(slower, scan_steps(street)) - errors(street, scan_steps(street))
    assert change[3] == pytest.approx(0.02, abs=0.005)
    assert np.abs(change[[0, 1, 2, 4, 5]]).max() < 0.003


@pytest.mark.parametrize(("axis", "column", "sign"), [(2, 4, 1.0), (1, 5, -1.0)])
def test_the_way_is_measured_in_the_lidars_axes(street, axis, column, sign):
    """By a lidar that is stated half a degree to the left, the vehicle slips to the left; downwards, it sinks."""
    stated = street.vehicle_from_lidar
    rotation = Rotation.from_rotvec(np.radians(0.5) * np.eye(3)[axis]).as_matrix() @ stated.rotation
    turned = replace(street, vehicle_from_lidar=replace(stated, rotation=rotation))
    change = errors(turned, scan_steps(street)) - errors(street, scan_steps(street))
    assert change[column] == pytest.approx(sign * np.radians(0.5), abs=0.002)


def test_where_the_lidar_cannot_tell_it_says_nothing(street):
    steps = scan_steps(street)
    along_a_wall = np.diag([1.0, 1.0, 1.0, 0.0, 1.0, 1.0])
    motion = measured_motion(street, [replace(step, information=along_a_wall @ step.information) for step in steps])
    assert not motion.at(np.array([step.first_ns for step in steps])).any()
    standing = replace(street.trajectory, positions_m=0.0 * street.trajectory.positions_m)
    assert not len(measured_motion(replace(street, trajectory=standing), steps).middle_ns)
