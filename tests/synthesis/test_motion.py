from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bench.egomotion import read_bus_signals, read_tum
from bench.synthesis.motion import driven_path
from bench.times import SECOND_NS
from tests.synthesis.conftest import IDEAL


def test_ego_vehicle_drives_a_quarter_circle() -> None:
    # 10 m/s and 90 deg/s: a quarter circle of radius 20/pi in one second.
    path = driven_path(times_s=0.0, speeds_mps=10.0, yaw_rates_radps=np.pi / 2, first_ns=0, last_ns=SECOND_NS)
    end = path.at([SECOND_NS])
    radius_m = 20.0 / np.pi
    assert end.positions_m[0] == pytest.approx([radius_m, radius_m, 0.0], abs=1e-6)
    assert end.rotations[0] == pytest.approx(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]))
    assert end.distances_m[0] == pytest.approx(10.0)


def test_ego_vehicle_stands_at_the_origin_at_time_zero() -> None:
    path = driven_path(
        times_s=[0, 1], speeds_mps=[-1, -3], yaw_rates_radps=[0.1, 0], first_ns=-SECOND_NS, last_ns=SECOND_NS
    )
    poses = path.at([-SECOND_NS, 0, SECOND_NS])
    assert poses.positions_m[1] == pytest.approx([0, 0, 0], abs=1e-12)
    assert poses.rotations[1] == pytest.approx(np.eye(3), abs=1e-12)
    assert poses.distances_m == pytest.approx([1.0, 0.0, -2.0])
    assert poses.positions_m[0, 0] > 0  # in reverse it comes from ahead


def test_actor_velocity_is_the_change_of_its_place() -> None:
    path = driven_path(
        times_s=[0, 2],
        speeds_mps=[3.0, 5.0],
        yaw_rates_radps=-0.5,
        first_ns=0,
        last_ns=2 * SECOND_NS,
        through=(3.0, -2.0, 0.7),
        through_ns=SECOND_NS // 2,
        floor_m=0.1,
    )
    before, after = path.at([999_000_000, 1_001_000_000]).positions_m
    assert path.velocity_mps(SECOND_NS) == pytest.approx((after - before) / 0.002, abs=1e-5)
    assert np.linalg.norm(path.velocity_mps(SECOND_NS)) == pytest.approx(4.0)
    there = path.at([SECOND_NS // 2])
    assert there.positions_m[0] == pytest.approx([3.0, -2.0, 0.1])
    assert there.rotations[0, :2, 0] == pytest.approx([np.cos(0.7), np.sin(0.7)])


def test_bus_signals_integrate_to_the_true_poses(rendered: Callable[[str], Path]) -> None:
    for name in ("crossing", "reversing"):
        root = rendered(IDEAL) / "out" / name
        bus, truth = read_bus_signals(root / "egomotion.csv").trajectory(), read_tum(root / "truth" / "poses.csv")
        first_ns = int(bus.timestamps_ns[0])
        bus_from_truth = bus.world_from_vehicle(first_ns) @ truth.world_from_vehicle(first_ns).inverse()
        _, positions_m, _ = truth.at(bus.timestamps_ns)
        _, integrated_m, _ = bus.at(bus.timestamps_ns)
        assert np.abs(integrated_m - bus_from_truth.apply(positions_m)).max() < 1e-3


def test_a_ramp_spreads_the_brake_and_keeps_the_way() -> None:
    drive = {"times_s": [0, 1, 3], "speeds_mps": [6.0, 6.0, 0.0], "yaw_rates_radps": 0.0}
    sudden = driven_path(**drive, first_ns=0, last_ns=4 * SECOND_NS)  # type: ignore[arg-type]
    gentle = driven_path(**drive, first_ns=0, last_ns=4 * SECOND_NS, ramp_s=0.4)  # type: ignore[arg-type]
    jerks = [np.abs(np.diff(path.speeds_mps, 2)).max() / 1e-6 for path in (sudden, gentle)]
    assert jerks[0] > 2000  # 3 m/s^2 within a millisecond
    assert jerks[1] == pytest.approx(3.0 / 0.4, rel=0.01)
    assert gentle.speeds_mps.min() == pytest.approx(0.0, abs=1e-12)
    assert gentle.speeds_mps[-1] == pytest.approx(0.0, abs=1e-12)
    assert gentle.distances_m[-1] == pytest.approx(sudden.distances_m[-1], abs=1e-3)
    away = (np.abs(gentle.nodes_ns - SECOND_NS) > 0.2e9) & (np.abs(gentle.nodes_ns - 3 * SECOND_NS) > 0.2e9)
    assert gentle.speeds_mps[away] == pytest.approx(sudden.speeds_mps[away], abs=1e-9)
