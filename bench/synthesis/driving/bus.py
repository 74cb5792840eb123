"""Bus signals of a drive: wheel ticks and a yaw-rate sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.driving.path import SECOND_NS, Path
from bench.synthesis.scenario import BusSpec

IDEAL_INTERVAL_NS = 10_000_000
LEAD_IN_NS = SECOND_NS  # wheels rotate before the path begins, at its first speed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BusReport:
    """Messages of the bus.

    Attributes:
        times_ns: (N,) int64, scene clock.
        speeds_mps: (N,) float64, >= 0; the gear gives the direction.
        yaw_rates_radps: (N,) float64, positive to the left.
    """

    times_ns: NDArray[np.int64]
    speeds_mps: NDArray[np.float64]
    yaw_rates_radps: NDArray[np.float64]


def bus_report(path: Path, spec: BusSpec | None, rng: np.random.Generator) -> BusReport:
    """Every message between the first and the last node of a path.

    Args:
        path: of the rear axle's middle.
        spec: None for exact signals.
        rng: phase of the ticks, and the sensors' errors.
    """
    interval_ns = IDEAL_INTERVAL_NS if spec is None else round(SECOND_NS / spec.rate_hz)
    first, last = -(-int(path.nodes_ns[0]) // interval_ns), int(path.nodes_ns[-1]) // interval_ns
    times_ns = np.arange(first, last + 1, dtype=np.int64) * interval_ns
    speeds_mps, yaw_rates_radps = path.signals(times_ns)
    speeds_mps = np.abs(speeds_mps)
    if spec is None:
        return BusReport(times_ns=times_ns, speeds_mps=speeds_mps, yaw_rates_radps=yaw_rates_radps)
    scale, phase, bias = 1.0 + rng.normal(0.0, spec.speed_scale_sigma), rng.uniform(), rng.normal()
    if spec.ticks_per_turn:
        ticks_ns = _tick_times_ns(path, 2 * np.pi * spec.tyre_radius_m / spec.ticks_per_turn / scale, phase)
        speeds_mps = _counted(times_ns, ticks_ns, interval_ns=interval_ns, spec=spec)
    else:
        speeds_mps = speeds_mps * scale
    errors = np.radians(bias * spec.yaw_rate_bias_degps + rng.normal(size=len(times_ns)) * spec.yaw_rate_noise_degps)
    return BusReport(
        times_ns=times_ns,
        speeds_mps=_stepped(speeds_mps, spec.speed_step_kmh / 3.6),
        yaw_rates_radps=_stepped(yaw_rates_radps + errors, float(np.radians(spec.yaw_rate_step_degps))),
    )


def _tick_times_ns(path: Path, tick_m: float, phase: float) -> NDArray[np.float64]:
    """Times at which the wheel passes each tick, (M,) float64, scene clock."""
    distances_m = np.abs(path.distances_m - path.distances_m[0])
    lead_in_m = abs(float(path.speeds_mps[0])) * LEAD_IN_NS / SECOND_NS
    distances_m = np.concatenate([[-lead_in_m], distances_m])
    nodes_ns = np.concatenate([[path.nodes_ns[0] - LEAD_IN_NS], path.nodes_ns]).astype(np.float64)
    ticks_m = (np.arange(np.ceil(-lead_in_m / tick_m), np.ceil(distances_m[-1] / tick_m)) + phase) * tick_m
    ticks_m = ticks_m[(ticks_m > distances_m[0]) & (ticks_m < distances_m[-1])]
    after = np.searchsorted(distances_m, ticks_m)  # the distance grows from the node before, so the step below is not 0
    part = (ticks_m - distances_m[after - 1]) / (distances_m[after] - distances_m[after - 1])
    return np.asarray(nodes_ns[after - 1] + part * (nodes_ns[after] - nodes_ns[after - 1]))


def _counted(
    times_ns: NDArray[np.int64], ticks_ns: NDArray[np.float64], *, interval_ns: int, spec: BusSpec
) -> NDArray[np.float64]:
    """Speed from ticks, as control units count: distance between the last ticks of two messages over their time.

    A message without a new tick repeats the speed before it, or what one tick up to now would make if that is less;
    after `standstill_after_s` without any it is 0, and the first tick from standstill only starts the clock.
    """
    tick_m, standstill_ns = 2 * np.pi * spec.tyre_radius_m / spec.ticks_per_turn, spec.standstill_after_s * SECOND_NS
    counts = np.searchsorted(ticks_ns, times_ns, side="right").tolist()
    before = np.searchsorted(ticks_ns, times_ns - interval_ns, side="right").tolist()
    speeds_mps, speed = np.zeros(len(times_ns)), 0.0
    for row, (count, start) in enumerate(zip(counts, before, strict=True)):
        if count > start:
            fresh = start == 0 or ticks_ns[start] - ticks_ns[start - 1] > standstill_ns
            first = start if fresh else start - 1
            seconds = (ticks_ns[count - 1] - ticks_ns[first]) / SECOND_NS
            speed = (count - 1 - first) * tick_m / seconds if count - 1 > first else 0.0
        elif count:
            since_tick_ns = times_ns[row] - ticks_ns[count - 1]
            speed = 0.0 if since_tick_ns > standstill_ns else min(speed, tick_m * SECOND_NS / max(since_tick_ns, 1.0))
        speeds_mps[row] = speed
    return speeds_mps


def _stepped(values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    return values if step == 0.0 else np.asarray(np.rint(values / step) * step)
