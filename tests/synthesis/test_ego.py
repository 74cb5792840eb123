"""The ego vehicle as its own cameras see it, what the bus makes of a drive, and where the sensors really sit."""

from functools import partial

import numpy as np
import pytest

from bench.harness.digests import digest_recording
from bench.recordings import open_native
from bench.synthesis import read_scenario
from bench.synthesis.ego import bus_report, mounted_rig, own_body
from bench.synthesis.production import DECIMALS
from bench.synthesis.scenario import BusSpec
from bench.times import SECOND_NS
from tests.synthesis.conftest import REAL, drive
from tests.synthesis.pictures import volume_m3


def test_the_ego_vehicle_is_as_wide_to_the_left_as_to_the_right_and_faces_outwards():
    body = own_body()
    assert body.corners_m[..., 1].max() == pytest.approx(-body.corners_m[..., 1].min())
    assert body.corners_m[..., 2].min() >= -1e-9
    assert 5 < volume_m3(body) < 9  # that of a car


ERRORS = ("speed_scale_sigma", "yaw_rate_noise_degps", "yaw_rate_bias_degps", "yaw_rate_step_degps", "speed_step_kmh")
PERFECT = dict.fromkeys(ERRORS, 0.0)
TICK_M = 2 * np.pi * 0.31 / 96


ten_seconds = partial(drive, from_s=0, to_s=10)


def reported(path, seed=0, **changes):
    return bus_report(path, BusSpec(**(PERFECT | changes)), np.random.default_rng(seed))


def test_ideal_signals_are_the_truth():
    path = ten_seconds([0, 5], [9.0, 2.0], 0.3)
    report = bus_report(path, None, np.random.default_rng(0))
    speeds_mps, yaw_rates_radps = path.signals(report.times_ns)
    assert np.array_equal(report.speeds_mps, speeds_mps)
    assert np.array_equal(report.yaw_rates_radps, yaw_rates_radps)
    assert set(np.diff(report.times_ns).tolist()) == {10_000_000}


def test_steady_speed_is_counted_exactly():
    for speed_mps in (0.5, 3.0, 13.9, -2.0):  # in reverse it has no sign
        report = reported(ten_seconds([0.0], speed_mps))
        assert report.speeds_mps[5:] == pytest.approx(np.full(len(report.times_ns) - 5, abs(speed_mps)), rel=1e-6)
        assert set(np.diff(report.times_ns).tolist()) == {20_000_000}


def test_creep_below_a_tick_in_the_time_of_patience_is_reported_as_standing():
    slow_mps = 0.95 * TICK_M / 0.2  # about 0.1 m/s: the paper's static special case, and yet 6 mm between two images
    creeping = ten_seconds([0.0], slow_mps)
    assert creeping.distances_m[-1] > 0.9
    assert reported(creeping).speeds_mps.max() == 0.0
    assert reported(ten_seconds([0.0], 1.1 * TICK_M / 0.2)).speeds_mps[50:].min() > 0.09


def test_starting_from_standstill_is_reported_late_and_stopping_ends_at_zero():
    path = ten_seconds([0, 2, 4, 6, 8], [0.0, 0.0, 2.0, 2.0, 0.0])
    report = reported(path)
    seconds, true_mps = report.times_ns / SECOND_NS, path.signals(report.times_ns)[0]
    assert report.speeds_mps[seconds <= 2.0].max() == 0.0
    first = seconds[np.flatnonzero(report.speeds_mps)[0]]
    # The second tick comes after one to two ticks of way at 1 m/s^2.
    assert 2.0 + np.sqrt(2 * TICK_M) < first < 2.0 + np.sqrt(2 * 2 * TICK_M) + 0.02
    assert report.speeds_mps[seconds > 8.25].max() == 0.0
    moving = (seconds > 2.5) & (seconds < 7.7)
    assert np.abs(report.speeds_mps - true_mps)[moving].max() < 0.1


