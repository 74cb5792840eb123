# ruff: noqa: E501 - a table reads better with its rows whole
"""The golden answers and the laws of the constraints: two views, a stationary camera, three views."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bench.errors import ShapeError, UsageError
from bench.geometry import RigidTransform
from bench.methods.spherical.constraints import Variants, deviations, static_camera_deviation, three_view_deviation
from bench.methods.spherical.likelihood import ConstraintWeights, motion_likelihood
from tests.support.worlds import TwoViews


def along(distance_m):
    """Parallel to the ego vehicle's own motion."""
    return tuple(distance_m * np.array([0.4, 0.01, 0.0]) / np.hypot(0.4, 0.01))


# World point, its motion between the frames, p, p', xi_e, xi_d, xi_h, xi_p, xi; the paper's known answers.
GOLDEN = [
    ((4, 1, 0), (0, 0, 0), (-0.239486784, -0.1791082, 0.954235994), (-0.252812655, -0.161935499, 0.953867211), (0, 0, 0, 0, 0)),
    ((4, 1.5, 0.3), (0, 0, 0), (-0.349883314, -0.240204512, 0.905474163), (-0.372761759, -0.229347864, 0.899137491), (0, 0, 0, 0.015455, 0.001288)),
    ((6, 2, 2), (0, 0, 0), (-0.309360395, -0.512193926, 0.801220025), (-0.318609818, -0.522033617, 0.791181829), (0, 0, 0, 0, 0)),
    ((3, 3, 0.5), along(0.6), (-0.706604485, -0.206260113, 0.676880246), (-0.677730517, -0.216953513, 0.702575633), (0, 0.031386, 0, 0, 0.013078)),
    ((4, 1.5, 0.1), along(0.3), (-0.348144997, -0.195391205, 0.916851863), (-0.347198873, -0.192658823, 0.917788385), (0, 0, 0.020444, 0, 0.001704)),
    ((5, -2.5, 0.05), along(-0.4), (0.444574609, -0.202172654, 0.872628005), (0.517946305, -0.173368861, 0.837660351), (0, 0, 0, 0.043302, 0.003608)),
    ((4, -1, 1.2), (0, 0.1, 0), (0.240481908, -0.451027327, 0.859501484), (0.25088152, -0.462635457, 0.850309883), (0.011743, 0, 0, 0, 0.004893)),
    ((4, -1, 0.66), (0, 0.1, 0), (0.242535625, -0.331808277, 0.911635748), (0.253520545, -0.330846346, 0.908992865), (0, 0, 0, 0, 0)),
]  # fmt: skip

step = st.floats(-0.6, 0.6)
angle = st.floats(-0.08, 0.08)
coordinate = st.floats(-15, 15)


def measured(views, points, motion=(0, 0, 0), **options):
    return deviations(*views.rays(points, motion), current_from_previous=views.motion, road=views.road, **options)


def all_of(found):
    return np.stack([found.epipolar, found.positive_depth, found.positive_height, found.anti_parallel])


@pytest.mark.parametrize(("point", "motion", "p", "p_current", "expected"), GOLDEN)
def test_golden_answers(point, motion, p, p_current, expected):
    views = TwoViews()
    previous, current = views.rays(point, motion)
    np.testing.assert_allclose(previous[0], p, atol=1e-9)
    np.testing.assert_allclose(current[0], p_current, atol=1e-9)
    found = measured(views, point, motion)
    likelihood, _ = motion_likelihood(found, ConstraintWeights())
    np.testing.assert_allclose([*all_of(found)[:, 0], likelihood[0]], expected, atol=1e-6)
    assert found.defined.all()


@given(step, step, angle, st.floats(0.3, 2.0), coordinate, coordinate, st.floats(-0.5, 5))
def test_static_points_deviate_in_neither_epipolar_nor_depth_and_road_points_in_nothing(dx, dy, yaw, height, x, y, z):
    assume(np.hypot(dx, dy) > 0.01)
    views = TwoViews(previous_m=(0, 0, height), current_m=(dx, dy, height), yaw_rad=yaw)
    assume(min(np.linalg.norm([x, y, z - height]), np.linalg.norm([x - dx, y - dy, z - height])) > 0.2)
    found = measured(views, [(x, y, z), (x, y, 0.0)])
    assert max(found.epipolar.max(), found.positive_depth.max()) < 1e-12
    assert all_of(found)[:, 1].max() < 1e-12


