"""Errors of what a method is told do what they say, by numbers that can be checked by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.cameras.pinhole import PinholeCamera
from bench.egomotion.trajectory import Trajectory
from bench.geometry import RigidTransform, RoadPlane
from bench.recordings import ImageRef, MountedCamera
from bench.recordings.input_errors import perturbed_camera, perturbed_motion, perturbed_pixels, perturbed_time_ns
from bench.records.recording import InputErrors
from tests.support.lenses import LENSES

AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # vehicle from a camera that looks ahead
MOUNTING = RigidTransform(AHEAD, np.array([2.0, 0.0, 1.0]))
LENS = PinholeCamera(width=64, height=48, principal_point=(31.5, 23.5), focal=(40.0, 40.0))
MOUNTED = MountedCamera(
    name="front", model=LENS, vehicle_from_camera=MOUNTING, road=RoadPlane.below(MOUNTING), stored_size_px=(64, 48)
)
TIMES_NS = (1_000_000_000, 1_100_000_000)


def drive(speed_mps=10.0, yaw_rate_radps=0.0):
    """Poses along x at constant speed, turning on the way."""
    times_ns = np.arange(0, 3_000_000_001, 100_000_000)
    seconds = times_ns / 1e9
    return Trajectory(
        source="test",
        timestamps_ns=times_ns,
        rotations=Rotation.from_rotvec(np.outer(yaw_rate_radps * seconds, [0.0, 0.0, 1.0])),
        positions_m=np.column_stack([speed_mps * seconds, 0 * seconds, 0 * seconds]),
    )


def told(trajectory, **errors):
    """The camera and the motion between two images that a method is told of."""
    wrong = InputErrors(**errors)
    camera = perturbed_camera(MOUNTED, wrong)
    previous, current = (trajectory.world_from_vehicle(perturbed_time_ns(time_ns, wrong)) for time_ns in TIMES_NS)
    seconds = (TIMES_NS[1] - TIMES_NS[0]) / 1e9
    motion = perturbed_motion(
        previous, current, seconds=seconds, vehicle_from_camera=camera.vehicle_from_camera, errors=wrong
    )
    return camera, motion


COSINE, SINE = np.cos(np.deg2rad(30)), 0.5
# 2 degrees to the left in 0.1 s is a turn of the previous frame by 2 degrees about the camera's y (down), and a camera
# 2 m ahead of the origin swings 2 sin(2 deg) m to the left: the previous one lies on the right.
SWUNG = [2 * np.sin(np.deg2rad(2)), 0, 2 * np.cos(np.deg2rad(2)) - 2]
ERRORS = [  # of what, the ego's speed and yaw rate, and the turn and the translation that the method is told of
    ({}, (10.0, 0.0), [0, 0, 0], [0, 0, -1.0]),  # at 10 m/s the previous camera lies 1 m behind, along -z
    ({"speed_scale_percent": 20.0}, (10.0, 0.0), [0, 0, 0], [0, 0, -1.2]),
    ({"yaw_rate_bias_degps": 20.0}, (0.0, 0.0), [0, 2.0, 0], SWUNG),
    ({"yaw_rate_bias_degps": 20.0}, (0.0, np.deg2rad(-20)), [0, 0, 0], [0, 0, 0]),  # adds to the true one
    # Believed to look down: the motion has a part along y.
    ({"pitch_deg": 30.0}, (10.0, 0.0), [0, 0, 0], [0, SINE, -COSINE]),
    ({"pitch_rate_degps": -5.0}, (10.0, 0.0), [-0.5, 0, 0], [0, 0, -1.0]),
]


@pytest.mark.parametrize(("errors", "ego", "turn_deg", "translation_m"), ERRORS)
def test_errors_change_what_a_method_is_told_of_the_motion(errors, ego, turn_deg, translation_m):
    camera, motion = told(drive(*ego), **errors)
    assert np.rad2deg(Rotation.from_matrix(motion.rotation).as_rotvec()) == pytest.approx(turn_deg, abs=1e-9)
    assert motion.translation_m == pytest.approx(translation_m, abs=1e-9)
    down = [0, COSINE, SINE] if "pitch_deg" in errors else MOUNTED.road.down
    assert camera.road.down == pytest.approx(down)
    assert (camera.road.height_m, camera.model) == (MOUNTED.road.height_m, LENS)
    assert (camera is MOUNTED) == (not errors)


def test_time_offset_reads_the_motion_elsewhere():
    path = drive(speed_mps=1.0)  # whose x is the time
    faster = replace(path, positions_m=5 * path.positions_m**2)
    for offset_ms, (before_s, after_s) in ((0.0, (1.0, 1.1)), (100.0, (1.1, 1.2))):
        _, motion = told(faster, time_offset_ms=offset_ms)
        assert motion.translation_m[2] == pytest.approx(-5 * (after_s**2 - before_s**2))


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_calibration_shifts_and_scales_every_lens(lens):
    camera = perturbed_camera(
        replace(MOUNTED, model=lens),
        InputErrors(principal_point_u_px=5.0, principal_point_v_px=-3.0, focal_scale_percent=2.0),
    )
    rays = np.array([[0.1, 0.2, 1.0], [-0.5, 0.3, 1.0], [0.0, 0.0, 1.0]])
    pixels, _ = lens.project(rays)
    shifted, _ = camera.model.project(rays)
    centre = np.array(lens.principal_point)
    np.testing.assert_allclose(shifted, centre + [5, -3] + 1.02 * (pixels - centre), atol=1e-9)
    assert (camera.model.width, camera.model.height) == (lens.width, lens.height)


def test_noise_is_seeded_by_image_and_scales():
    grey = np.full((48, 64), 100, dtype=np.uint8)

    def noisy(strength_grey, *, name="a", time_ns=TIMES_NS[0]):
        image = ImageRef(camera="front", timestamp_ns=time_ns, path=Path("image.png"))
        return perturbed_pixels(grey, image, recording=name, errors=InputErrors(image_noise_grey=strength_grey))

    weak, again, strong = (noisy(strength) for strength in (4.0, 4.0, 8.0))
    assert np.array_equal(weak, again)
    assert not np.array_equal(weak, noisy(4.0, time_ns=TIMES_NS[1]))
    assert not np.array_equal(weak, noisy(4.0, name="b"))
    spread = weak.astype(float) - 100
    assert spread.std() == pytest.approx(4.0, rel=0.05)
    assert np.abs((strong.astype(float) - 100) - 2 * spread).max() <= 1.5  # the same noise, rounded
    assert noisy(0.0) is grey