def test_the_bus_integrates_to_the_true_way_within_its_errors():
    path = ten_seconds([0, 4, 8], [8.0, 3.0, 9.0], 0.2)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        report = bus_report(path, BusSpec(), rng)
        way_m = np.sum((report.speeds_mps[1:] + report.speeds_mps[:-1]) / 2) * 0.02
        turn_deg = np.degrees(np.sum((report.yaw_rates_radps[1:] + report.yaw_rates_radps[:-1]) / 2) * 0.02)
        assert way_m == pytest.approx(path.distances_m[-1], rel=4 * 0.005)
        # Ten seconds of a bias of 0.1 deg/s, and noise that sums up to 0.1 * 0.02 * sqrt(500).
        assert abs(turn_deg - np.degrees(2.0)) < 4 * (10 * 0.1 + 0.05)
        assert abs(turn_deg - np.degrees(2.0)) > 1e-4


def test_a_bias_and_a_scale_belong_to_the_recording_and_noise_to_the_message():
    path = ten_seconds([0.0], 6.0, 0.1)
    biased = reported(path, yaw_rate_bias_degps=0.2)
    assert np.ptp(biased.yaw_rates_radps) < 1e-12
    assert abs(np.degrees(biased.yaw_rates_radps[0] - 0.1)) > 0.001
    noisy = reported(path, yaw_rate_noise_degps=0.1)
    assert np.degrees((noisy.yaw_rates_radps - 0.1).std()) == pytest.approx(0.1, rel=0.15)
    worn = reported(path, speed_scale_sigma=0.01)
    assert np.ptp(worn.speeds_mps[5:]) < 1e-5
    assert 1e-4 < abs(worn.speeds_mps[-1] / 6.0 - 1) < 0.04
    stepped = reported(path, yaw_rate_noise_degps=0.1, yaw_rate_step_degps=0.05)
    steps = np.degrees(stepped.yaw_rates_radps) / 0.05
    assert steps == pytest.approx(np.rint(steps), abs=1e-9)


WRITTEN = 3 * 10.0**-DECIMALS


def test_the_recording_states_the_nominal_calibration_and_the_truth_the_true_one(rendered):
    folder = rendered(REAL)
    scenario = read_scenario(folder / "scenario.yaml")
    offsets = []
    for spec in scenario.recordings:
        root, rig = folder / "out" / spec.name, mounted_rig(scenario, spec)
        recorded, exact = open_native(root), open_native(root, calibration="exact", ego_motion="exact")
        for opened, cameras, lidar in (
            (recorded, rig.recorded_cameras, rig.recorded_vehicle_from_lidar),
            (exact, rig.cameras, rig.vehicle_from_lidar),
        ):
            mounting = opened.cameras["front"].vehicle_from_camera
            assert mounting.matrix == pytest.approx(cameras["front"].vehicle_from_camera.matrix, abs=WRITTEN)
            assert opened.vehicle_from_lidar.matrix == pytest.approx(lidar.matrix, abs=WRITTEN)
            assert opened.cameras["front"].road.height_m == pytest.approx(mounting.translation_m[2])
        assert recorded.cameras["front"].vehicle_from_camera.translation_m.tolist() == [3.7, 0.0, 0.66]
        off = recorded.cameras["front"].vehicle_from_camera.inverse() @ exact.cameras["front"].vehicle_from_camera
        angle_deg = np.degrees(np.arccos((np.trace(off.rotation) - 1) / 2))
        assert 0.001 < angle_deg < 0.6
        assert np.linalg.norm(off.translation_m) < 0.03
        assert recorded.cameras["front"].ego_body is not None
        assert np.array_equal(recorded.cameras["front"].ego_body, exact.cameras["front"].ego_body)
        # The bus knows three degrees of freedom, the truth all six.
        time_ns = recorded.images["front"][0].timestamp_ns
        assert recorded.trajectory.world_from_vehicle(time_ns).rotation[2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
        assert abs(exact.trajectory.world_from_vehicle(time_ns).rotation[2, 0]) > 1e-6
        # A run says which of them it was made with.
        halves = open_native(root, ego_motion="exact"), open_native(root, calibration="exact")
        assert len({digest_recording(opened) for opened in (recorded, *halves, exact)}) == 4
        offsets.append(off.matrix)
    assert not np.allclose(offsets[0], offsets[1])
