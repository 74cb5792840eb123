from dataclasses import replace

import numpy as np
import pytest

from bench.records.reference import Category, Direction
from bench.reference.motion import categorise, moving_states, relative_direction, track_motion
from tests.reference.drives import MS, SETTINGS, Box, circle, drive

MOTION = SETTINGS.motion


@pytest.mark.parametrize(
    ("velocity", "ego", "category"),
    [
        ((0, 1.2), (5, 0), Category.CROSSING),
        ((3, 3), (5, 0), Category.CROSSING),  # 45 degrees
        ((3.001, 3), (5, 0), Category.PRECEDING),
        ((8, 0), (5, 0), Category.OVERTAKING),
        ((5, 0), (5, 0), Category.OVERTAKING),  # u cos(angle) >= s
        ((3, 0.5), (5, 0), Category.PRECEDING),
        ((-4, 0), (5, 0), Category.APPROACHING),
        ((-3, 3), (5, 0), Category.CROSSING),  # 135 degrees themselves
        ((-3.001, 3), (5, 0), Category.APPROACHING),
        ((8, 0), (0.04, 0), Category.STATIC_EGO),
        ((8, 0), (0.05, 0), Category.OVERTAKING),
        ((-2, 0), (-1, 0), Category.OVERTAKING),  # both reverse, the object faster
        ((2, 0), (-1, 0), Category.APPROACHING),  # reversing towards what follows
    ],
)
def test_category_of_a_moving_object(velocity, ego, category):
    assert categorise(np.array([*velocity, 0.0]), np.array([*ego, 0.0]), MOTION) is category


def test_category_does_not_depend_on_the_axes():
    turn = np.array([[0, -1.0], [1, 0]])
    for velocity in ((3, 2.9), (-3, 1), (0.1, 2), (6, 1)):
        straight = categorise(np.array([*velocity, 0.0]), np.array([4.0, 0, 0]), MOTION)
        turned = categorise(np.array([*(turn @ velocity), 0.0]), np.array([*(turn @ (4.0, 0)), 0.0]), MOTION)
        assert straight is turned


def test_direction_is_of_the_relative_velocity():
    ego = np.array([5.0, 0, 0])
    assert relative_direction(np.array([5.0, 1.0, 0]), ego) is Direction.LATERAL
    assert relative_direction(np.array([0.0, 1.0, 0]), ego) is Direction.LONGITUDINAL
    assert relative_direction(np.array([0.0, 1.0, 0]), np.zeros(3)) is Direction.LATERAL


def states(speeds, step_ms=100):
    times_ns = np.arange(len(speeds), dtype=np.int64) * step_ms * MS
    return moving_states(times_ns, np.array(speeds, dtype=float), MOTION).tolist()


def test_hysteresis_by_hand():
    # Starts by 0.3; once moving it stays so above 0.2, once static it needs 0.4.
    assert states([0.3, 0.25, 0.2, 0.25]) == [True] * 4
    assert states([0.25, 0.35, 0.35, 0.39]) == [False] * 4
    assert states([1, 1, 1, 0.19, 0.3, 0.3, 0.3]) == [True] * 3 + [False] * 4
    assert states([0, 0, 0, 0.4, 0.3, 0.3, 0.3]) == [False] * 3 + [True] * 4


def test_short_runs_are_noise():
    assert states([1, 1, 1, 0, 1, 1, 1]) == [True] * 7  # 100 ms, under the 200 ms of a run
    assert states([0, 0, 0, 1, 1, 0, 0, 0]) == [False] * 3 + [True] * 2 + [False] * 3  # 200 ms are enough
    assert states([1, 0, 0, 0, 0]) == [True] + [False] * 4  # cut off by the start, not short


def test_unknown_speed_keeps_the_state():
    assert states([1, np.nan, np.nan, 0.25]) == [True] * 4
    assert states([np.nan, np.nan]) == [False] * 2


def test_velocity_is_found_from_positions_where_it_is_not_annotated():
    trajectory = circle(6.0, 0.3)
    box = Box((9, 2, 0.75), (4, 1.8, 1.5), (2.0, 1.0, 0.0))
    recording = drive([box], trajectory, state_ns=range(0, 1000 * MS, 100 * MS))
    track = recording.tracks[0]
    for state in track.states:
        state.velocity_mps[:] = np.nan
    motion = track_motion(track, trajectory, MOTION)
    np.testing.assert_allclose(motion.velocity_world_mps, np.tile([2.0, 1.0, 0.0], (10, 1)), atol=1e-9)
    assert motion.moving.all()


def test_smoothing_removes_jitter_but_the_points_use_the_annotation_itself():
    trajectory = circle(0.0, 0.0)
    box = Box((9, 2, 0.75), (4, 1.8, 1.5), (0.0, 0.0, 0.0))
    track = drive([box], trajectory, state_ns=range(0, 1000 * MS, 100 * MS)).tracks[0]
    for index, state in enumerate(track.states):
        state.velocity_mps[0] = 0.6 if index % 2 else -0.6  # a parked car whose box shivers
    motion = track_motion(track, trajectory, MOTION)
    assert not motion.moving.any()
    assert np.abs(motion.velocity_world_mps[:, 0]).min() == pytest.approx(0.6)


def test_smoothing_takes_as_much_from_before_as_from_after_both_ends_of_the_window_included():
    trajectory = circle(0.0, 0.0)
    box = Box((9, 2, 0.75), (4, 1.8, 1.5), (0.0, 0.0, 0.0))
    track = drive([box], trajectory, state_ns=range(0, 1000 * MS, 100 * MS)).tracks[0]
    track.states[5].velocity_mps[0] = 1.0
    motion = track_motion(track, trajectory, replace(MOTION, smoothing_ns=400 * MS))
    np.testing.assert_allclose(motion.smooth_world_mps[:, 0], [0, 0, 0, 0.2, 0.2, 0.2, 0.2, 0.2, 0, 0])
