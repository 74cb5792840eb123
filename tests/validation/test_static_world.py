"""Mistakes of the lidar's mounting, odometry and their clocks, planted into a small drive: each is named."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.geometry import RigidTransform
from bench.recordings import RecordingWriter
from bench.recordings.native import open_native
from bench.validation.findings import Finding, Undecided
from bench.validation.fits.readings import mounting_name
from bench.validation.fits.scan_matching import scan_steps
from bench.validation.fits.static_world import check_static_world, road_plane
from tests.support.planting import change_bus, change_head, change_sweeps, shift_times
from tests.support.tiny import VEHICLE_FROM_LIDAR
from tests.validation import drive


def told(root):
    return [one for one in check_static_world(open_native(root)) if isinstance(one, Finding)]


def with_axes(root, matrix):
    axes = np.array(matrix, dtype=np.float32)
    change_sweeps(root, lambda sweep: replace(sweep, points_lidar=sweep.points_lidar @ axes.T))


def test_sweeps_alone_measure_the_motion_whatever_ego_motion_says(root):
    change_bus(root, lambda row: row.update(speed_mps="1.0", yaw_rate_radps="-0.5"))
    steps = scan_steps(open_native(root))
    assert len(steps) == drive.SWEEPS - 1
    for step in steps:
        assert step.turn_rad[2] == pytest.approx(0.1 * drive.TURN_RADPS, abs=1e-3)
        sideways_m = 0.1 * drive.TURN_RADPS * VEHICLE_FROM_LIDAR.translation_m[0]
        path_vehicle = VEHICLE_FROM_LIDAR.rotate(step.path_m)
        assert path_vehicle[:2] == pytest.approx([0.1 * drive.SPEED_MPS, sideways_m], abs=0.02)


@pytest.mark.parametrize(
    ("axes", "name"),
    [
        (np.diag([-1, 1, 1]), "x reversed: the points are mirrored"),
        pytest.param(np.diag([1, -1, 1]), "y reversed: the points are mirrored", marks=pytest.mark.slow),
        pytest.param(np.diag([1, 1, -1]), "z reversed: the points are mirrored", marks=pytest.mark.slow),
        (np.diag([-1, -1, 1]), "x and y reversed: the lidar turned by 180 degrees"),
        pytest.param(
            [[0, 1, 0], [1, 0, 0], [0, 0, 1]], "x and y swapped: the points are mirrored", marks=pytest.mark.slow
        ),
        ([[0, 1, 0], [0, 0, 1], [1, 0, 0]], "the points' axes permuted: x, y, z are the file's z, x, y"),
    ],
)
def test_axes_of_the_points(root, axes, name):
    with_axes(root, axes)
    (found,) = told(root)
    assert found.check == "lidar-pose"
    assert name in found.got
    assert found.file.endswith("recording.json")


def test_a_lidar_turned_by_5_degrees(root):
    cosine, sine = np.cos(np.radians(5)), np.sin(np.radians(5))
    with_axes(root, [[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])  # as a lidar that sits 5 degrees further left
    (found,) = told(root)
    assert found.check == "lidar-pose"
    assert float(re.search(r"turned by (\S+) degrees", found.got)[1]) == pytest.approx(5.0, abs=0.5)


def test_the_inverse_of_a_turned_mounting(root):
    """The axes of the points lie 90 degrees to the left, the calibration gives them to the right."""
    with_axes(root, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    half = float(np.sqrt(0.5))

    def turn(head):
        head["lidar"]["vehicle_from_lidar"]["quaternion_wxyz"] = [half, 0.0, 0.0, -half]

    change_head(root, turn)
    (found,) = told(root)
    assert "the inverse of vehicle_from_lidar" in found.got


def test_speed_5_percent_too_high(root):
    change_bus(root, lambda row: row.update(speed_mps=str(1.05 * drive.SPEED_MPS)))
    (found,) = told(root)
    assert (found.check, found.field) == ("ego-motion-scale", "scale of the speed")
    assert float(found.got.split()[0]) == pytest.approx(100 / 1.05 - 100, abs=1.0)


@pytest.fixture(scope="module")
def winding(tmp_path_factory):
    """A drive that brakes and turns in and out."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drive, "trajectory", drive.winding_path)
        root = drive.write_drive(tmp_path_factory.mktemp("winding") / "drive")
    signals = drive.winding_signals()
    RecordingWriter(root).bus_signals(**signals, gear=["D"] * len(signals["speed_mps"]))
    return root


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


