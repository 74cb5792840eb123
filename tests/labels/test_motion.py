"""Velocities of tools that tell none, from places in the world while the ego vehicle turns."""

from dataclasses import replace

import numpy as np
import pytest

from bench.egomotion import Trajectory
from bench.labels.motion import LONGEST_GAP_NS, with_motion
from bench.recordings import GroundPolygon, ObjectState, PointIndices, Track
from tests.labels import street


def test_a_straight_walk_has_its_exact_velocity():
    true, found = street.box_track("walker"), with_motion(street.box_track("walker", told=False), street.trajectory())
    for state, expected in zip(found.states, true.states, strict=True):
        assert state.velocity_mps == pytest.approx(expected.velocity_mps, abs=1e-6)
        assert state.yaw_rate_radps == pytest.approx(0.0, abs=1e-9)


def test_a_turning_car_turns():
    found = with_motion(street.box_track("car", told=False), street.trajectory())
    assert [state.yaw_rate_radps for state in found.states] == pytest.approx([street.CAR_RADPS] * 6, abs=1e-9)


def test_what_is_told_stays():
    track = street.box_track("car")
    told = replace(track.states[2], velocity_mps=np.array([1.0, 2.0, 3.0]), yaw_rate_radps=9.0)
    found = with_motion(replace(track, states=(*track.states[:2], told, *track.states[3:])), street.trajectory())
    assert found.states[2].velocity_mps.tolist() == [1.0, 2.0, 3.0]
    assert found.states[2].yaw_rate_radps == 9.0


def test_an_object_out_of_sight_for_long_says_nothing_of_its_speed():
    track = street.box_track("walker", told=False)
    late = replace(track.states[-1], timestamp_ns=track.states[-2].timestamp_ns + LONGEST_GAP_NS + 1)
    long = street.trajectory()
    long = Trajectory(
        source="x",
        timestamps_ns=long.timestamps_ns * 3 - 2 * long.timestamps_ns[0],
        rotations=long.rotations,
        positions_m=long.positions_m,
    )
    found = with_motion(replace(track, states=(*track.states[:-1], late)), long)
    assert np.isfinite(found.states[-2].velocity_mps).all()
    assert np.isnan(found.states[-1].velocity_mps).all()


def test_without_ego_motion_nothing_is_said():
    track = street.box_track("walker", told=False)
    away = tuple(replace(state, timestamp_ns=state.timestamp_ns + 10**12) for state in track.states)
    found = with_motion(replace(track, states=away), street.trajectory())
    assert all(np.isnan(state.velocity_mps).all() for state in found.states)


def test_outlines_move_by_their_middle_and_points_are_left_alone():
    ego = street.trajectory()
    states = []
    for time_ns in street.TIMES_NS:
        corners = np.array([[8.0, 1.0, 0.5], [9.0, 1.0, 0.5], [9.0, 2.0, 0.5], [8.0, 2.0, 0.5]])
        moved = corners + street.WALKER_MPS * street.seconds(time_ns)
        outline_m = ego.world_from_vehicle(time_ns).inverse().apply(moved)[:, :2]
        shape = GroundPolygon(outline_m=outline_m, bottom_m=0.0, top_m=1.0)
        states.append(ObjectState(timestamp_ns=time_ns, shape=shape, velocity_mps=np.full(3, np.nan)))
    points = PointIndices(indices=np.array([1]), sweep_timestamp_ns=street.TIMES_NS[3])
    states[3] = replace(states[3], shape=points)
    found = with_motion(Track(track_id="a", object_class="animal", states=tuple(states)), ego)
    assert np.isnan(found.states[3].velocity_mps).all()
    expected = ego.world_from_vehicle(street.TIMES_NS[1]).inverse().rotate(street.WALKER_MPS)
    assert found.states[1].velocity_mps == pytest.approx(expected, abs=1e-6)
