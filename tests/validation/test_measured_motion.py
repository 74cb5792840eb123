"""What the lidar says that ego-motion gets wrong is what was changed in it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.recordings.native import open_native
from bench.validation.fits.scan_matching import measured_motion, scan_steps


@pytest.fixture(scope="module")
def drive(clean):
    return open_native(clean)


def errors(drive, steps):
    return np.median(measured_motion(drive, steps).errors, axis=0)


def test_the_speed_of_the_lidar_is_measured(drive):
    trajectory = drive.trajectory
    slower = replace(drive, trajectory=replace(trajectory, positions_m=0.98 * trajectory.positions_m))
    change = errors(slower, scan_steps(drive)) - errors(drive, scan_steps(drive))
    assert change[3] == pytest.approx(0.02, abs=0.005)
    assert np.abs(change[[0, 1, 2, 4, 5]]).max() < 0.003


@pytest.mark.parametrize(("axis", "column", "sign"), [(2, 4, 1.0), (1, 5, -1.0)])
def test_the_way_is_measured_in_the_lidars_axes(drive, axis, column, sign):
    """By a lidar that is stated half a degree to the left, the vehicle slips to the left; downwards, it sinks."""
    stated = drive.vehicle_from_lidar
    rotation = Rotation.from_rotvec(np.radians(0.5) * np.eye(3)[axis]).as_matrix() @ stated.rotation
    turned = replace(drive, vehicle_from_lidar=replace(stated, rotation=rotation))
    change = errors(turned, scan_steps(drive)) - errors(drive, scan_steps(drive))
    assert change[column] == pytest.approx(sign * np.radians(0.5), abs=0.002)


def test_where_the_lidar_cannot_tell_it_says_nothing(drive):
    steps = scan_steps(drive)
    along_a_wall = np.diag([1.0, 1.0, 1.0, 0.0, 1.0, 1.0])
    motion = measured_motion(drive, [replace(step, information=along_a_wall @ step.information) for step in steps])
    assert not motion.at(np.array([step.first_ns for step in steps])).any()
    standing = replace(drive.trajectory, positions_m=0.0 * drive.trajectory.positions_m)
    assert not len(measured_motion(replace(drive, trajectory=standing), steps).middle_ns)
