"""Where the lidar of an aiMotive sequence sits, which its points in body axes no longer tell."""

import json

import numpy as np
import pytest

from bench.adapters.aimotive.adapter import aimotive_recordings
from bench.adapters.aimotive.calibration import read_lidar_mounting
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.reference.grid import find_grid
from tests.support import tiny_aimotive as tiny
from tests.support.real import needs_real

MOUNTING = RigidTransform.from_yaw(1.5, (1.2, 0.1, 1.7))


def lidar(matrix=MOUNTING.matrix):
    return {"sensor_type": "lidar", "RT_body_from_sensor": np.asarray(matrix).tolist()}


@pytest.fixture
def handle(tmp_path):
    """A made-up sequence, and a function that adds sensors to its calibration."""
    folder = tiny.write_data_set(tmp_path)

    def with_sensors(**sensors):
        file = folder / "sensor/calibration/calibration.json"
        file.write_text(json.dumps(tiny.calibration() | sensors))
        (found,) = aimotive_recordings(tmp_path, options=tiny.OPTIONS, card=tmp_path / "card.yaml", annotations=None)
        return found

    return with_sensors


def test_beams_start_at_the_one_lidar_and_points_stay_where_they_are(handle):
    recording = handle(M_LIDAR_M=lidar()).open()
    assert recording.lidar_from_sensor.matrix == pytest.approx(MOUNTING.matrix)
    assert np.array_equal(recording.vehicle_from_lidar.matrix, np.eye(4))


@pytest.mark.parametrize("sensors", [{}, {"LEFT": lidar(), "RIGHT": lidar()}, {"M_LIDAR_M": [1, 2]}])
def test_without_one_lidar_beams_start_at_the_origin(handle, sensors):
    assert np.array_equal(handle(**sensors).open().lidar_from_sensor.matrix, np.eye(4))


@pytest.mark.parametrize(
    ("matrix", "field"),
    [(2 * np.eye(4), "M_LIDAR_M.RT_body_from_sensor"), (np.eye(3), "M_LIDAR_M"), ("here", "M_LIDAR_M")],
)
def test_a_mounting_that_is_none_is_refused(handle, matrix, field):
    with pytest.raises(DataError, match=field):
        handle(M_LIDAR_M=lidar(matrix)).open()


def test_a_calibration_that_is_none_is_refused(handle, tmp_path):
    handle()
    (file,) = tmp_path.rglob("calibration.json")
    file.write_text("[]")
    with pytest.raises(DataError, match="expected calibrations by sensor name, got list"):
        read_lidar_mounting(tmp_path, file.parents[2])


@needs_real
def test_the_rows_of_beams_on_the_real_van_are_found(real):
    """One return in four had no neighbour beside it while directions were taken from the body's origin."""
    sweep = real.sweeps[1].read()
    points = sweep.points_lidar.astype(np.float64)
    van = points[
        (np.abs(points[:, 0] - 2.0) < 2.0) & (points[:, 1] < -2.5) & (points[:, 1] > -5.0) & (points[:, 2] > 0.3)
    ]
    linked = {
        name: np.mean(find_grid(seen).neighbours[0] >= 0)
        for name, seen in {"beams": real.lidar_from_sensor.inverse().apply(van), "body": van}.items()
    }
    assert linked["beams"] > 0.95
    assert linked["body"] < 0.85
