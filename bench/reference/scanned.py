"""Lidar data of one object at an exposure: its returns, its surface, and how sure its outline is.

The uncertainty of the outline, as a standard deviation near each return:

- **beam spacing**: the outline lies anywhere between the outermost return and the next beam, which missed, uniform over
  one step between columns or rows: step / sqrt(12), along that step. Lidars have rows close together near the horizon
  and far apart below. It differs by direction, so its part moves the ends of the patches (`patches.end_spread`). Where
  the returns form no rows, each of N stands for an N-th of the region: s = sqrt(area / N).
- **range noise** moves a return along the lidar's ray, which the camera sees from the side: noise x sin(parallax).
- **calibration** between lidar and camera: an angle, and a displacement over the distance.
- **time** between return and exposure: the object's own motion is compensated, that of its limbs is not. A limb swings
  along the direction of travel, as a sine (rms = peak / sqrt(2)), the faster the farther from its joint: feet move, the
  head does not. The camera sees the part of it that lies across its ray.
  Without times of points the relative motion during a revolution is not compensated either: uniform over one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import radians

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from bench.geometry import Floats, RigidTransform, cross, dot, normalise
from bench.records.rules import Limb, OutlineErrors, ReferenceSettings
from bench.reference.exposure import Exposure
from bench.reference.grid import Grid
from bench.reference.motion import ObjectAtExposure
from bench.reference.patches import CutOff, Patches, draw, draw_closed, surface_patches, without_slits
from bench.reference.raster import Raster
from bench.reference.sweeps import Cluster, PosedSweep, parts_at_exposure
from bench.times import SECOND_NS

SOLID_CLASSES = ("vehicle",)  # seen through their windows at most, which belong to them
SINE_RMS = 2.0**-0.5  # of a peak speed, over a stride


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surface:
    """Pixels of the surface that an object's returns stand for.

    Attributes:
        likely: (rows, columns) bool, of a window that may reach beyond the image; nothing where too few returns tell.
        corner: (2,) int64, (u, v) of this window's first pixel.
        least: in V, with free ends drawn in; None without `ReferenceSettings.unknown_band`.
        most: in V, what it gains with free ends drawn out; None likewise.
        certain: in V, between returns that leave no doubt; None also for what is solid.
    """

    likely: NDArray[np.bool_]
    corner: NDArray[np.int64]
    least: Raster | None = None
    most: Raster | None = None
    certain: Raster | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class ScannedObject:
    """An annotated object at an exposure with its lidar returns.

    Attributes:
        annotated: the object.
        exposure: of the image.
        settings: of the protocol.
        cluster: its returns; none where the lidar met it nowhere.
        placed: the sweep that they are of; None where there is none.
        left_out_ground: areas that the annotations leave out, x and y in the vehicle frame, m.
    """

    annotated: ObjectAtExposure
    exposure: Exposure
    settings: ReferenceSettings
    cluster: Cluster
    placed: PosedSweep | None
    left_out_ground: BaseGeometry

    @property
    def sweep(self) -> PosedSweep:
        """The sweep that has met the object."""
        assert self.placed is not None, "only of an object with returns"
        return self.placed

    @property
    def has_enough_returns(self) -> bool:
        """Enough returns fall into the image for the protocol."""
        return self.placed is not None and self.points >= self.settings.min_points

    @property
    def solid(self) -> bool:
        """It cannot be looked through."""
        return self.annotated.track.object_class in SOLID_CLASSES

    @cached_property
    def pixels(self) -> Floats:
        """(N, 2) float64, px, (u, v), of its returns; NaN where the lens cannot see one."""
        return self.exposure.project(self.cluster.points_world)

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """(N,) bool, the returns that fall into the image."""
        return self.exposure.camera.model.contains(self.pixels)

    @cached_property
    def points(self) -> int:
        """Number of returns that fall into the image."""
        return int(np.count_nonzero(self.inside))

    @cached_property
    def parts_world(self) -> Floats:
        """(P, K, 3) float64, m, the annotated shape at exposure, corners of convex bodies, world frame; none for point
        indices."""
        return parts_at_exposure(self.annotated, self.exposure.timestamp_ns)

    @cached_property
    def _known_world(self) -> Floats:
        """(K, 3), corners of the annotated shape, or the returns where these are the annotation."""
        return (self.parts_world if len(self.parts_world) else self.cluster.points_world).reshape(-1, 3)

    @property
    def left_out(self) -> bool:
        """Its middle stands in an area that the annotations leave out."""
        if self.left_out_ground.is_empty or not len(self._known_world):
            return False
        x_m, y_m, _ = self.exposure.vehicle_from_world.apply(self._known_world.mean(axis=0))
        return bool(shapely.contains_xy(self.left_out_ground, x_m, y_m))

    @cached_property
    def range_m(self) -> float:
        """Horizontal distance of the nearest return from the camera; NaN without returns."""
        away_m = self.cluster.points_world[:, :2] - self.exposure.position_m[:2]
        return float(np.sqrt((away_m * away_m).sum(axis=1).min())) if len(away_m) else float("nan")

    @cached_property
    def distance_m(self) -> float:
        """By which objects occlude each other: `range_m`, else that of the annotated shape (0 below or above it), else
        infinite."""
        if not np.isnan(self.range_m):
            return self.range_m
        if not len(self.parts_world):
            return float("inf")
        grounds = shapely.convex_hull(shapely.linestrings(self.parts_world[..., :2]))
        return float(shapely.distance(grounds, shapely.points(self.exposure.position_m[:2])).min())

    @cached_property
    def points_camera(self) -> Floats:
        """(N, 3) float64, m, its returns at exposure, camera frame."""
        return self.exposure.camera_from_world.apply(self.cluster.points_world)

    @cached_property
    def points_from_beams(self) -> Floats:
        """(N, 3) float64, m, its returns from where their beams start, sensor axes at each one's own time."""
        return self.sweep.points_from_beams(self.cluster.rows)

    @cached_property
    def world_from_sensor(self) -> RigidTransform:
        """Pose of the sensor when it met the object, by the median of its returns."""
        sweep = self.sweep
        interpolated = np.searchsorted(sweep.interpolation_ns, np.median(sweep.times_ns[self.cluster.rows]))
        at = min(int(interpolated), len(sweep.rotations) - 1)
        return RigidTransform(sweep.rotations[at], sweep.positions_m[at]) @ sweep.lidar_from_sensor

    @cached_property
    def grid(self) -> Grid | None:
        """Neighbours of each return; None where there are too few to find them."""
        return None if self.placed is None else self.placed.grid(self.cluster.rows)

    @cached_property
    def patches(self) -> Patches:
        """The surface that each return stands for, where there is a grid."""
        assert self.grid is not None, "patches lie between neighbours"
        return surface_patches(
            self.cluster.points_world,
            world_from_sensor=self.world_from_sensor.rotation,
            grid=self.grid,
            cut_off=self._cut_off(self.grid) if len(self.parts_world) else None,
        )

    def _cut_off(self, grid: Grid) -> CutOff:
        (x, y, z), (lowest, highest) = self.points_from_beams.T, self.sweep.envelope
        slopes = z / np.maximum(np.hypot(x, y), 1e-9)
        heights_m, half_row = self.parts_world[..., 2], grid.row_step_rad / 2
        bottom_m = float(heights_m.min())
        return CutOff(
            grounded_m=np.where(slopes < lowest.slope + half_row, np.inf, bottom_m + self.settings.ground_clearance_m),
            bottom_m=bottom_m,
            top_m=np.where(slopes > highest.slope - half_row, heights_m.max(), -np.inf),
        )

    @cached_property
    def error_m(self) -> Floats:
        """(N,) float64, m, how uncertain the outline is near each return but for the spacing of the beams; see
        `outline_error_m`."""
        camera_from_world, errors = self.exposure.camera_from_world, self.settings.unknown_band
        assert errors is not None, "only for protocols with unknown bands"
        velocity_mps, own_class = self.annotated.known_velocity_mps, self.annotated.track.object_class
        speed_mps = float(np.hypot(*velocity_mps[:2]))
        limbs = [limb for name, limbs_of_class in errors.limbs.items() if name == own_class for limb in limbs_of_class]
        variance_m2 = np.full(len(self.cluster.rows), self._revolution_m2(velocity_mps))
        if limbs and speed_mps:
            heights_m = self.cluster.points_world[:, 2] - self._known_world[:, 2].min()
            swung_m = limb_motion_m(
                limbs,
                np.asarray(heights_m / np.ptp(self._known_world[:, 2])),
                speed_mps=speed_mps,
                times_ns=self.sweep.times_ns[self.cluster.rows] - self.exposure.timestamp_ns,
            )
            across = cross(normalise(self.points_camera), camera_from_world.rotate(velocity_mps / speed_mps))
            variance_m2 += swung_m**2 * dot(across, across)
        sensor_camera = camera_from_world.apply(self.world_from_sensor.translation_m)
        return outline_error_m(self.points_camera, sensor_camera=sensor_camera, variance_m2=variance_m2, errors=errors)

    def _revolution_m2(self, velocity_mps: Floats) -> float:
        """Variance of what nothing tells of lidars without times of points: when in the revolution was it met? At
        either end the object was elsewhere, seen from the vehicle."""
        points, half_ns = self.sweep.sweep, self.sweep.revolution_ns // 2
        if points.time_offset_ns is not None:
            return 0.0
        trajectory, ends_ns = self.exposure.recording.trajectory, points.timestamp_ns + np.array([-half_ns, half_ns])
        rotations, positions_m, _ = trajectory.at(ends_ns)
        middle_m = self.cluster.points_world.mean(axis=0)
        centres_m = middle_m + velocity_mps * np.array([[-half_ns], [half_ns]]) / SECOND_NS
        first_m, last_m = np.einsum("nji,nj->ni", rotations, centres_m - positions_m)
        return float(np.nan_to_num(np.square(last_m - first_m).sum()) / 12)

    @cached_property
    def surface(self) -> Surface:
        """Pixels of the surface; for protocols with unknown bands also those at least, at most and for certain."""
        if self.grid is None:
            return Surface(likely=np.zeros((0, 0), dtype=bool), corner=np.zeros(2, dtype=np.int64))
        covered, corner = draw(self.patches.corners, self.exposure)
        likely = without_slits(covered, solid=self.solid)
        if self.settings.unknown_band is None:
            return Surface(likely=likely, corner=corner - 1)
        drawn_in, drawn_out = self.patches.with_free_ends_moved(self.error_m)
        moved = (drawn_out != self.patches.corners).any(axis=(0, 1))
        return Surface(
            likely=likely,
            corner=corner - 1,
            least=draw_closed(drawn_in, self.exposure, solid=self.solid),
            most=draw_closed(drawn_out.compress(moved, axis=2), self.exposure, solid=self.solid),
            certain=None if self.solid else self.exposure.crop(*draw(self.patches.certain_corners, self.exposure)),
        )