@given(st.floats(0.05, 0.9), st.floats(0.0, 0.6), st.floats(2, 8), st.floats(0.5, 4))
def test_positive_height_fires_exactly_below_the_share_of_the_speeds(share, z, x, y):
    """A point moving parallel at u, seen from s, triangulates below the road where z < eta_C u/s."""
    s, eta = 0.4, 0.66
    views = TwoViews(current_m=(s, 0, eta), yaw_rad=0)
    assume(abs(z - eta * share) > 0.02)
    found = measured(views, (x, y, z), (share * s, 0, 0), lambda_height=0.0, lambda_anti_parallel=0.0)
    assert (found.positive_height[0] > 0) == (z < eta * share)


@given(coordinate, coordinate, st.floats(0, 3), step, step, step)
def test_depth_height_and_anti_parallel_exclude_each_other(x, y, z, u, v, w):
    assume(np.hypot(x, y) > 1)
    found = measured(TwoViews(), (x, y, z), (u, v, w))
    assert (all_of(found)[1:, 0] > 0).sum() <= 1
    assert all_of(found).min() >= 0


@given(st.floats(2, 15), coordinate, step, st.floats(0.02, 0.2))
def test_the_road_says_nothing_of_what_rises_above_the_horizon(x, y, along_m, up_m):
    views = TwoViews()
    point, motion = (x, y, 0.65), (along_m, 0, up_m)
    previous, current = views.rays(point, motion)
    assert views.motion.rotate(previous[0]) @ views.road.down > 0 > current[0] @ views.road.down
    found = measured(views, point, motion, lambda_height=0.0, lambda_anti_parallel=0.0)
    assert found.positive_height[0] == found.anti_parallel[0] == 0


def test_previous_frame_without_rotation_would_flag_static_points():
    """Why q = R p stands for p: at 20 degrees/s and 15 frames/s the literal reading is wrong by 20 mrad."""
    views = TwoViews(yaw_rad=np.deg2rad(20 / 15))
    previous, current = views.rays((6, 2, 2))
    literal = RigidTransform(np.eye(3), views.motion.translation_m)
    found = deviations(previous, current, current_from_previous=literal, road=views.road)
    assert found.epipolar[0] + found.positive_depth[0] > 6e-4 * 2.4
    assert all_of(measured(views, (6, 2, 2))).max() < 1e-12


def test_next_to_the_epipole_nothing_is_defined():
    views = TwoViews(current_m=(0.4, 0, 0.66), yaw_rad=0)
    found = measured(views, [(20, 0.1, 0.66), (20, 0.4, 0.66), (-20, 0.1, 0.66)], (0, 0.5, 0.2))
    assert found.defined.tolist() == [False, True, False]
    assert all_of(found)[:, [0, 2]].max() == 0


def test_rays_that_are_not_valid_are_not_defined():
    views = TwoViews()
    previous, current = views.rays([(4, 1, 0), (4, -1, 1.2), (4, 1, 1)], (0, 0.1, 0))
    previous[0], current[1] = np.nan, np.nan
    seen = {"current_from_previous": views.motion, "road": views.road}
    found = deviations(previous, current, **seen)
    assert found.defined.tolist() == [False, False, True]
    assert np.isfinite(all_of(found)).all()
    deviation, defined = static_camera_deviation(previous, current, **seen, lambda_static_m=0.02)
    assert defined.tolist() == [False, False, True]
    assert not deviation[:2].any()


def test_scale_of_the_motion_is_needed_by_height_and_anti_parallel_alone():
    views = TwoViews()
    previous, current = views.rays([(3, 3, 0.5), (4, -1, 1.2), (4, 1.5, 0.1), (5, -2.5, 0.05)], (0.5, 0.2, 0))
    double = RigidTransform(views.motion.rotation, 2 * views.motion.translation_m)
    one = deviations(previous, current, current_from_previous=views.motion, road=views.road)
    two = deviations(previous, current, current_from_previous=double, road=views.road)
    np.testing.assert_allclose(one.epipolar, two.epipolar, atol=1e-14)
    np.testing.assert_allclose(one.positive_depth, two.positive_depth, atol=1e-14)
    assert np.abs(all_of(one)[2:] - all_of(two)[2:]).max() > 1e-3


