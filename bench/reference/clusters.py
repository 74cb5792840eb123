"""Lidar points that lie on an object, and where they were when the shutter opened."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.records.recording import Cuboid, GroundPolygon, ObjectShape, ObjectState, PointIndices
from bench.reference.silhouette import convex_parts
from bench.reference.sweeps import PosedSweep
from bench.times import SECOND_NS


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cluster:
    """The lidar returns of one object.

    Attributes:
        points_world: (K, 3) float64, m, where they were at exposure, world frame.
        rows: (K,) intp, which points of the sweep they are.
    """

    points_world: NDArray[np.float64]
    rows: NDArray[np.intp]


def object_cluster(
    placed: PosedSweep,
    state: ObjectState,
    *,
    velocity_world_mps: NDArray[np.float64],
    world_from_vehicle: RigidTransform,
    exposure_ns: int,
    lowest_m: float = -np.inf,
    clearance_m: float = 0.0,
    margin_m: float = 0.0,
) -> Cluster:
    """The points on an object, moved to where they were at exposure.

    Each point is compensated for the motion of the lidar by its pose at the point's own time, then moved with the
    object (constant velocity and yaw rate) to the time of the annotation, where the shape decides whether it
    belongs, and on to the exposure. Without this a point on a car at 10 m/s is off by up to a metre in a 10 Hz sweep.

    Args:
        placed: the sweep.
        state: the annotation.
        velocity_world_mps: (3,) float64, of the object over the ground, world axes; NaN counts as stationary.
        world_from_vehicle: pose of the vehicle at the time of the annotation.
        exposure_ns: when the image was taken.
        lowest_m: points below this height in the vehicle frame are the road's; point indices are taken at their word.
        clearance_m: points less than this above the bottom of the shape are the ground's on which the object stands,
            be it road or pavement.
        margin_m: points this far outside of the shape, but not below it, are still the object's: ranges are noisy, and
            boxes are drawn tight.
    """
    velocity = np.where(np.isnan(velocity_world_mps), 0.0, velocity_world_mps)
    chosen = _candidates(placed, state, world_from_vehicle, float(np.linalg.norm(velocity)), margin_m)
    points = placed.points_world(chosen)
    if not len(points):
        return Cluster(points_world=points, rows=chosen)
    centre = _centre_world(state.shape, world_from_vehicle, points)
    seconds = (state.timestamp_ns - placed.times_ns[chosen]) / SECOND_NS
    moved = _carried(points, velocity, seconds, yaw_rate_radps=state.yaw_rate_radps, centre_then=centre)
    moved_vehicle = world_from_vehicle.inverse().apply(moved)
    belongs = np.flatnonzero(_inside(state.shape, moved_vehicle, lowest_m, clearance_m, margin_m))
    later_s = (exposure_ns - state.timestamp_ns) / SECOND_NS
    carried = _carried(
        moved.T.take(belongs, axis=1).T,
        velocity,
        later_s,
        yaw_rate_radps=state.yaw_rate_radps,
        centre_then=centre + velocity * later_s,
    )
    return Cluster(points_world=carried, rows=chosen[belongs])


def parts_at_exposure(
    state: ObjectState,
    *,
    velocity_world_mps: NDArray[np.float64],
    world_from_vehicle: RigidTransform,
    exposure_ns: int,
) -> NDArray[np.float64]:
    """The annotated shape moved to the exposure as its points are.

    Args:
        state: the annotation.
        velocity_world_mps: (3,) float64, of the object over the ground, world axes; NaN counts as stationary.
        world_from_vehicle: pose of the vehicle at the time of the annotation.
        exposure_ns: when the image was taken.

    Returns:
        (P, K, 3) float64, m, world frame, corners of `convex_parts`; none for point indices.
    """
    parts = world_from_vehicle.apply(convex_parts(state.shape))
    if not len(parts):
        return parts
    later_s = (exposure_ns - state.timestamp_ns) / SECOND_NS
    velocity, corners = np.nan_to_num(velocity_world_mps), parts.reshape(-1, 3)
    centre = _centre_world(state.shape, world_from_vehicle, corners)
    return _carried(
        corners,
        velocity,
        later_s,
        yaw_rate_radps=state.yaw_rate_radps,
        centre_then=centre + velocity * later_s,
    ).reshape(parts.shape)


def _candidates(
    placed: PosedSweep, state: ObjectState, world_from_vehicle: RigidTransform, speed_mps: float, margin_m: float
) -> NDArray[np.intp]:
    """Rows that could lie on the object, by a generous rectangle around it in the raw sweep."""
    if isinstance(state.shape, PointIndices):
        return placed.sweep.rows_of(state.shape.indices)
    middle_vehicle, radius_m = _circumscribed(state.shape)
    away_m = world_from_vehicle.apply(middle_vehicle) - placed.positions_m
    seen_from_lidar = np.einsum("kji,kj->ki", placed.rotations, away_m)
    wait_ns = max(
        abs(int(placed.interpolation_ns[0]) - state.timestamp_ns),
        abs(int(placed.interpolation_ns[-1]) - state.timestamp_ns),
    )
    reach_m = radius_m + margin_m + speed_mps * wait_ns / SECOND_NS + 0.1
    return placed.rows_between(seen_from_lidar.min(axis=0) - reach_m, seen_from_lidar.max(axis=0) + reach_m)


def _circumscribed(shape: Cuboid | GroundPolygon) -> tuple[NDArray[np.float64], float]:
    """Middle, vehicle frame, and radius of a sphere around a shape, m."""
    if isinstance(shape, Cuboid):
        return shape.vehicle_from_object.translation_m, float(np.linalg.norm(shape.size_m)) / 2
    low = np.array([*shape.outline_m.min(axis=0), shape.bottom_m])
    high = np.array([*shape.outline_m.max(axis=0), shape.top_m])
    return (low + high) / 2, float(np.linalg.norm(high - low)) / 2


def _carried(
    points: NDArray[np.float64],
    velocity_mps: NDArray[np.float64],
    seconds: NDArray[np.float64] | float,
    *,
    yaw_rate_radps: float,
    centre_then: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Move points with an object: along with its centre, then about it.

    Args:
        points: (N, 3) float64, m.
        velocity_mps: (3,) float64.
        seconds: for how long; (N,) float64 or one for all, negative for backwards.
        yaw_rate_radps: about the centre, positive to the left.
        centre_then: (3,) float64, m, where the centre is in the end.

    Returns:
        (N, 3) float64, m; each component lies in one piece of memory.
    """
    moved = points.T + velocity_mps[:, None] * seconds
    if yaw_rate_radps:
        arm_x, arm_y = moved[:2] - centre_then[:2, None]
        cosine, sine = np.cos(yaw_rate_radps * seconds), np.sin(yaw_rate_radps * seconds)
        moved[0] = centre_then[0] + cosine * arm_x - sine * arm_y
        moved[1] = centre_then[1] + sine * arm_x + cosine * arm_y
    return moved.T


