"""How a body sways on its springs: pitch, roll and heave over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.driving.path import SECOND_NS, STEP_NS, Path
from bench.synthesis.driving.roughness import RoadProfile
from bench.synthesis.scenario import SuspensionSpec

SETTLING_NODES = 3000  # 3 s of steady driving before a path begins: the body has forgotten how it began


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sway:
    """The attitude of a body against its level self.

    Attributes:
        pitch_rad: (K,) float64, about the y axis: nose down is positive, as ISO 8855 has it.
        roll_rad: (K,) float64, about the x axis: right side down is positive.
        heave_m: (K,) float64, upwards.
    """

    pitch_rad: NDArray[np.float64]
    roll_rad: NDArray[np.float64]
    heave_m: NDArray[np.float64]


def sway(path: Path, road: RoadProfile, spec: SuspensionSpec) -> Sway:
    """How the body answers to braking, bends and the road, at the nodes of a path.

    Inertia moves the body as a force on its springs: towards the angle of steady braking or cornering, with the
    overshoot of its damping. The road moves it through springs and dampers both (base excitation). Before the first
    node the host drove steadily.

    Args:
        path: in the plane.
        road: below the wheels, along the way of the rear axle.
        spec: of the suspension.
    """
    accelerations_mps2 = _led_in(np.gradient(path.speeds_mps, STEP_NS / SECOND_NS))
    lateral_mps2 = _led_in(path.speeds_mps * path.yaw_rates_radps)
    lead_in_m = np.arange(-SETTLING_NODES, 0) * (STEP_NS / SECOND_NS) * path.speeds_mps[0]
    ways_m = np.concatenate([path.distances_m[0] + lead_in_m, path.distances_m])
    front, rear = (road.heights_m(ways_m + ahead_m) for ahead_m in (spec.wheelbase_m, 0.0))
    forced, carried = _answers(spec)
    return Sway(
        pitch_rad=_answer(forced, -np.radians(spec.pitch_deg_per_mps2) * accelerations_mps2)
        + _answer(carried, (rear[0] + rear[1] - front[0] - front[1]) / 2 / spec.wheelbase_m),
        roll_rad=_answer(forced, np.radians(spec.roll_deg_per_mps2) * lateral_mps2)
        + _answer(carried, (front[0] + rear[0] - front[1] - rear[1]) / 2 / spec.track_m),
        heave_m=_answer(carried, (front[0] + front[1] + rear[0] + rear[1]) / 4),
    )


def _led_in(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([np.full(SETTLING_NODES, values[0]), values])


_Filter = tuple[NDArray[np.float64], NDArray[np.float64]]


def _answers(spec: SuspensionSpec) -> tuple[_Filter, _Filter]:
    """w^2 / (s^2 + 2 z w s + w^2) for forces, (2 z w s + w^2) over the same for the road; exact for linear steps."""
    w = 2 * np.pi * spec.natural_hz
    damping = 2 * spec.damping_ratio * w
    below = [1.0, damping, w * w]
    return _discrete([w * w], below), _discrete([damping, w * w], below)


def _discrete(above: list[float], below: list[float]) -> _Filter:
    from scipy.signal import cont2discrete  # half a second, and only new drives need it

    system = np.array(above), np.array(below)
    numerator, denominator, _ = cont2discrete(system, STEP_NS / SECOND_NS, method="foh")
    return np.asarray(numerator, dtype=np.float64).ravel(), np.asarray(denominator, dtype=np.float64)


def _answer(filter_: _Filter, cause: NDArray[np.float64]) -> NDArray[np.float64]:
    from scipy.signal import lfilter, lfilter_zi

    answer, _ = lfilter(*filter_, cause, zi=lfilter_zi(*filter_) * cause[0])
    return np.asarray(answer[SETTLING_NODES:])