def limb_motion_m(limbs: Sequence[Limb], heights: Floats, *, speed_mps: float, times_ns: NDArray[np.int64]) -> Floats:
    """Return how far points moved with limbs: (N,) float64, m, standard deviation along the direction of travel.

    Args:
        limbs: of the object; the fastest at each return's height counts.
        heights: (N,) float64, of each return above the object's bottom, over the object's height.
        speed_mps: of the object.
        times_ns: (N,) int64, of each return, since the exposure.
    """
    shares = [limb.speed * (limb.joint - heights) / (limb.joint - limb.end) for limb in limbs]
    reached = [np.where(heights >= limb.end, share, 0.0) for limb, share in zip(limbs, shares, strict=True)]
    fastest = np.maximum.reduce([np.zeros_like(heights), *reached])
    return np.asarray(fastest * SINE_RMS * speed_mps * np.abs(times_ns) / SECOND_NS)


def outline_error_m(
    points_camera: Floats, *, sensor_camera: Floats, variance_m2: Floats, errors: OutlineErrors
) -> Floats:
    """Uncertainty of an object's outline near each of its returns, for all causes but the spacing of the beams.

    Args:
        points_camera: (N, 3) float64, m, these returns at exposure.
        sensor_camera: (3,) float64, m, where the lidar was.
        variance_m2: (N,) float64, square of the standard deviation of the unknown part of each return's motion, as
            the camera sees it.
        errors: of the protocol.

    Returns:
        (N,) float64, m, standard deviation across the camera's ray.
    """
    beams = points_camera - sensor_camera
    distance2_m2, aside = dot(points_camera, points_camera), cross(points_camera, beams)
    parallax2 = np.nan_to_num(dot(aside, aside) / (distance2_m2 * dot(beams, beams)))  # squared sine
    variance_m2 = variance_m2 + errors.range_noise_m**2 * parallax2 + errors.position_m**2
    return np.asarray(np.sqrt(radians(errors.angle_deg) ** 2 * distance2_m2 + variance_m2))
