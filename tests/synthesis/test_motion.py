"""Motion in the plane, and the ego vehicle's body on its springs."""

import numpy as np
import pytest

from bench.egomotion.files import read_bus_signals, read_tum
from bench.synthesis.motion import ego_motion, road_profile
from bench.synthesis.scenario import SuspensionSpec
from bench.times import SECOND_NS
from tests.synthesis.conftest import IDEAL, drive


def test_ego_vehicle_drives_a_quarter_circle():
    # 10 m/s and 90 deg/s: a quarter circle of radius 20/pi in one second.
    end = drive(0.0, 10.0, np.pi / 2).at([SECOND_NS])
    radius_m = 20.0 / np.pi
    assert end.positions_m[0] == pytest.approx([radius_m, radius_m, 0.0], abs=1e-6)
    assert end.rotations[0] == pytest.approx(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]))
    assert end.distances_m[0] == pytest.approx(10.0)
    # In reverse it comes from ahead, and stands at the origin at time 0.
    path = drive([0, 1], [-1, -3], [0.1, 0])
    poses = path.at([-SECOND_NS, 0, SECOND_NS])
    assert poses.positions_m[1] == pytest.approx([0, 0, 0], abs=1e-12)
    assert poses.rotations[1] == pytest.approx(np.eye(3), abs=1e-12)
    assert poses.distances_m == pytest.approx([1.0, 0.0, -2.0])
    assert poses.positions_m[0, 0] > 0