def _centre_world(
    shape: ObjectShape, world_from_vehicle: RigidTransform, points_world: NDArray[np.float64]
) -> NDArray[np.float64]:
    match shape:
        case Cuboid():
            return world_from_vehicle.apply(shape.vehicle_from_object.translation_m)
        case GroundPolygon():
            return world_from_vehicle.apply(np.array([*shape.outline_m.mean(axis=0), shape.bottom_m]))
    return np.asarray(points_world.mean(axis=0))


def _inside(
    shape: ObjectShape, points_vehicle: NDArray[np.float64], lowest_m: float, clearance_m: float, margin_m: float
) -> NDArray[np.bool_]:
    above_road = points_vehicle[:, 2] >= lowest_m
    match shape:
        case Cuboid():
            local, half = shape.vehicle_from_object.inverse().apply(points_vehicle).T, shape.size_m / 2
            within = (np.abs(local) <= (half + margin_m)[:, None]).all(axis=0)
            return np.asarray(within & (local[2] >= clearance_m - half[2]) & above_road)
        case GroundPolygon():
            (x, y, z), ground = points_vehicle.T, shapely.Polygon(shape.outline_m)
            if margin_m:
                ground = shapely.buffer(ground, margin_m)
            within = np.asarray(shapely.contains_xy(ground, x, y), dtype=bool)
            return np.asarray(within & (z >= shape.bottom_m + clearance_m) & (z <= shape.top_m + margin_m) & above_road)
    return np.ones(len(points_vehicle), dtype=bool)
