"""A track as arrays: where it was in the world, and what is said of its motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.egomotion import Trajectory
from bench.geometry import RigidTransform
from bench.recordings import Cuboid, GroundPolygon, ObjectShape, Track


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackPath:
    """The states of a track that have a box or outline and ego-motion.

    Attributes:
        times_ns: (N,) int64.
        positions_m: (N, 3) float64, m, centres, world frame.
        stated_mps: (N, 3) float64, stated velocity over the ground, world axes; NaN where not told.
        forward: (N, 2) float64, horizontal part of the box's x axis, world axes; NaN for outlines.
        range_m: (N,) float64, m, horizontal distance from the vehicle's origin.
        host_mps: (N, 3) float64, velocity of the host, world axes.
        stated_turn_radps: (N,) float64.
        rotations: (N, 3, 3) float64, world_from_vehicle.
    """

    times_ns: NDArray[np.int64]
    positions_m: NDArray[np.float64]
    stated_mps: NDArray[np.float64]
    forward: NDArray[np.float64]
    range_m: NDArray[np.float64]
    host_mps: NDArray[np.float64]
    stated_turn_radps: NDArray[np.float64]
    rotations: NDArray[np.float64]


def box_of(shape: ObjectShape) -> Cuboid | None:
    """The box, or the upright one around an outline; None for point indices."""
    if isinstance(shape, Cuboid):
        return shape
    if isinstance(shape, GroundPolygon):
        corners = shapely.get_coordinates(shapely.MultiPoint(shape.outline_m).minimum_rotated_rectangle)
        if len(corners) < 4:
            return None
        along, across = corners[1] - corners[0], corners[2] - corners[1]
        if np.hypot(*along) < np.hypot(*across):
            along, across = across, along
        centre = np.append(corners[:4].mean(axis=0), (shape.bottom_m + shape.top_m) / 2)
        return Cuboid(
            vehicle_from_object=RigidTransform.from_yaw(float(np.arctan2(along[1], along[0])), centre),
            size_m=np.array([np.hypot(*along), np.hypot(*across), shape.top_m - shape.bottom_m]),
        )
    return None


def track_path(track: Track, trajectory: Trajectory) -> TrackPath:
    """Arrays of a track."""
    boxed = [(state, box) for state in track.states if (box := box_of(state.shape)) is not None]
    times_ns = np.array([state.timestamp_ns for state, _ in boxed], dtype=np.int64)
    rotations, positions_m, valid = trajectory.at(times_ns)
    kept = [pair for pair, good in zip(boxed, valid, strict=True) if good]
    rotations, positions_m, times_ns = rotations[valid], positions_m[valid], times_ns[valid]
    centres = np.array([box.vehicle_from_object.translation_m for _, box in kept]).reshape(-1, 3)
    stated = np.array([state.velocity_mps for state, _ in kept], dtype=np.float64).reshape(-1, 3)
    axes = np.array([
        box.vehicle_from_object.rotation[:, 0] if isinstance(state.shape, Cuboid) else np.full(3, np.nan)
        for state, box in kept
    ]).reshape(-1, 3)  # fmt: skip
    host = np.array([rotations[i] @ trajectory.velocity_vehicle_mps(int(t)) for i, t in enumerate(times_ns)])
    return TrackPath(
        times_ns=times_ns,
        positions_m=_turned(rotations, centres) + positions_m,
        stated_mps=_turned(rotations, stated),
        forward=_turned(rotations, axes)[:, :2],
        range_m=np.hypot(centres[:, 0], centres[:, 1]),
        host_mps=host.reshape(-1, 3),
        stated_turn_radps=np.array([state.yaw_rate_radps for state, _ in kept], dtype=np.float64),
        rotations=rotations,
    )


def _turned(rotations: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.einsum("nij,nj->ni", rotations, vectors))
