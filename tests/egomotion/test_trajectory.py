"""Poses between poses, in gaps and beyond the ends."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.egomotion.trajectory import Trajectory, camera_motion, planar_trajectory
from bench.errors import DataError
from bench.geometry import RigidTransform
from tests.support.tiny import FRONT

STEP_NS = 100_000_000


def straight(times_ns, speed_mps=10.0):
    times_ns = np.array(times_ns, dtype=np.int64)
    positions_m = np.zeros((len(times_ns), 3))
    positions_m[:, 0] = speed_mps * (times_ns - times_ns[0]) / 1e9
    return Trajectory(
        source="poses.csv",
        timestamps_ns=times_ns,
        rotations=Rotation.identity(len(times_ns)),
        positions_m=positions_m,
    )


def test_a_pose_is_met_exactly_and_half_way_is_half_way_whether_computed_alone_or_together():
    times_ns = [STEP_NS // 2, STEP_NS, 2 * STEP_NS + 7]
    path = straight(range(0, 4 * STEP_NS, STEP_NS))
    rotations, positions_m, _ = path.at(np.array(times_ns))
    assert positions_m[:2] == pytest.approx(np.array([[0.5, 0.0, 0.0], [1.0, 0.0, 0.0]]), abs=1e-15)
    for time_ns, rotation, position_m in zip(times_ns, rotations, positions_m, strict=True):
        pose = path.world_from_vehicle(time_ns)
        assert np.array_equal(pose.rotation, rotation)
        assert np.array_equal(pose.translation_m, position_m)


def test_motion_goes_on_for_a_tenth_of_a_second_beyond_the_ends():
    path = straight([0, STEP_NS])
    _, positions_m, valid = path.at(np.array([-STEP_NS, 2 * STEP_NS, -STEP_NS - 1, 2 * STEP_NS + 1]))
    assert valid.tolist() == [True, True, False, False]
    assert positions_m[:2, 0] == pytest.approx([-1.0, 2.0])
    assert np.isnan(positions_m[2:]).all()


def test_nothing_is_invented_inside_a_gap():
    path = straight([0, STEP_NS, STEP_NS + 600_000_000])
    _, _, valid = path.at(np.array([STEP_NS // 2, STEP_NS, STEP_NS + 1, STEP_NS + 600_000_000]))
    assert valid.tolist() == [True, True, False, True]
    for gap_ns, is_bridged in ((500_000_000, True), (500_000_001, False)):
        assert straight([0, gap_ns]).at(np.array([STEP_NS]))[2].item() is is_bridged
    told = (
        r"poses\.csv: timestamp_ns: expected ego-motion at 100000001, got poses from 0 to 700000000, gaps over 500 ms"
    )
    with pytest.raises(DataError, match=told):
        path.world_from_vehicle(STEP_NS + 1)


def test_places_that_are_none_are_refused():
    with pytest.raises(DataError, match="finite positions"):
        straight([0, STEP_NS], speed_mps=np.nan)


@pytest.mark.parametrize("speed_mps", [8.0, -3.0, 0.0])
@pytest.mark.parametrize("rate_radps", [0.5, -1.2, 0.0])
@pytest.mark.parametrize(
    "time_ns", [0, 1, 25_000_000, STEP_NS // 2, STEP_NS - 1, STEP_NS, 2 * STEP_NS, 2 * STEP_NS + 1]
)
def test_on_a_bend_the_velocity_points_along_the_vehicle_at_every_time(time_ns, rate_radps, speed_mps):
    """Poses at 10 Hz, between two of which the chord is rotated against the pose by up to 1.43 degrees at 0.5 rad/s,
    half of the rotation between them."""
    signals = {"speed_mps": np.full(3, speed_mps), "yaw_rate_radps": np.full(3, rate_radps)}
    path = planar_trajectory(source="circle", timestamps_ns=np.arange(3) * STEP_NS, **signals)
    assert path.velocity_vehicle_mps(time_ns) == pytest.approx([speed_mps, 0.0, 0.0], abs=1e-9)


def test_the_velocity_between_poses_is_that_of_the_path_there():
    """Any two poses, tilted ones as well: the velocity is the derivative of the position, seen from the vehicle."""
    rng = np.random.default_rng(7)
    path = Trajectory(
        source="x",
        timestamps_ns=np.array([0, STEP_NS]),
        rotations=Rotation.random(2, rng=rng),
        positions_m=rng.normal(size=(2, 3)),
    )
    for time_ns in (0, STEP_NS // 3, STEP_NS - 2000):
        before, after = (path.world_from_vehicle(time_ns + aside_ns) for aside_ns in (-1000, 1000))
        velocity_world_mps = (after.translation_m - before.translation_m) / 2e-6
        seen = path.world_from_vehicle(time_ns).rotation.T @ velocity_world_mps
        assert path.velocity_vehicle_mps(time_ns) == pytest.approx(seen, rel=1e-5, abs=1e-5)


def test_a_gap_says_nothing_of_the_velocity_at_its_ends():
    times_ns = np.array([0, STEP_NS, STEP_NS + 600_000_000, 2 * STEP_NS + 600_000_000])
    positions_m = np.zeros((4, 3))
    positions_m[:, 0] = [0.0, 1.0, 13.0, 13.2]  # 10 m/s, a gap that was passed at 20 m/s, 2 m/s
    path = Trajectory(source="x", timestamps_ns=times_ns, rotations=Rotation.identity(4), positions_m=positions_m)
    found = [float(path.velocity_vehicle_mps(int(time_ns))[0]) for time_ns in times_ns]
    assert found == pytest.approx([10.0, 10.0, 2.0, 2.0])
    with pytest.raises(DataError, match="expected ego-motion at 100000001"):
        path.velocity_vehicle_mps(STEP_NS + 1)


def moved(current):
    return camera_motion(
        world_from_vehicle_previous=RigidTransform.identity(),
        world_from_vehicle_current=current,
        vehicle_from_camera=FRONT,
    )


def test_driving_on_brings_points_nearer_and_turning_moves_the_front_camera_sideways():
    motion = moved(RigidTransform.from_yaw(0.0, (2.0, 0.0, 0.0)))
    assert motion.apply(np.array([[0.0, 0.0, 10.0]])) == pytest.approx(np.array([[0.0, 0.0, 8.0]]))
    # A quarter turn to the left about the rear axle: the camera goes from (3.7, 0) to (0, 3.7); it looked along x and
    # now along y. Its old position is (3.7, -3.7) from the new one: 3.7 m to its right and 3.7 m behind.
    assert moved(RigidTransform.from_yaw(np.pi / 2)).translation_m == pytest.approx([3.7, 0.0, -3.7])


@given(yaw=st.floats(-0.5, 0.5), x=st.floats(-2, 2), y=st.floats(-1, 1))
def test_a_static_point_is_the_same_by_both_ways(yaw, x, y):
    current = RigidTransform.from_yaw(yaw, (x, y, 0.0))
    point_world = np.array([[12.0, -3.0, 1.0]])
    seen_before = FRONT.inverse().apply(point_world)
    seen_now = (current @ FRONT).inverse().apply(point_world)
    assert moved(current).apply(seen_before) == pytest.approx(seen_now, abs=1e-12)