def test_geodesic_variant_is_the_angle():
    plain, geodesic = (
        measured(TwoViews(), (4, -1, 1.2), (0, 0.3, 0), variants=v) for v in (Variants(), Variants(geodesic=True))
    )
    np.testing.assert_allclose(geodesic.epipolar, np.arcsin(plain.epipolar))


def test_ungated_height_sees_an_object_at_the_hosts_own_speed():
    views = TwoViews(current_m=(0.4, 0, 0.66), yaw_rad=0)
    point, motion = (3, 1.5, 0.1), (0.4001, 0, 0)  # a hair faster than the ego vehicle: n'.p_n > 0
    assert measured(views, point, motion).positive_height[0] == 0
    assert measured(views, point, motion, variants=Variants(ungated_height=True)).positive_height[0] > 0.01


def test_full_cheirality_sees_rays_that_pass_the_focus_of_contraction():
    views = TwoViews(current_m=(0.4, 0, 0.66), yaw_rad=0)
    point, motion = (-3, 0.4, 0.3), (0, -0.9, 0)  # behind the ego vehicle, from left of its track to the right
    plain, full = (measured(views, point, motion, variants=v) for v in (Variants(), Variants(full_cheirality=True)))
    assert plain.positive_depth[0] == 0
    assert full.positive_depth[0] > 0.1


def test_likelihood_is_the_weighted_mean_with_a_divisor_that_never_changes():
    found = measured(TwoViews(), [(3, 3, 0.5), (5, -2.5, 0.05)], (0.6, 0.2, 0))
    e, d, h, p = all_of(found)
    plain, _ = motion_likelihood(found, ConstraintWeights())
    np.testing.assert_allclose(plain, (e + d + 0.2 * h + 0.2 * p) / 2.4)
    rooted, _ = motion_likelihood(found, ConstraintWeights(), root_sum=True)
    np.testing.assert_allclose(rooted, (np.hypot(e, d) + 0.2 * h + 0.2 * p) / 2.4)
    three, _ = motion_likelihood(found, ConstraintWeights(three_view=1.0), three_view=np.array([0.1, np.nan]))
    np.testing.assert_allclose(three, (e + d + 0.2 * h + 0.2 * p + [0.1, 0]) / 3.4)


def test_bad_calls_are_refused():
    views = TwoViews()
    previous, current = views.rays([(4, 1, 0), (4, 2, 0)])
    with pytest.raises(ShapeError, match="two arrays"):
        deviations(previous, current[:1], current_from_previous=views.motion, road=views.road)
    with pytest.raises(ShapeError, match="static_camera_deviation"):
        deviations(previous, current, current_from_previous=RigidTransform.identity(), road=views.road)
    with pytest.raises(UsageError, match="weights"):
        ConstraintWeights(epipolar=-1)


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


place = st.floats(-10, 10)


@given(place, place, st.floats(0, 4), st.floats(0.1, 0.6), st.floats(0.1, 0.9), st.floats(-0.05, 0.05))
def test_three_views_of_a_static_point_agree(x, y, z, step, next_step, yaw):
    assume(abs(y) > 0.5)
    second = ((step, 0.01, 0.66), yaw)
    third = ((step + next_step, 0.05, 0.66), 2.5 * yaw)
    deviation, defined = three_views((x, y, z), second, third)
    assume(defined[0])  # not next to the epipole of either pair
    assert deviation[0] < 1e-10


def test_three_views_are_defined_where_there_is_parallax():
    views = ((0.4, 0.01, 0.66), 0.01), ((1.0, 0.05, 0.66), 0.025)
    assert three_views([(6, 2, 0), (3, -2, 1), (8, 4, 3), (-4, 2, 0.2)], *views)[1].all()
    assert not three_views((1e5, 3e4, 0.3), ((0.4, 0, 0.66), 0.0), ((0.8, 0, 0.66), 0.0))[1].any()


def test_three_views_see_a_change_of_speed_but_not_parallel_motion_at_constant_speed():
    second, third = ((0.4, 0, 0.66), 0.0), ((0.8, 0, 0.66), 0.0)
    steady, _ = three_views((4, 1.5, 0.3), second, third, ((0.2, 0, 0), (0.2, 0, 0)))
    braking, _ = three_views((4, 1.5, 0.3), second, third, ((0.2, 0, 0), (0.1, 0, 0)))
    assert steady[0] < 1e-12
    assert braking[0] > 1e-3
