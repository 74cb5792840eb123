from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.egomotion import read_bus_signals, read_tum
from bench.synthesis import read_scenario, synthesize
from bench.synthesis.motion import SECOND_NS, ActorPath, host_path


def test_host_drives_a_quarter_circle() -> None:
    # 10 m/s and 90 deg/s: a quarter circle of radius 20/pi in one second.
    path = host_path(times_s=0.0, speeds_mps=10.0, yaw_rates_radps=np.pi / 2, first_ns=0, last_ns=SECOND_NS)
    end = path.at([SECOND_NS])
    radius_m = 20.0 / np.pi
    assert end.positions_m[0] == pytest.approx([radius_m, radius_m], abs=1e-6)
    assert end.yaws_rad[0] == pytest.approx(np.pi / 2)
    assert end.distances_m[0] == pytest.approx(10.0)


def test_host_stands_at_the_origin_at_time_zero() -> None:
    path = host_path(
        times_s=[0, 1], speeds_mps=[-1, -3], yaw_rates_radps=[0.1, 0], first_ns=-SECOND_NS, last_ns=SECOND_NS
    )
    poses = path.at([-SECOND_NS, 0, SECOND_NS])
    assert poses.positions_m[1] == pytest.approx([0, 0], abs=1e-12)
    assert poses.yaws_rad[1] == 0
    assert poses.distances_m == pytest.approx([1.0, 0.0, -2.0])
    assert poses.positions_m[0, 0] > 0  # in reverse it comes from ahead


def test_actor_velocity_is_the_change_of_its_place() -> None:
    path = ActorPath(start_m=np.array([3.0, -2.0]), heading_rad=0.7, speed_mps=4.0, yaw_rate_radps=-0.5)
    before, after = path.at([999_000_000, 1_001_000_000]).positions_m
    assert path.velocity_mps(SECOND_NS)[:2] == pytest.approx((after - before) / 0.002, abs=1e-6)
    assert np.linalg.norm(path.velocity_mps(SECOND_NS)) == pytest.approx(4.0)


def test_bus_signals_integrate_to_the_true_poses(scenario_file: Path, tmp_path: Path) -> None:
    synthesize(scenario_file, tmp_path / "out", workers=1)
    for spec in read_scenario(scenario_file).recordings:
        root = tmp_path / "out" / spec.name
        bus, truth = read_bus_signals(root / "egomotion.csv").trajectory(), read_tum(root / "truth" / "poses.csv")
        assert np.array_equal(bus.timestamps_ns, truth.timestamps_ns)
        first_ns = int(truth.timestamps_ns[0])
        bus_from_truth = bus.world_from_vehicle(first_ns) @ truth.world_from_vehicle(first_ns).inverse()
        _, positions_m, _ = truth.at(truth.timestamps_ns)
        _, integrated_m, _ = bus.at(bus.timestamps_ns)
        assert np.abs(integrated_m - bus_from_truth.apply(positions_m)).max() < 1e-3
