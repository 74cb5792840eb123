"""A camera bolted to a moving vehicle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.egomotion import camera_motion
from bench.geometry import RigidTransform

# x right = -y of the vehicle, y down = -z, z forward = x
FRONT = RigidTransform(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([3.7, 0.0, 0.65]))


def moved(current):
    return camera_motion(
        world_from_vehicle_previous=RigidTransform.identity(),
        world_from_vehicle_current=current,
        vehicle_from_camera=FRONT,
    )


def test_driving_on_brings_points_nearer():
    motion = moved(RigidTransform.from_yaw(0.0, (2.0, 0.0, 0.0)))
    assert motion.apply(np.array([[0.0, 0.0, 10.0]])) == pytest.approx(np.array([[0.0, 0.0, 8.0]]))


def test_turning_about_the_rear_axle_moves_the_front_camera_sideways():
    # A quarter turn to the left: the camera goes from (3.7, 0) to (0, 3.7); it looked along x and now along y.
    motion = moved(RigidTransform.from_yaw(np.pi / 2))
    # Its old position is (3.7, -3.7) from the new one: 3.7 m to its right and 3.7 m behind.
    assert motion.translation_m == pytest.approx([3.7, 0.0, -3.7])


@given(yaw=st.floats(-0.5, 0.5), x=st.floats(-2, 2), y=st.floats(-1, 1))
def test_a_static_point_is_the_same_by_both_ways(yaw, x, y):
    current = RigidTransform.from_yaw(yaw, (x, y, 0.0))
    point_world = np.array([[12.0, -3.0, 1.0]])
    seen_before = FRONT.inverse().apply(point_world)
    seen_now = (current @ FRONT).inverse().apply(point_world)
    assert moved(current).apply(seen_before) == pytest.approx(seen_now, abs=1e-12)