OPTICAL_FROM_VEHICLE = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
MISREAD = {
    "quaternions w, x, y, z read as x, y, z, w": lambda r, p: (Rotation.from_quat(np.roll(r.as_quat(), 1, axis=1)), p),
    "vehicle_from_world, the inverse": lambda r, p: (r.inv(), -r.inv().apply(p)),
    "poses of left-handed axes, y to the right": lambda r, p: (right_handed(r), p * [1, -1, 1]),
    "positions with y to the right": lambda r, p: (r, p * [1, -1, 1]),
    "rotations to the right": lambda r, p: (right_handed(r), p),
    "poses of a camera's axes, z forward": lambda r, p: (
        Rotation.from_matrix(OPTICAL_FROM_VEHICLE @ r.as_matrix() @ OPTICAL_FROM_VEHICLE.T),
        p @ OPTICAL_FROM_VEHICLE.T,
    ),
}


ALWAYS_RUN = {"quaternions w, x, y, z read as x, y, z, w", "poses of left-handed axes, y to the right"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in ALWAYS_RUN else pytest.mark.slow) for name in MISREAD]
)
def test_poses_that_were_misread(root, name):
    (found,) = told(with_poses(root, MISREAD[name]))
    assert (found.check, found.field, found.file) == ("ego-motion-unit", "poses", str(root / "poses.csv"))
    assert f"if this is {name}" in found.got
    assert float(found.got.split(";")[1].split()[0]) < 3.0


def test_poses_that_are_right_are_no_finding(root):
    assert told(with_poses(root, lambda r, p: (r, p))) == []


@pytest.mark.parametrize("late_ms", [-50, 10, *(pytest.param(ms, marks=pytest.mark.slow) for ms in (-10, 50))])
def test_odometry_on_another_clock(winding, tmp_path, late_ms):
    root = shutil.copytree(winding, tmp_path / "drive")
    change_bus(root, lambda row: row.update(timestamp_ns=str(int(row["timestamp_ns"]) + late_ms * 1_000_000)))
    (found,) = told(root)
    assert (found.check, found.file) == ("clock-offset", str(root / "egomotion.csv"))
    assert float(found.got.split()[0]) == pytest.approx(-late_ms, abs=5.0)  # sweeps against ego-motion
    assert (
        f"the ego-motion is {abs(float(found.got.split()[0])):.0f} ms {'late' if late_ms > 0 else 'early'}"
        in found.hint
    )


def test_sweeps_on_another_clock(winding, tmp_path):
    root = shutil.copytree(winding, tmp_path / "drive")
    shift_times(root / "lidar", 50_000_000)
    (found,) = told(root)
    assert (found.check, found.file) == ("clock-offset", str(root / "lidar"))
    assert "late: subtract it from their times" in found.hint


def test_a_clean_drive_says_only_what_it_cannot_tell(root):
    """Constant speed and yaw rate are the same at any time."""
    undecided = list(check_static_world(open_native(root)))
    assert all(isinstance(one, Undecided) for one in undecided)
    assert "clock of lidar sweeps against ego-motion" in {one.about for one in undecided}


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


def test_sweeps_that_are_too_far_apart_say_so(root):
    recording = open_native(root)
    (undecided,) = check_static_world(replace(recording, sweeps=recording.sweeps[::4]))
    assert undecided.why == "0 of 4 sweeps follow another by 0.03 to 0.35 s, at least 6 are needed"


def test_a_drive_without_sweeps_says_so(root):
    for path in (root / "lidar").iterdir():
        path.unlink()
    (undecided,) = check_static_world(replace(open_native(root), sweeps=()))
    assert undecided.why == "no lidar sweeps"


def test_a_mirrored_and_turned_mounting_has_a_name():
    turned = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
    assert mounting_name(np.eye(3), turned) == "the lidar turned by +28.6 degrees about the vehicle's z"


def test_a_small_turn_is_no_inverse():
    stated = RigidTransform.from_yaw(np.radians(5.0)).rotation  # whose inverse is as far from the truth
    assert mounting_name(stated, np.eye(3)) == "the lidar turned by -5.0 degrees about the vehicle's z"
    assert mounting_name(stated, stated.T) == "the inverse of vehicle_from_lidar"