def test_actor_velocity_is_the_change_of_its_place():
    path = drive([0, 2], [3.0, 5.0], -0.5, through=(3.0, -2.0, 0.7), through_ns=SECOND_NS // 2, floor_m=0.1)
    before, after = path.at([999_000_000, 1_001_000_000]).positions_m
    assert path.velocity_mps(SECOND_NS) == pytest.approx((after - before) / 0.002, abs=1e-5)
    assert np.linalg.norm(path.velocity_mps(SECOND_NS)) == pytest.approx(4.0)
    there = path.at([SECOND_NS // 2])
    assert there.positions_m[0] == pytest.approx([3.0, -2.0, 0.1])
    assert there.rotations[0, :2, 0] == pytest.approx([np.cos(0.7), np.sin(0.7)])


def test_bus_signals_integrate_to_the_true_poses(rendered):
    for name in ("crossing", "reversing"):
        root = rendered(IDEAL) / "out" / name
        bus, truth = read_bus_signals(root / "egomotion.csv"), read_tum(root / "truth" / "poses.csv")
        first_ns = int(bus.timestamps_ns[0])
        bus_from_truth = bus.world_from_vehicle(first_ns) @ truth.world_from_vehicle(first_ns).inverse()
        _, positions_m, _ = truth.at(bus.timestamps_ns)
        _, integrated_m, _ = bus.at(bus.timestamps_ns)
        assert np.abs(integrated_m - bus_from_truth.apply(positions_m)).max() < 1e-3


def test_a_ramp_spreads_the_brake_and_keeps_the_way():
    sudden, gentle = (drive([0, 1, 3], [6.0, 6.0, 0.0], ramp_s=ramp_s) for ramp_s in (0.0, 0.4))
    jerks = [np.abs(np.diff(path.speeds_mps, 2)).max() / 1e-6 for path in (sudden, gentle)]
    assert jerks[0] > 2000  # 3 m/s^2 within a millisecond
    assert jerks[1] == pytest.approx(3.0 / 0.4, rel=0.01)
    assert gentle.speeds_mps.min() == pytest.approx(0.0, abs=1e-12)
    assert gentle.speeds_mps[-1] == pytest.approx(0.0, abs=1e-12)
    assert gentle.distances_m[-1] == pytest.approx(sudden.distances_m[-1], abs=1e-3)
    away = (np.abs(gentle.nodes_ns - SECOND_NS) > 0.2e9) & (np.abs(gentle.nodes_ns - 3 * SECOND_NS) > 0.2e9)
    assert gentle.speeds_mps[away] == pytest.approx(sudden.speeds_mps[away], abs=1e-9)


SMOOTH = SuspensionSpec(road_class=None)


def sprung(path, spec=SMOOTH):
    return ego_motion(path, spec, rng=np.random.default_rng(3))


def test_braking_dips_the_nose_and_accelerating_lifts_it():
    for change_mps2, lower in ((-2.0, True), (2.0, False)):
        ego = sprung(drive([0, 4], [10.0, 10.0 + 4 * change_mps2]))
        nose, tail = (ego.at([3 * SECOND_NS]).transform().apply(np.array([x, 0.0, 0.5])) for x in (3.7, -0.9))
        assert (nose[2] < tail[2]) == lower
        # 2 m/s^2 at 0.3 degrees for each, over the 4.6 m between them.
        assert abs(nose[2] - tail[2]) == pytest.approx(4.6 * np.sin(np.radians(0.6)), rel=0.01)
    reversing = sprung(drive([0, 2], [-4.0, 0.0])).at([int(1.9 * SECOND_NS)])
    assert reversing.rotations[0, 2, 0] > 0.005  # braking in reverse dips the tail


def test_a_left_bend_rolls_the_body_to_the_right():
    for yaw_rate_radps, left_is_higher in ((0.2, True), (-0.2, False)):
        ego = sprung(drive([0.0], 10.0, yaw_rate_radps))
        left_world = ego.at([7 * SECOND_NS]).rotations[0, :, 1]
        assert (left_world[2] > 0) == left_is_higher
        assert abs(left_world[2]) == pytest.approx(np.sin(np.radians(0.45 * 2.0)), rel=0.01)


def test_the_answer_to_a_sudden_brake_overshoots_by_its_damping_and_swings_at_its_frequency():
    # A step into a second-order system: first peak after half a damped period, higher by exp(-pi z / sqrt(1 - z^2)).
    ego = sprung(drive([0, 6], [18.0, 0.0]))
    pitch_deg, seconds = np.degrees(ego.attitude.pitch_rad), ego.nodes_ns / SECOND_NS
    braking = (seconds > 0) & (seconds < 5.5)
    ratio, damped = 0.35, np.sqrt(1 - 0.35**2)
    peak = int(np.argmax(pitch_deg[braking]))
    assert seconds[braking][peak] == pytest.approx(0.5 / (1.3 * damped), abs=0.005)
    assert pitch_deg[braking][peak] == pytest.approx(0.9 * (1 + np.exp(-np.pi * ratio / damped)), rel=0.01)
    assert pitch_deg[braking][-1] == pytest.approx(0.9, rel=0.01)


def test_a_rigid_car_follows_its_path_exactly():
    path = drive([0, 3], [8.0, 2.0], [0.3, -0.1])
    rigid, times_ns = ego_motion(path, None, rng=np.random.default_rng(0)), np.arange(0, 7) * SECOND_NS
    poses, expected = rigid.at(times_ns), path.at(times_ns)
    assert np.array_equal(poses.rotations, expected.rotations)
    assert np.array_equal(poses.positions_m, expected.positions_m)
    steady = drive([0.0], 12.0)  # on a smooth road a car on springs is level, too
    poses, expected = sprung(steady).at(times_ns), steady.at(times_ns)
    assert poses.rotations == pytest.approx(expected.rotations, abs=1e-12)
    assert poses.positions_m == pytest.approx(expected.positions_m, abs=1e-12)


def test_roughness_is_that_of_its_class():
    # ISO 8608: between two wavelengths the variance is the integral of Gd(n0) (n / n0)^-2.
    ways_m = np.arange(0, 1500, 0.1)
    wanted_m2 = 16e-6 * 0.1**2 * (1 / 0.05 - 1 / 2.83)
    roads = [road_profile("A", np.random.default_rng(seed)).heights_m(ways_m) for seed in range(4)]
    assert np.mean([side.var() for road in roads for side in road]) == pytest.approx(wanted_m2, rel=0.1)
    rougher = road_profile("B", np.random.default_rng(0)).heights_m(ways_m)[0]
    assert rougher == pytest.approx(2 * roads[0][0])  # four times the power


def test_a_standing_car_stays_still_and_a_driving_one_sways_smoothly():
    standing = sprung(drive([0.0], 0.0), SuspensionSpec(road_class="B"))
    assert np.ptp(standing.attitude.pitch_rad) < 1e-9
    driving = sprung(drive([0.0], 12.0), SuspensionSpec(road_class="B"))
    assert 0.02 < np.degrees(driving.attitude.pitch_rad.std()) < 0.3
    # Linear between nodes is good to a hundredth of a millidegree: second differences are 8 times that error.
    assert np.degrees(np.abs(np.diff(driving.attitude.pitch_rad, 2)).max()) < 8e-5
