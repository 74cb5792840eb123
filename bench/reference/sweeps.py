"""A lidar sweep placed in the world, the choice of the sweep for an exposure, and its returns from an object."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.egomotion.trajectory import Trajectory
from bench.errors import DataError
from bench.geometry import Floats, RigidTransform
from bench.lidar.sweep import LidarSweep, deskew, interpolation_timestamps
from bench.records.recording import Cuboid, GroundPolygon, ObjectShape, PointIndices, Recording
from bench.reference.grid import Envelope, Grid, find_envelope, find_grid
from bench.reference.motion import ObjectAtExposure, centre_vehicle
from bench.reference.silhouette import convex_parts
from bench.times import SECOND_NS


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedSweep:
    """A sweep with the lidar's pose over its time, computed once for all objects.

    Attributes:
        sweep: the points.
        times_ns: (N,) int64, time of each point.
        interpolation_ns: (K,) int64, K >= 2.
        rotations: (K, 3, 3) float64, world_from_lidar.
        positions_m: (K, 3) float64, m.
        lidar_from_sensor: `Recording.lidar_from_sensor`, the pose of the sensor in the frame of the points.
        revolution_ns: how long a revolution takes; 0 where unknown.
    """

    sweep: LidarSweep
    times_ns: NDArray[np.int64]
    interpolation_ns: NDArray[np.int64]
    rotations: Floats
    positions_m: Floats
    lidar_from_sensor: RigidTransform
    revolution_ns: int
    _grids: dict[bytes, Grid | None] = field(init=False, repr=False, default_factory=dict)

    @cached_property
    def envelope(self) -> Envelope:
        """The lowest beam, which meets the road, and the highest that meets anything."""
        return find_envelope(self._sensor_components.T)

    @cached_property
    def azimuths_rad(self) -> NDArray[np.floating]:
        """(N,), of all points, sensor frame at each one's own time, in their own type."""
        x, y, _ = self._sensor_components
        return np.asarray(np.arctan2(y, x))

    @cached_property
    def _sensor_components(self) -> NDArray[np.floating]:
        """(3, N), all points in the sensor frame at each one's own time, in their own type."""
        sensor_from_lidar, kind = self.lidar_from_sensor.inverse(), self._components.dtype
        turned = sensor_from_lidar.rotation.astype(kind) @ self._components
        return np.asarray(turned + sensor_from_lidar.translation_m.astype(kind)[:, None])

    @cached_property
    def _components(self) -> NDArray[np.floating]:
        """x, y and z, (3, N), each in one piece: every object searches them."""
        return np.ascontiguousarray(self.sweep.points_lidar.T)

    def rows_between(self, low_lidar: Floats, high_lidar: Floats) -> NDArray[np.intp]:
        """Rows of the points, as measured, whose x and y lie between those of two corners, lidar frame, m."""
        # Plain numbers: for NumPy's own, every x of a float32 sweep would first be made a float64.
        (x0, y0), (x1, y1) = low_lidar[:2].tolist(), high_lidar[:2].tolist()
        x, y, _ = self._components
        with np.errstate(over="ignore"):  # what float32 cannot hold is as good as infinite
            return np.flatnonzero((x > x0) & (x < x1) & (y > y0) & (y < y1))

    def points_world(self, rows: NDArray[np.intp] | slice = slice(None)) -> Floats:
        """Motion-compensated points, (K, 3) float64, m, world frame; each where it was at its own time."""
        taken = self._components[:, rows] if isinstance(rows, slice) else self._components.take(rows, axis=1)
        return deskew(
            taken.T,
            self.times_ns[rows],
            interpolation_ns=self.interpolation_ns,
            rotations=self.rotations,
            positions_m=self.positions_m,
        )

    def points_sensor(self, rows: NDArray[np.intp] | slice = slice(None)) -> Floats:
        """Points in the sensor frame at each point's own time, (K, 3) float64, m."""
        return self.lidar_from_sensor.inverse().apply(self.sweep.points_lidar[rows].astype(np.float64))

    def points_from_beams(self, rows: NDArray[np.intp]) -> Floats:
        """As `points_sensor`, each seen from where its beam starts on the sensor's upright axis."""
        points = self.points_sensor(rows)
        points[:, 2] -= self.envelope.starts_m(points)
        return points

    def grid(self, rows: NDArray[np.intp]) -> Grid | None:
        """Neighbours among these points; cached, since images that share a sweep ask for the same points."""
        key = rows.tobytes()
        if key not in self._grids:
            points, apart_m = self.points_from_beams(rows), self.envelope.starts_apart_m
            others = self.points_from_beams(self._others_among(rows)) if apart_m else None
            self._grids[key] = find_grid(points, starts_apart_m=apart_m, others_sensor=others)
        return self._grids[key]

    def _others_among(self, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """Rows of all other returns between the first and the last azimuth of some."""
        x, y, _ = self.points_sensor(rows).mean(axis=0).tolist()
        middle_rad = float(np.arctan2(y, x))
        own_rad = turned(self.azimuths_rad[rows], middle_rad)
        sector = self.rows_in_sector(middle_rad, own_rad.min(), own_rad.max())
        return np.setdiff1d(sector, rows, assume_unique=True)

    def rows_in_sector(self, middle_rad: float, first_rad: float, last_rad: float) -> NDArray[np.intp]:
        """Rows of the returns between two azimuths, which count from a middle one, to the left."""
        away = turned(self.azimuths_rad, middle_rad)
        return np.flatnonzero((away >= first_rad) & (away <= last_rad))


def turned(azimuths_rad: NDArray[np.floating], middle_rad: float) -> NDArray[np.floating]:
    """Azimuths from a middle one, in [-pi, pi), in their own type."""
    return (azimuths_rad - middle_rad + np.pi) % (2 * np.pi) - np.pi


def pose_sweep(
    sweep: LidarSweep,
    trajectory: Trajectory,
    vehicle_from_lidar: RigidTransform,
    lidar_from_sensor: RigidTransform | None = None,
    revolution_ns: int = 0,
) -> PosedSweep | None:
    """Find the lidar's poses during a sweep.

    Args:
        sweep: the points.
        trajectory: ego-motion.
        vehicle_from_lidar: mounting of the frame of the points.
        lidar_from_sensor: pose of the sensor in that frame; None for its origin and axes.
        revolution_ns: how long a revolution takes; 0 where unknown.

    Returns:
        None where the sweep has no points or ego-motion is missing for part of it.
    """
    times_ns = sweep.times_ns
    interpolation_ns = interpolation_timestamps(times_ns)
    rotations, positions_m, valid = trajectory.at(interpolation_ns)
    if not (len(interpolation_ns) and valid.all()):
        return None
    return PosedSweep(
        sweep=sweep,
        times_ns=times_ns,
        interpolation_ns=interpolation_ns,
        rotations=rotations @ vehicle_from_lidar.rotation,
        positions_m=rotations @ vehicle_from_lidar.translation_m + positions_m,
        lidar_from_sensor=lidar_from_sensor or RigidTransform.identity(),
        revolution_ns=revolution_ns,
    )


class SweepCache:
    """Reads the sweep for an exposure; caches the last one, since neighbouring images share it.

    Args:
        recording: the drive.
        max_gap_ns: a sweep further from the exposure is not used.
    """

    def __init__(self, recording: Recording, max_gap_ns: int) -> None:
        self._recording, self._max_gap_ns = recording, max_gap_ns
        self._times_ns = np.array([ref.timestamp_ns for ref in recording.sweeps], dtype=np.int64)
        self._revolution_ns = int(np.median(np.diff(self._times_ns))) if len(self._times_ns) > 1 else 0
        self._posed = lru_cache(maxsize=1)(self._read)

    def nearest(self, shape: ObjectShape | None, exposure_ns: int) -> PosedSweep | None:
        """The sweep nearest to the exposure; for point indices the one that they count in.

        Returns:
            None where there is no sweep near enough, or no ego-motion for it.

        Raises:
            DataError: point indices of a sweep that does not exist, or a file that cannot be read.
        """
        drive, counted_ns = self._recording, shape.sweep_timestamp_ns if isinstance(shape, PointIndices) else None
        away_ns = np.abs(self._times_ns - (exposure_ns if counted_ns is None else counted_ns))
        if counted_ns is not None and not (away_ns == 0).any():
            expected = f"a lidar sweep at {counted_ns}, in which point indices count"
            raise DataError(drive.root, field="annotations", expected=expected, got="no sweep of that time")
        if not away_ns.size or away_ns.min() > (self._max_gap_ns if counted_ns is None else 0):
            return None
        return self._posed(int(np.argmin(away_ns)))

    def _read(self, number: int) -> PosedSweep | None:
        drive, sweep = self._recording, self._recording.sweeps[number].read()
        mounting = drive.trajectory, drive.vehicle_from_lidar, drive.lidar_from_sensor
        return pose_sweep(sweep, *mounting, self._revolution_ns)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cluster:
    """The lidar returns of one object.

    Attributes:
        points_world: (K, 3) float64, m, where they were at exposure, world frame.
        rows: (K,) intp, which points of the sweep they are.
    """

    points_world: Floats
    rows: NDArray[np.intp]


def object_cluster(
    placed: PosedSweep,
    annotated: ObjectAtExposure,
    exposure_ns: int,
    *,
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
        annotated: the object; an unknown velocity counts as stationary.
        exposure_ns: when the image was taken.
        lowest_m: points below this height in the vehicle frame are the road's; point indices are taken at their word.
        clearance_m: points less than this above the bottom of the shape are the ground's on which the object stands,
            be it road or pavement.
        margin_m: points this far outside of the shape, but not below it, are still the object's: ranges are noisy, and
            boxes are drawn tight.
    """
    state, world_from_vehicle = annotated.state, annotated.world_from_vehicle
    candidates = _candidates(placed, annotated, margin_m)
    points = placed.points_world(candidates)
    if not len(points):
        return Cluster(points_world=points, rows=candidates)
    centre = _centre_world(annotated, points)
    seconds = (state.timestamp_ns - placed.times_ns[candidates]) / SECOND_NS
    moved = _carried(points, annotated, seconds, centre_then=centre)
    moved_vehicle = world_from_vehicle.inverse().apply(moved)
    belongs = np.flatnonzero(_inside(state.shape, moved_vehicle, lowest_m, clearance_m, margin_m))
    own = moved.T.take(belongs, axis=1).T
    return Cluster(points_world=_at_exposure(own, annotated, exposure_ns, centre), rows=candidates[belongs])


def parts_at_exposure(annotated: ObjectAtExposure, exposure_ns: int) -> Floats:
    """The annotated shape moved to the exposure as its points are.

    Returns:
        (P, K, 3) float64, m, world frame, corners of `convex_parts`; none for point indices.
    """
    parts = annotated.world_from_vehicle.apply(convex_parts(annotated.state.shape))
    if not len(parts):
        return parts
    corners = parts.reshape(-1, 3)
    return _at_exposure(corners, annotated, exposure_ns, _centre_world(annotated, corners)).reshape(parts.shape)


def _candidates(placed: PosedSweep, annotated: ObjectAtExposure, margin_m: float) -> NDArray[np.intp]:
    """Rows that could lie on the object, by a generous rectangle around it in the raw sweep."""
    shape, time_ns = annotated.state.shape, annotated.state.timestamp_ns
    if isinstance(shape, PointIndices):
        return placed.sweep.rows_of(shape.indices)
    middle_vehicle, radius_m = _circumscribed(shape)
    away_m = annotated.world_from_vehicle.apply(middle_vehicle) - placed.positions_m
    seen_from_lidar = np.einsum("kji,kj->ki", placed.rotations, away_m)
    wait_ns = max(abs(int(end_ns) - time_ns) for end_ns in placed.interpolation_ns[[0, -1]])
    speed_mps = float(np.linalg.norm(annotated.known_velocity_mps))
    reach_m = radius_m + margin_m + speed_mps * wait_ns / SECOND_NS + 0.1
    return placed.rows_between(seen_from_lidar.min(axis=0) - reach_m, seen_from_lidar.max(axis=0) + reach_m)


def _circumscribed(shape: Cuboid | GroundPolygon) -> tuple[Floats, float]:
    """Middle, vehicle frame, and radius of a sphere around a shape, m."""
    if isinstance(shape, Cuboid):
        return shape.vehicle_from_object.translation_m, float(np.linalg.norm(shape.size_m)) / 2
    low = np.array([*shape.outline_m.min(axis=0), shape.bottom_m])
    high = np.array([*shape.outline_m.max(axis=0), shape.top_m])
    return (low + high) / 2, float(np.linalg.norm(high - low)) / 2


def _centre_world(annotated: ObjectAtExposure, points_world: Floats) -> Floats:
    """What the object turns about; of point indices the middle of the points."""
    if isinstance(annotated.state.shape, PointIndices):
        return np.asarray(points_world.mean(axis=0))
    return annotated.world_from_vehicle.apply(centre_vehicle(annotated.state.shape))


def _at_exposure(points: Floats, annotated: ObjectAtExposure, exposure_ns: int, centre: Floats) -> Floats:
    """Points, (N, 3), of the object at the time of its annotation, moved with it to the exposure."""
    later_s = (exposure_ns - annotated.state.timestamp_ns) / SECOND_NS
    return _carried(points, annotated, later_s, centre_then=centre + annotated.known_velocity_mps * later_s)


def _carried(points: Floats, annotated: ObjectAtExposure, seconds: Floats | float, *, centre_then: Floats) -> Floats:
    """Move points with an object: along with its centre, then about it.

    Args:
        points: (N, 3) float64, m.
        annotated: the object.
        seconds: for how long; (N,) float64 or one for all, negative for backwards.
        centre_then: (3,) float64, m, where the centre is in the end.

    Returns:
        (N, 3) float64, m; each component lies in one piece of memory.
    """
    yaw_rate_radps = annotated.state.yaw_rate_radps
    moved = points.T + annotated.known_velocity_mps[:, None] * seconds
    if yaw_rate_radps:
        arm_x, arm_y = moved[:2] - centre_then[:2, None]
        cosine, sine = np.cos(yaw_rate_radps * seconds), np.sin(yaw_rate_radps * seconds)
        moved[0] = centre_then[0] + cosine * arm_x - sine * arm_y
        moved[1] = centre_then[1] + sine * arm_x + cosine * arm_y
    return moved.T


def _inside(
    shape: ObjectShape, points_vehicle: Floats, lowest_m: float, clearance_m: float, margin_m: float
) -> NDArray[np.bool_]:
    above_road = points_vehicle[:, 2] >= lowest_m
    match shape:
        case Cuboid():
            local, half = shape.vehicle_from_object.inverse().apply(points_vehicle).T, shape.size_m / 2
            within = (np.abs(local) <= (half + margin_m)[:, None]).all(axis=0)
            return np.asarray(within & (local[2] >= clearance_m - half[2]) & above_road)
        case GroundPolygon():
            (x, y, z), ground = points_vehicle.T, shapely.make_valid(shapely.Polygon(shape.outline_m))
            if margin_m:
                ground = shapely.buffer(ground, margin_m)
            within = np.asarray(shapely.contains_xy(ground, x, y), dtype=bool)
            return np.asarray(within & (z >= shape.bottom_m + clearance_m) & (z <= shape.top_m + margin_m) & above_road)
    return np.ones(len(points_vehicle), dtype=bool)
