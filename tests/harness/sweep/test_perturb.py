"""Injected errors do what they say, by numbers that can be checked by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.cameras import KannalaBrandtCamera, PinholeCamera, RadialPolynomialCamera, UnifiedCamera
from bench.egomotion import Trajectory, camera_motion
from bench.geometry import RigidTransform, RoadPlane
from bench.harness.sweep.perturb import Injection, believed, with_noise
from bench.methods import MethodInput
from bench.recordings import MountedCamera

AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # vehicle from a camera that looks ahead
MOUNTING = RigidTransform(AHEAD, np.array([2.0, 0.0, 1.0]))
LENS = PinholeCamera(width=64, height=48, principal_point=(31.5, 23.5), focal=(40.0, 40.0))
MOUNTED = MountedCamera(
    name="front",
    model=LENS,
    vehicle_from_camera=MOUNTING,
    road=RoadPlane.below(MOUNTING),
    stored_size_px=(64, 48),
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
    poses = [trajectory.world_from_vehicle(time_ns) for time_ns in TIMES_NS]
    motion = camera_motion(
        world_from_vehicle_previous=poses[0],
        world_from_vehicle_current=poses[1],
        vehicle_from_camera=MOUNTING,
    )
    given = MethodInput(
        images=tuple(np.full((48, 64), 100, dtype=np.uint8) for _ in TIMES_NS),
        timestamps_ns=TIMES_NS,
        camera=LENS,
        road=MOUNTED.road,
        current_from_previous=(motion,),
        valid=np.ones((48, 64), dtype=bool),
    )
    return given, believed(given, mounted=MOUNTED, trajectory=trajectory, injection=Injection(**errors))


def turn_deg(transform):
    return np.rad2deg(Rotation.from_matrix(transform.rotation).as_rotvec())


def test_no_error_changes_nothing():
    given, same = told(drive())
    assert same is given


def test_speed_scales_the_path():
    given, wrong = told(drive(speed_mps=10.0), speed_scale_percent=20.0)
    # At 10 m/s the previous camera lies 1 m behind, along -z; 20 % more is 1.2 m.
    assert given.current_from_previous[0].translation_m == pytest.approx([0, 0, -1.0])
    assert wrong.current_from_previous[0].translation_m == pytest.approx([0, 0, -1.2])
    assert turn_deg(wrong.current_from_previous[0]) == pytest.approx([0, 0, 0], abs=1e-9)


def test_yaw_rate_turns_about_the_vehicle_origin():
    _, wrong = told(drive(speed_mps=0.0), yaw_rate_bias_degps=20.0)
    motion = wrong.current_from_previous[0]
    # 2 degrees to the left in 0.1 s is a turn of the previous frame by 2 degrees about the camera's y (down), and a
    # camera 2 m ahead of the origin swings 2 sin(2 deg) m to the left: the previous one lies on the right.
    assert turn_deg(motion) == pytest.approx([0, 2.0, 0], abs=1e-9)
    assert motion.translation_m == pytest.approx([2 * np.sin(np.deg2rad(2)), 0, 2 * np.cos(np.deg2rad(2)) - 2])


def test_yaw_rate_adds_to_the_true_one():
    _, wrong = told(drive(speed_mps=0.0, yaw_rate_radps=np.deg2rad(-20)), yaw_rate_bias_degps=20.0)
    assert turn_deg(wrong.current_from_previous[0]) == pytest.approx([0, 0, 0], abs=1e-9)


def test_pitch_turns_mounting_road_and_motion_together():
    given, wrong = told(drive(speed_mps=10.0), pitch_deg=30.0)
    # Believed to look 30 degrees down: the road is nearer to the optical axis, the motion has a part along y.
    assert wrong.road.down == pytest.approx([0, np.cos(np.deg2rad(30)), 0.5])
    assert wrong.road.height_m == given.road.height_m
    assert wrong.current_from_previous[0].translation_m == pytest.approx([0, 0.5, -np.cos(np.deg2rad(30))])
    assert wrong.camera == given.camera


def test_pitch_rate_turns_the_previous_image_only():
    given, wrong = told(drive(speed_mps=10.0), pitch_rate_degps=-5.0)
    assert turn_deg(wrong.current_from_previous[0]) == pytest.approx([-0.5, 0, 0], abs=1e-9)
    assert wrong.current_from_previous[0].translation_m == pytest.approx([0, 0, -1.0])
    assert wrong.road.down == pytest.approx(given.road.down)


def test_time_offset_reads_the_motion_elsewhere():
    times_ns = np.arange(0, 3_000_000_001, 100_000_000)
    seconds = times_ns / 1e9
    faster = Trajectory(
        source="test",
        timestamps_ns=times_ns,
        rotations=Rotation.from_rotvec(np.zeros((len(seconds), 3))),
        positions_m=np.column_stack([5 * seconds**2, 0 * seconds, 0 * seconds]),
    )
    given, wrong = told(faster, time_offset_ms=100.0)
    assert given.current_from_previous[0].translation_m[2] == pytest.approx(-5 * (1.1**2 - 1.0**2))
    assert wrong.current_from_previous[0].translation_m[2] == pytest.approx(-5 * (1.2**2 - 1.1**2))


@pytest.mark.parametrize(
    "lens",
    [
        LENS,
        RadialPolynomialCamera(
            width=64, height=48, principal_point=(30.0, 25.0), coefficients=(40.0, -2.0, 3.0, -0.5), aspect_ratio=1.01
        ),
        KannalaBrandtCamera(width=64, height=48, principal_point=(30.0, 25.0), focal=(40, 41), coefficients=(0.01,)),
        UnifiedCamera(width=64, height=48, principal_point=(30.0, 25.0), focal=(40, 41), xi=1.2, radial=(0.01, 0)),
    ],
    ids=lambda lens: type(lens).__name__,
)
def test_calibration_shifts_and_scales_every_lens(lens):
    given, _ = told(drive())
    wrong = believed(
        replace(given, camera=lens),
        mounted=MOUNTED,
        trajectory=drive(),
        injection=Injection(principal_point_u_px=5.0, principal_point_v_px=-3.0, focal_scale_percent=2.0),
    )
    rays = np.array([[0.1, 0.2, 1.0], [-0.5, 0.3, 1.0], [0.0, 0.0, 1.0]])
    pixels, _ = lens.project(rays)
    shifted, _ = wrong.camera.project(rays)
    centre = np.array(lens.principal_point)
    np.testing.assert_allclose(shifted, centre + [5, -3] + 1.02 * (pixels - centre), atol=1e-9)
    assert (wrong.camera.width, wrong.camera.height) == (64, 48)


def test_noise_is_seeded_by_image_and_scales():
    given, _ = told(drive())
    weak, again, strong = (with_noise(given, name="a front", strength_grey=s) for s in (4.0, 4.0, 8.0))
    other = with_noise(given, name="b front", strength_grey=4.0)
    assert [np.array_equal(a, b) for a, b in zip(weak.images, again.images, strict=True)] == [True, True]
    assert not np.array_equal(weak.images[0], weak.images[1])  # of another time
    assert not np.array_equal(weak.images[0], other.images[0])
    spread = weak.images[0].astype(float) - 100
    assert spread.std() == pytest.approx(4.0, rel=0.05)
    assert np.abs((strong.images[0].astype(float) - 100) - 2 * spread).max() <= 1.5  # the same noise, rounded
    assert with_noise(given, name="a front", strength_grey=0.0) is given
