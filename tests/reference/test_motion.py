import numpy as np
import pytest

from bench.records.reference import Category, Direction
from bench.reference.motion import categorise, moving_states, relative_direction, track_motion
from tests.reference.drives import MS, SETTINGS, Box, circle, drive

MOTION = SETTINGS.motion


@pytest.mark.parametrize("turned", [False, True], ids=["along x", "along y"])
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
def test_category_of_a_moving_object(velocity, ego, category, turned):
    vectors = [np.array([-y, x, 0.0] if turned else [x, y, 0.0], dtype=float) for x, y in (velocity, ego)]
    assert categorise(*vectors, MOTION) is category


def test_an_ego_vehicle_at_rest_is_static_also_by_a_limit_of_nothing():
    never = MOTION.model_copy(update={"ego_static_mps": 0.0})
    assert categorise(np.array([1.0, 0.0, 0.0]), np.zeros(3), never) is Category.STATIC_EGO


@pytest.mark.parametrize(
    ("velocity", "ego_mps", "direction"),
    [
        ((5.0, 1.0, 0), 5.0, Direction.LATERAL),
        ((0.0, 1.0, 0), 5.0, Direction.LONGITUDINAL),
        ((0.0, 1.0, 0), 0.0, Direction.LATERAL),
    ],
)
def test_direction_is_of_the_relative_velocity(velocity, ego_mps, direction):
    assert relative_direction(np.array(velocity), np.array([ego_mps, 0.0, 0.0])) is direction


@pytest.mark.parametrize(
    ("speeds_mps", "moving"),
    [
        # Starts by 0.3; once moving it stays so above 0.2, once static it needs 0.4.
        ([0.3, 0.25, 0.2, 0.25], [True] * 4),
        ([0.25, 0.35, 0.35, 0.39], [False] * 4),
        ([1, 1, 1, 0.19, 0.3, 0.3, 0.3], [True] * 3 + [False] * 4),
        ([0, 0, 0, 0.4, 0.3, 0.3, 0.3], [False] * 3 + [True] * 4),
        ([1, 1, 1, 0, 1, 1, 1], [True] * 7),  # 100 ms, under the 200 ms of a run
        ([0, 0, 0, 1, 1, 0, 0, 0], [False] * 3 + [True] * 2 + [False] * 3),  # 200 ms are enough
        ([1, 0, 0, 0, 0], [True] + [False] * 4),  # cut off by the start, not short
        ([1, np.nan, np.nan, 0.25], [True] * 4),  # unknown keeps the state
        ([np.nan, np.nan], [False] * 2),
    ],
)
def test_hysteresis_and_short_runs_by_hand(speeds_mps, moving):
    times_ns = np.arange(len(speeds_mps), dtype=np.int64) * 100 * MS
    assert moving_states(times_ns, np.array(speeds_mps, dtype=float), MOTION).tolist() == moving


def track_of(speeds_mps, trajectory, velocity=(0.0, 0.0, 0.0)):
    """A car in ten states, a tenth of a second apart, annotated with these speeds along x."""
    box = Box((9, 2, 0.75), (4, 1.8, 1.5), velocity)
    track = drive([box], trajectory, state_ns=range(0, 1000 * MS, 100 * MS)).tracks[0]
    for state, speed_mps in zip(track.states, speeds_mps, strict=True):
        state.velocity_mps[0] = speed_mps
    return track


def test_velocity_is_found_from_positions_where_it_is_not_annotated():
    trajectory = circle(6.0, 0.3)
    motion = track_motion(track_of([np.nan] * 10, trajectory, (2.0, 1.0, 0.0)), trajectory, MOTION)
    np.testing.assert_allclose(motion.velocity_world_mps, np.tile([2.0, 1.0, 0.0], (10, 1)), atol=1e-9)
    assert motion.moving.all()


def test_smoothing_removes_jitter_but_the_points_use_the_annotation_itself():
    """A parked car whose box shivers."""
    still = circle(0.0, 0.0)
    motion = track_motion(track_of([-0.6, 0.6] * 5, still), still, MOTION)
    assert not motion.moving.any()
    assert np.abs(motion.velocity_world_mps[:, 0]).min() == pytest.approx(0.6)


def test_smoothing_takes_as_much_from_before_as_from_after_both_ends_of_the_window_included():
    still = circle(0.0, 0.0)
    motion = track_motion(track_of(np.eye(10)[5], still), still, MOTION.model_copy(update={"smoothing_s": 0.4}))
    np.testing.assert_allclose(motion.smooth_world_mps[:, 0], [0, 0, 0, 0.2, 0.2, 0.2, 0.2, 0.2, 0, 0])
