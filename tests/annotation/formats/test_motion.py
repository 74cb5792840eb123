"""Velocities of tools that tell none, and objects without ids followed through time."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.annotation.formats.conversion import LONGEST_GAP_NS, followed, middle_velocities
from bench.annotation.formats.conversion import with_motion as states_with_motion
from bench.annotation.formats.semantickitti import near_groups
from bench.egomotion import Trajectory
from bench.recordings import GroundPolygon, ObjectState, PointIndices, Track
from tests.annotation.formats import street

STEP_NS = 100_000_000


def with_motion(track, trajectory):
    return replace(track, states=tuple(states_with_motion(track.states, trajectory)))


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


def numbered(*places, step_ns=STEP_NS, fastest_mps=30.0):
    rows = [np.array(row, dtype=float).reshape(-1, 3) for row in places]
    return followed([i * step_ns for i in range(len(rows))], rows, fastest_mps=fastest_mps)


def test_a_chain_of_short_steps_is_one_group():
    chain = [[0.4 * i, 0.0, 0.0] for i in range(10)]
    apart = [[4.2, 0.0, 0.0], [4.2, 0.4, 0.0]]
    assert near_groups(np.array(chain)).tolist() == [0] * 10
    assert near_groups(np.array([*apart, *chain])).tolist() == [0, 0, *[1] * 10]
    assert near_groups(np.array([[0.0, 0.0, 0.0], [0.0, 0.51, 0.0]])).tolist() == [0, 1]


def test_objects_keep_their_number_whatever_the_order():
    one, other = [[i, 0.0, 0.0] for i in range(5)], [[10.0 - i, 1.0, 0.0] for i in range(5)]
    places = [[a, b] if i % 2 else [b, a] for i, (a, b) in enumerate(zip(one, other, strict=True))]
    assert numbered(*places) == [[0, 1], [1, 0], [0, 1], [1, 0], [0, 1]]


def test_fast_ones_are_followed_once_they_are_known():
    """2.9 m from sweep to sweep, then six in a gap of two."""
    assert numbered([[0, 0, 0]], [[2.9, 0, 0]], [[5.8, 0, 0]], [], [[11.6, 0, 0]]) == [[0], [0], [0], [], [0]]


def test_far_or_long_gone_ones_are_new():
    assert numbered([[0, 0, 0]], [[4.1, 0, 0]]) == [[0], [1]]  # 30 m/s over 0.1 s, and a metre
    assert numbered([[0, 0, 0]], [[3.9, 0, 0]]) == [[0], [0]]
    assert numbered([[0, 0, 0]], *[[]] * 10, [[0, 0, 0]])[-1] == [1]
    assert numbered([[0, 0, 0]], *[[]] * 9, [[0, 0, 0]])[-1] == [0]


@pytest.mark.parametrize("step_ns", [100_000_000, 250_000_000, 500_000_000, 1_000_000_000])
def test_the_step_of_one_object_grows_with_the_gap(step_ns):
    """A cyclist at 7 m/s and a person at 1.5 m/s beside her, labelled ten times a second down to once."""
    cyclist = [[7.0 * step_ns / 1e9 * i, 0.0, 0.0] for i in range(4)]
    assert numbered(*([place] for place in cyclist), step_ns=step_ns, fastest_mps=15.0) == [[0]] * 4
    walker = [[0.0, 1.5 * step_ns / 1e9 * i, 0.0] for i in range(4)]
    assert numbered(*([place] for place in walker), step_ns=step_ns, fastest_mps=5.0) == [[0]] * 4


def test_unknown_places_are_nobodys():
    nowhere = [[np.nan] * 3]
    assert numbered([[0, 0, 0]], nowhere, [[0, 0, 0]], nowhere) == [[0], [1], [0], [2]]


@given(st.lists(st.lists(st.tuples(*[st.floats(-5, 5)] * 3), max_size=4), max_size=6))
def test_no_two_groups_of_a_sweep_are_one_object(places):
    numbers = numbered(*places)
    assert [len(row) for row in numbers] == [len(row) for row in places]
    assert all(len(set(row)) == len(row) for row in numbers)
    seen = [number for row in numbers for number in row]
    assert set(seen) == set(range(len(set(seen))))


def test_the_slope_of_a_straight_line_is_found_exactly():
    times_ns = 1_700_000_000_000_000_000 + np.array([0, 1, 2, 4, 7]) * STEP_NS
    seconds = (times_ns - times_ns[0]) / 1e9
    middles_m = np.array([5.0, -2.0, 0.5]) + seconds[:, None] * [3.0, -1.0, 0.0]
    assert middle_velocities(times_ns, middles_m) == pytest.approx(np.tile([3.0, -1.0, 0.0], (5, 1)), abs=1e-9)
    middles_m[2] = np.nan  # no ego-motion there: the others still tell
    assert middle_velocities(times_ns, middles_m) == pytest.approx(np.tile([3.0, -1.0, 0.0], (5, 1)), abs=1e-9)


def test_an_object_seen_once_in_a_second_tells_nothing():
    times_ns = np.array([0, 600, 700]) * 1_000_000
    velocities = middle_velocities(times_ns, np.arange(9.0).reshape(3, 3))
    assert np.isnan(velocities[0]).all()
    assert velocities[1] == pytest.approx([30.0, 30.0, 30.0])
