"""Which lidar points lie on an object, and where they were when the shutter opened."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.recordings.records import Cuboid, GroundPolygon, ObjectShape, ObjectState, PointIndices
from bench.reference.sweeps import PlacedSweep

SECOND_NS = 1_000_000_000


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
    placed: PlacedSweep,
    state: ObjectState,
    *,
    velocity_world_mps: NDArray[np.float64],
    world_from_vehicle: RigidTransform,
    exposure_ns: int,
    lowest_m: float = -np.inf,
    clearance_m: float = 0.0,
) -> Cluster:
    """The points on an object, moved to where they were at exposure.

    Each point is freed of the lidar's own motion by the lidar's pose at the point's own time, then moved with the
    object (constant velocity and yaw rate) to the time of the annotation, where the shape decides whether it
    belongs, and on to the exposure. Without this a point on a car at 10 m/s is off by up to a metre in a 10 Hz sweep.

    Args:
        placed: the sweep.
        state: the annotation.
        velocity_world_mps: (3,) float64, of the object over the ground, world axes; NaN counts as standing.
        world_from_vehicle: pose of the vehicle at the time of the annotation.
        exposure_ns: when the image was taken.
        lowest_m: points below this height in the vehicle frame are the road's; point indices are taken at their word.
        clearance_m: points less than this above the bottom of the shape are the ground's on which the object stands,
            be it road or pavement.
    """
    velocity = np.nan_to_num(velocity_world_mps, nan=0.0)
    chosen = _candidates(placed, state, world_from_vehicle, float(np.linalg.norm(velocity)))
    times_ns = placed.times_ns[chosen]
    points = placed.points_world(chosen)
    if not len(points):
        return Cluster(points_world=points, rows=chosen)
    centre = _centre_world(state.shape, world_from_vehicle, points)
    moved = _carried(points, centre, velocity, state.yaw_rate_radps, (state.timestamp_ns - times_ns) / SECOND_NS)
    belongs = _inside(state.shape, world_from_vehicle.inverse().apply(moved), lowest_m, clearance_m)
    later = np.full(int(belongs.sum()), (exposure_ns - state.timestamp_ns) / SECOND_NS)
    carried = _carried(moved[belongs], centre, velocity, state.yaw_rate_radps, later, forwards=True)
    return Cluster(points_world=carried, rows=chosen[belongs])


def surface_points(shape: ObjectShape, *, steps: int = 9) -> NDArray[np.float64]:
    """Points all over the surface of a shape, vehicle frame, (K, 3) float64, m; none for point indices.

    A box in a fisheye image has curved edges: its eight corners alone would give too small an outline.
    """
    match shape:
        case Cuboid():
            axis = np.linspace(-0.5, 0.5, steps)
            grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
            skin = grid[np.abs(grid).max(axis=1) == 0.5]
            return shape.vehicle_from_object.apply(skin * shape.size_m)
        case GroundPolygon():
            ring = shapely.segmentize(shapely.LinearRing(shape.outline_m), 0.25)
            around = shapely.get_coordinates(ring)
            heights = np.linspace(shape.bottom_m, shape.top_m, steps)
            return np.column_stack([np.tile(around, (steps, 1)), np.repeat(heights, len(around))])
    return np.empty((0, 3))


def _candidates(
    placed: PlacedSweep, state: ObjectState, world_from_vehicle: RigidTransform, speed_mps: float
) -> NDArray[np.intp]:
    """Rows that could lie on the object, by a generous circle around it in the raw sweep."""
    if isinstance(state.shape, PointIndices):
        return np.asarray(state.shape.indices, dtype=np.intp)
    surface = world_from_vehicle.apply(surface_points(state.shape, steps=2))
    middle = (surface.min(axis=0) + surface.max(axis=0)) / 2
    radius_m = float(np.linalg.norm(surface - middle, axis=1).max())
    seen_from_lidar = np.einsum("kji,kj->ki", placed.rotations, middle - placed.positions_m)
    centre = (seen_from_lidar.min(axis=0) + seen_from_lidar.max(axis=0)) / 2
    drift_m = float(np.linalg.norm(seen_from_lidar - centre, axis=1).max())
    wait_ns = max(abs(int(placed.knots_ns[0]) - state.timestamp_ns), abs(int(placed.knots_ns[-1]) - state.timestamp_ns))
    reach_m = radius_m + drift_m + speed_mps * wait_ns / SECOND_NS + 0.1
    return placed.rows_near(centre, reach_m)


def _carried(
    points: NDArray[np.float64],
    centre_at_annotation: NDArray[np.float64],
    velocity_mps: NDArray[np.float64],
    yaw_rate_radps: float,
    seconds: NDArray[np.float64],
    *,
    forwards: bool = False,
) -> NDArray[np.float64]:
    """Move points with the object by a time each: to the annotation, or (`forwards`) on from it."""
    start = centre_at_annotation - (0.0 if forwards else 1.0) * velocity_mps * seconds[:, None]
    end = start + velocity_mps * seconds[:, None]
    arm = points - start
    cosine, sine = np.cos(yaw_rate_radps * seconds), np.sin(yaw_rate_radps * seconds)
    turned = np.column_stack([cosine * arm[:, 0] - sine * arm[:, 1], sine * arm[:, 0] + cosine * arm[:, 1], arm[:, 2]])
    return np.asarray(end + turned)


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
    shape: ObjectShape, points_vehicle: NDArray[np.float64], lowest_m: float, clearance_m: float
) -> NDArray[np.bool_]:
    above_road = points_vehicle[:, 2] >= lowest_m
    match shape:
        case Cuboid():
            local = shape.vehicle_from_object.inverse().apply(points_vehicle)
            above_ground = local[:, 2] >= clearance_m - shape.size_m[2] / 2
            return np.asarray((np.abs(local) <= shape.size_m / 2).all(axis=1) & above_road & above_ground)
        case GroundPolygon():
            x, y, z = points_vehicle.T
            within = np.asarray(shapely.contains_xy(shapely.Polygon(shape.outline_m), x, y), dtype=bool)
            return np.asarray(within & (z >= shape.bottom_m + clearance_m) & (z <= shape.top_m) & above_road)
    return np.ones(len(points_vehicle), dtype=bool)
