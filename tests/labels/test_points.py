"""Points without a number: which belong together, which object they are, how it moves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.labels.motion import GroupedSweep, linked_groups, middle_velocities, near_groups

STEP_NS = 100_000_000


def swept(*places):
    return [GroupedSweep(timestamp_ns=i * STEP_NS, middles_m=np.array(p).reshape(-1, 3)) for i, p in enumerate(places)]


def test_a_chain_of_short_steps_is_one_group():
    chain = [[0.4 * i, 0.0, 0.0] for i in range(10)]
    apart = [[4.2, 0.0, 0.0], [4.2, 0.4, 0.0]]
    assert near_groups(np.array(chain)).tolist() == [0] * 10
    assert near_groups(np.array([*apart, *chain])).tolist() == [0, 0, *[1] * 10]
    assert near_groups(np.array([[0.0, 0.0, 0.0], [0.0, 0.51, 0.0]])).tolist() == [0, 1]
    assert near_groups(np.empty((0, 3))).tolist() == []


def test_objects_keep_their_number_whatever_the_order():
    one, other = [[i, 0.0, 0.0] for i in range(5)], [[10.0 - i, 1.0, 0.0] for i in range(5)]
    sweeps = swept(*([a, b] if i % 2 else [b, a] for i, (a, b) in enumerate(zip(one, other, strict=True))))
    assert linked_groups(sweeps) == ((0, 1), (1, 0), (0, 1), (1, 0), (0, 1))


def test_fast_ones_are_followed_once_they_are_known():
    """2.9 m from sweep to sweep, then six in a gap of two."""
    sweeps = swept([[0, 0, 0]], [[2.9, 0, 0]], [[5.8, 0, 0]], [], [[11.6, 0, 0]])
    assert linked_groups(sweeps) == ((0,), (0,), (0,), (), (0,))


@pytest.mark.parametrize("step_s", [0.1, 0.2, 0.5, 1.0, 2.0])
@pytest.mark.parametrize("speed_mps", [1.5, 7.0, 25.0])
def test_one_object_stays_one_whatever_the_time_between(step_s, speed_mps):
    """A cyclist at 7 m/s, labelled twice a second, was a new object in every frame."""
    times_ns = [round(i * step_s * 1e9) for i in range(6)]
    middles_m = [np.array([[speed_mps * time_ns / 1e9, 2.0, 0.0]]) for time_ns in times_ns]
    sweeps = [GroupedSweep(timestamp_ns=t, middles_m=m) for t, m in zip(times_ns, middles_m, strict=True)]
    assert linked_groups(sweeps) == ((0,),) * 6
    velocities = middle_velocities(np.array(times_ns), np.concatenate(middles_m))
    assert velocities == pytest.approx(np.tile([speed_mps, 0.0, 0.0], (6, 1)), abs=1e-9)


def test_far_or_long_gone_ones_are_new():
    assert linked_groups(swept([[0, 0, 0]], [[3.1, 0, 0]])) == ((0,), (1,))
    assert linked_groups(swept([[0, 0, 0]], *[[]] * 6, [[0, 0, 0]])) == ((0,), *[()] * 6, (1,))
    assert linked_groups(swept([[0, 0, 0]], *[[]] * 5, [[0, 0, 0]])) == ((0,), *[()] * 5, (0,))


def test_unknown_places_are_nobodys():
    nowhere = [[np.nan] * 3]
    assert linked_groups(swept([[0, 0, 0]], nowhere, [[0, 0, 0]], nowhere)) == ((0,), (1,), (0,), (2,))


@given(st.lists(st.lists(st.tuples(*[st.floats(-5, 5)] * 3), max_size=4), max_size=6))
def test_no_two_groups_of_a_sweep_are_one_object(places):
    numbers = linked_groups(swept(*places))
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
