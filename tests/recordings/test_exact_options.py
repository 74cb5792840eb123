"""The card's options that read the exact truth of a synthetic recording instead of what its car reports."""

from dataclasses import replace

import numpy as np
import pytest

from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings import RecordingWriter, open_native
from tests.support import tiny

OFF = RigidTransform.from_yaw(0.01, (0.003, -0.002, 0.001))


@pytest.fixture
def truthful(root):
    """The tiny recording, whose camera and lidar sit a little off."""
    camera = tiny.front_camera()
    writer = RecordingWriter(root)
    moved = replace(camera, vehicle_from_camera=OFF @ tiny.FRONT)
    writer.true_calibration(cameras={"front": moved}, vehicle_from_lidar=OFF @ tiny.VEHICLE_FROM_LIDAR)
    (root / "egomotion.csv").write_text(
        (root / "egomotion.csv").read_text().replace(",3.0,", ",2.7,"), encoding="utf-8"
    )
    return root


def test_recorded_is_what_is_read_without_options(truthful):
    recording = open_native(truthful)
    assert recording.cameras["front"].vehicle_from_camera.matrix == pytest.approx(tiny.FRONT.matrix, abs=1e-12)
    assert recording.vehicle_from_lidar.matrix == pytest.approx(tiny.VEHICLE_FROM_LIDAR.matrix, abs=1e-12)
    assert recording.trajectory.positions_m[-1, 0] == pytest.approx(0.36)


def test_each_option_changes_its_own_part(truthful):
    motion = open_native(truthful, ego_motion="exact")
    assert motion.trajectory.positions_m[-1].tolist() == [0.4, 0.0, 0.0]
    assert motion.cameras["front"].vehicle_from_camera.matrix == pytest.approx(tiny.FRONT.matrix, abs=1e-12)
    mounting = open_native(truthful, calibration="exact")
    assert mounting.trajectory.positions_m[-1, 0] == pytest.approx(0.36)
    camera = mounting.cameras["front"]
    assert camera.vehicle_from_camera.matrix == pytest.approx((OFF @ tiny.FRONT).matrix, abs=1e-12)
    assert camera.road.height_m == pytest.approx(0.65 + 0.001)
    assert camera.model == tiny.lens()
    assert np.array_equal(camera.ego_body, tiny.front_camera().ego_body)
    assert mounting.vehicle_from_lidar.matrix == pytest.approx((OFF @ tiny.VEHICLE_FROM_LIDAR).matrix, abs=1e-12)


def test_other_words_are_refused(truthful):
    with pytest.raises(DataError, match=r"options.ego_motion: expected 'recorded' or 'exact', got 'true'"):
        open_native(truthful, ego_motion="true")


@pytest.mark.parametrize(
    ("option", "file"), [("ego_motion", "truth/poses.csv"), ("calibration", "truth/calibration.json")]
)
def test_missing_truth_is_told_with_what_to_do(truthful, option, file):
    (truthful / file).unlink()
    open_native(truthful)
    with pytest.raises(DataError, match=rf"{file}: expected the truth for {option}: exact, got no such file.*recorded"):
        open_native(truthful, **{option: "exact"})


def test_truth_of_other_cameras_is_refused(truthful):
    file = truthful / "truth/calibration.json"
    file.write_text(file.read_text().replace('"front"', '"rear"'))
    with pytest.raises(
        DataError, match=r"vehicle_from_camera: expected the cameras of recording.json: front, got rear"
    ):
        open_native(truthful, calibration="exact")
