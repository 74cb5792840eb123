"""How annotated boxes move over the ground, from their places at successive times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.egomotion import Trajectory

TURN_SPAN_NS = 500_000_000  # headings are compared over about this time, since single ones jitter
SECOND_NS = 1_000_000_000


def yaw_rates(
    timestamps_ns: NDArray[np.int64], vehicle_from_object: NDArray[np.float64], trajectory: Trajectory
) -> NDArray[np.float64]:
    """Turn of an object over the ground, from its headings a quarter of a second before and after.

    Args:
        timestamps_ns: (N,) int64, increasing.
        vehicle_from_object: (N, 3, 3) float64, rotation of the box at each time.
        trajectory: of the ego vehicle.

    Returns:
        (N,) float64, rad/s, positive to the left; 0 for an object seen once.
    """
    world_from_vehicle, _, _ = trajectory.at(timestamps_ns)
    return world_yaw_rates(timestamps_ns, world_from_vehicle @ vehicle_from_object)


def world_yaw_rates(timestamps_ns: NDArray[np.int64], world_from_object: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same from rotations in a world with z up, (N, 3, 3) float64."""
    forward_world = world_from_object[:, :, 0]
    heading_rad = np.unwrap(np.arctan2(forward_world[:, 1], forward_world[:, 0]))
    first = np.searchsorted(timestamps_ns, timestamps_ns - TURN_SPAN_NS // 2)
    last = np.searchsorted(timestamps_ns, timestamps_ns + TURN_SPAN_NS // 2, side="right") - 1
    span_s = (timestamps_ns[last] - timestamps_ns[first]) / SECOND_NS
    turn_rad = heading_rad[last] - heading_rad[first]
    return np.asarray(np.where(span_s > 0, turn_rad / np.where(span_s > 0, span_s, 1.0), 0.0))


def world_velocities(timestamps_ns: NDArray[np.int64], places_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Velocity at each time, from the places before and after.

    Args:
        timestamps_ns: (N,) int64, increasing.
        places_m: (N, 3) float64, world frame, m.

    Returns:
        (N, 3) float64, m/s; NaN for an object seen once.
    """
    if len(timestamps_ns) < 2:
        return np.full_like(places_m, np.nan)
    seconds = (timestamps_ns - timestamps_ns[0]) / SECOND_NS
    return np.asarray(np.gradient(places_m, seconds, axis=0))
