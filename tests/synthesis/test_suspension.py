"""The ego vehicle's body on its springs."""

from __future__ import annotations

import numpy as np
import pytest

from bench.synthesis.motion import EgoMotion, Path, driven_path, ego_motion, road_profile
from bench.synthesis.scenario import BumpSpec, SuspensionSpec
from bench.times import SECOND_NS

SMOOTH = SuspensionSpec(road_class=None)


def drive(times_s: list[float], speeds_mps: list[float] | float, yaw_rate_radps: list[float] | float = 0.0) -> Path:
    return driven_path(
        times_s=times_s,
        speeds_mps=speeds_mps,
        yaw_rates_radps=yaw_rate_radps,
        first_ns=-SECOND_NS,
        last_ns=8 * SECOND_NS,
    )


def sprung(path: Path, spec: SuspensionSpec = SMOOTH, **more: object) -> EgoMotion:
    return ego_motion(path, spec, rng=np.random.default_rng(3), **more)  # type: ignore[arg-type]


def test_braking_dips_the_nose_and_accelerating_lifts_it() -> None:
    for change_mps2, lower in ((-2.0, True), (2.0, False)):
        ego = sprung(drive([0, 4], [10.0, 10.0 + 4 * change_mps2]))
        nose, tail = (ego.at([3 * SECOND_NS]).transform().apply(np.array([x, 0.0, 0.5])) for x in (3.7, -0.9))
        assert (nose[2] < tail[2]) == lower
        # 2 m/s^2 at 0.3 degrees for each, over the 4.6 m between them.
        assert abs(nose[2] - tail[2]) == pytest.approx(4.6 * np.sin(np.radians(0.6)), rel=0.01)


def test_in_reverse_braking_dips_the_tail() -> None:
    ego = sprung(drive([0, 2], [-4.0, 0.0]))
    forward_world = ego.at([int(1.9 * SECOND_NS)]).rotations[0, :, 0]
    assert forward_world[2] > 0.005


def test_a_left_bend_rolls_the_body_to_the_right() -> None:
    for yaw_rate_radps, left_is_higher in ((0.2, True), (-0.2, False)):
        ego = sprung(drive([0.0], 10.0, yaw_rate_radps))
        left_world = ego.at([7 * SECOND_NS]).rotations[0, :, 1]
        assert (left_world[2] > 0) == left_is_higher
        assert abs(left_world[2]) == pytest.approx(np.sin(np.radians(0.45 * 2.0)), rel=0.01)


def test_the_answer_to_a_sudden_brake_overshoots_by_its_damping_and_swings_at_its_frequency() -> None:
    # A step into a second-order system: first peak after half a damped period, higher by exp(-pi z / sqrt(1 - z^2)).
    ego = sprung(drive([0, 6], [18.0, 0.0]))
    assert ego.attitude is not None
    pitch_deg, seconds = np.degrees(ego.attitude.pitch_rad), ego.nodes_ns / SECOND_NS
    braking = (seconds > 0) & (seconds < 5.5)
    ratio = 0.35
    peak = int(np.argmax(pitch_deg[braking]))
    damped_hz = 1.3 * np.sqrt(1 - ratio**2)
    assert seconds[braking][peak] == pytest.approx(0.5 / damped_hz, abs=0.005)
    assert pitch_deg[braking][peak] == pytest.approx(
        0.9 * (1 + np.exp(-np.pi * ratio / np.sqrt(1 - ratio**2))), rel=0.01
    )
    assert pitch_deg[braking][-1] == pytest.approx(0.9, rel=0.01)


def test_a_rigid_car_follows_its_path_exactly() -> None:
    path = drive([0, 3], [8.0, 2.0], [0.3, -0.1])
    rigid, times_ns = ego_motion(path, None, rng=np.random.default_rng(0)), np.arange(0, 7) * SECOND_NS
    poses, expected = rigid.at(times_ns), path.at(times_ns)
    assert np.array_equal(poses.rotations, expected.rotations)
    assert np.array_equal(poses.positions_m, expected.positions_m)


def test_steady_driving_on_a_smooth_road_is_level() -> None:
    path = drive([0.0], 12.0)
    poses = sprung(path).at([0, 3 * SECOND_NS])
    assert poses.rotations == pytest.approx(path.at([0, 3 * SECOND_NS]).rotations, abs=1e-12)
    assert poses.positions_m == pytest.approx(path.at([0, 3 * SECOND_NS]).positions_m, abs=1e-12)


def test_the_centre_of_the_sway_stays_on_its_way() -> None:
    path = drive([0, 2, 4], [10.0, 4.0, 9.0], [0.2, -0.3, 0.1])
    ego, times_ns = sprung(path), np.arange(0, 40) * (SECOND_NS // 10)
    centre_m = np.array(SMOOTH.centre_m)
    for poses in (ego.at(times_ns), path.at(times_ns)):
        places_m = poses.rotations @ centre_m + poses.positions_m
        assert places_m[:, 2] == pytest.approx(np.full(len(times_ns), centre_m[2]), abs=1e-12)
    assert ego.at(times_ns).rotations @ centre_m + ego.at(times_ns).positions_m == pytest.approx(places_m, abs=1e-12)


def test_a_bump_lifts_the_front_first() -> None:
    path = drive([0.0], 5.0)
    ego = sprung(path, bumps=[BumpSpec(at_m=12.7, height_m=0.05)])
    assert ego.attitude is not None
    pitch_deg = np.degrees(ego.attitude.pitch_rad)
    # The front wheels, 2.7 m ahead, reach it after 2 s and the rear ones after 2.54 s.
    before, front, rear = (np.searchsorted(ego.nodes_ns, s * SECOND_NS) for s in (1.9, 2.1, 2.64))
    assert abs(pitch_deg[before]) < 1e-3
    assert pitch_deg[front] < -0.1
    assert ego.attitude.heave_m[front] > 0.002
    assert pitch_deg[rear] - pitch_deg[front] > 0.1


def test_roughness_is_that_of_its_class() -> None:
    # ISO 8608: between two wavelengths the variance is the integral of Gd(n0) (n / n0)^-2.
    ways_m = np.arange(0, 1500, 0.1)
    wanted_m2 = 16e-6 * 0.1**2 * (1 / 0.05 - 1 / 2.83)
    roads = [road_profile("A", (), np.random.default_rng(seed)).heights_m(ways_m) for seed in range(4)]
    assert np.mean([side.var() for road in roads for side in road]) == pytest.approx(wanted_m2, rel=0.1)
    rougher = road_profile("B", (), np.random.default_rng(0)).heights_m(ways_m)[0]
    assert rougher == pytest.approx(2 * roads[0][0])  # four times the power


def test_a_standing_car_stays_still_and_a_driving_one_sways_smoothly() -> None:
    standing = sprung(drive([0.0], 0.0), SuspensionSpec(road_class="B"))
    assert standing.attitude is not None
    assert np.ptp(standing.attitude.pitch_rad) < 1e-9
    driving = sprung(drive([0.0], 12.0), SuspensionSpec(road_class="B"))
    assert driving.attitude is not None
    assert 0.02 < np.degrees(driving.attitude.pitch_rad.std()) < 0.3
    # Linear between nodes is good to a hundredth of a millidegree: second differences are 8 times that error.
    assert np.degrees(np.abs(np.diff(driving.attitude.pitch_rad, 2)).max()) < 8e-5
