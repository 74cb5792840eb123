import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from bench.geometry import RigidTransform
from bench.methods.spherical.constraints import static_camera_deviation, three_view_deviation
from tests.methods.worlds import TwoViews


def stationary(points, motion, lambda_static_m=0.02, creep_m=0.0):
    views = TwoViews(current_m=(creep_m, 0, 0.66), yaw_rad=0)
    return static_camera_deviation(
        *views.rays(points, motion),
        current_from_previous=RigidTransform.identity(),  # what the wheels report
        road=views.road,
        lambda_static_m=lambda_static_m,
    )


def test_static_camera_measures_flow_on_the_sphere():
    deviation, defined = stationary([(4.0, 0.0, 0.66), (4.0, 0.0, 0.66)], [(0, 0.1, 0), (0, 0, 0)])
    np.testing.assert_allclose(deviation, [np.sin(np.arctan(0.1 / 4)), 0.0], atol=1e-12)
    assert defined.all()


def test_unregistered_creep_of_the_road_is_suppressed_but_a_walker_is_not():
    road, _ = stationary([(3, 1, 0), (6, -2, 0)], (0, 0, 0), creep_m=0.015)
    assert road.max() == 0
    without, _ = stationary([(3, 1, 0), (6, -2, 0)], (0, 0, 0), creep_m=0.015, lambda_static_m=0.0)
    assert without.min() > 3e-4
    walker, _ = stationary([(4, 1, 0.05)], (0, 0.08, 0))
    assert walker[0] > 6e-4


def test_rays_without_value_are_not_defined():
    views = TwoViews()
    previous, current = views.rays([(4, 1, 0), (4, 1, 1)])
    previous[0] = np.nan
    deviation, defined = static_camera_deviation(
        previous, current, current_from_previous=views.motion, road=views.road, lambda_static_m=0.02
    )
    assert defined.tolist() == [False, True]
    assert deviation[0] == 0


def three_views(point, second, third, motions=((0, 0, 0), (0, 0, 0))):
    first = TwoViews(current_m=second[0], yaw_rad=second[1])
    last = TwoViews(current_m=third[0], yaw_rad=third[1])
    point = np.asarray(point, dtype=float)
    rays_first, rays_second = first.rays(point, motions[0])
    rays_third = last.rays(point, np.add(*motions))[1]
    return three_view_deviation(
        rays_first,
        rays_second,
        rays_third,
        second_from_first=first.motion,
        third_from_second=last.current_from_world @ first.current_from_world.inverse(),
    )


coordinate = st.floats(-10, 10)


@given(coordinate, coordinate, st.floats(0, 4), st.floats(0.1, 0.6), st.floats(0.1, 0.9), st.floats(-0.05, 0.05))
def test_three_views_of_a_static_point_agree(x, y, z, step, next_step, yaw):
    assume(abs(y) > 0.5)
    second = ((step, 0.01, 0.66), yaw)
    third = ((step + next_step, 0.05, 0.66), 2.5 * yaw)
    deviation, defined = three_views((x, y, z), second, third)
    assume(defined[0])  # not next to the epipole of either pair
    assert deviation[0] < 1e-10


def test_three_views_are_defined_for_ordinary_points():
    views = ((0.4, 0.01, 0.66), 0.01), ((1.0, 0.05, 0.66), 0.025)
    assert three_views([(6, 2, 0), (3, -2, 1), (8, 4, 3), (-4, 2, 0.2)], *views)[1].all()


def test_three_views_see_a_change_of_speed_but_not_parallel_motion_at_constant_speed():
    second, third = ((0.4, 0, 0.66), 0.0), ((0.8, 0, 0.66), 0.0)
    steady, _ = three_views((4, 1.5, 0.3), second, third, ((0.2, 0, 0), (0.2, 0, 0)))
    braking, _ = three_views((4, 1.5, 0.3), second, third, ((0.2, 0, 0), (0.1, 0, 0)))
    assert steady[0] < 1e-12
    assert braking[0] > 1e-3


def test_three_views_need_parallax():
    views = ((0.4, 0, 0.66), 0.0), ((0.8, 0, 0.66), 0.0)
    assert not three_views((1e5, 3e4, 0.3), *views)[1].any()
