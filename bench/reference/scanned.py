"""What the lidar says of one object at an exposure: its surface, how sure it is, and what was out of reach."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.geometry import RigidTransform, normalise
from bench.reference.clusters import Cluster
from bench.reference.patches import Grid, certain_and_possible_ends, reach_bounds, surface_patches
from bench.reference.sweeps import PosedSweep, slopes_of


@dataclass(frozen=True, kw_only=True, eq=False)
class ScannedObject:
    """An object that a sweep has met.

    Attributes:
        cluster: its returns.
        placed: the sweep that they are of.
        parts_world: (P, K, 3) float64, m, the annotated shape at exposure, corners of convex bodies, world frame; none
            for point indices.
        clearance_m: returns lower than this above the bottom of the shape were taken for the ground's.
    """

    cluster: Cluster
    placed: PosedSweep
    parts_world: NDArray[np.float64]
    clearance_m: float

    @cached_property
    def points_sensor(self) -> NDArray[np.float64]:
        """(N, 3) float64, m, its returns in the sensor frame at each one's own time."""
        return self.placed.points_sensor(self.cluster.rows)

    @cached_property
    def world_from_sensor(self) -> RigidTransform:
        """Pose of the sensor when it met the object, by the median of its returns."""
        placed = self.placed
        interpolated = np.searchsorted(placed.interpolation_ns, np.median(placed.times_ns[self.cluster.rows]))
        at = min(int(interpolated), len(placed.rotations) - 1)
        return RigidTransform(placed.rotations[at], placed.positions_m[at]) @ placed.lidar_from_sensor

    @cached_property
    def grid(self) -> Grid | None:
        """Which returns are neighbours; None where too few tell."""
        return self.placed.grid(self.cluster.rows)

    @cached_property
    def patches_world(self) -> NDArray[np.float64]:
        """The surface that the returns stand for, (4, N, 3) float64, m, world frame; empty where too few tell."""
        return self._bounded(0.5)

    def certain_and_possible_world(
        self, error_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The same with the ends of the patches drawn in, and those patches alone whose ends can be drawn out.

        Args:
            error_m: (N,) float64, m, as for `certain_and_possible_ends`.
        """
        assert self.grid is not None
        least, most = certain_and_possible_ends(self.grid.step_m(self.points_sensor), error_m)
        drawn_out = self._bounded(most)
        return self._bounded(least), drawn_out[:, (drawn_out != self.patches_world).any(axis=(0, 2))]

    def _bounded(self, ends: NDArray[np.float64] | float) -> NDArray[np.float64]:
        patches = self._patches_world(ends=ends)
        if not len(self.parts_world) or self.grid is None:
            return patches
        slopes, (lowest, highest) = slopes_of(self.points_sensor), self.placed.slope_range
        return reach_bounds(
            patches,
            at_lowest_beam=slopes < lowest + self.grid.row_step_rad / 2,
            at_highest_beam=slopes > highest - self.grid.row_step_rad / 2,
            bottom_m=float(self.parts_world[..., 2].min()),
            top_m=float(self.parts_world[..., 2].max()),
            clearance_m=self.clearance_m,
        )

    def certain_world(self) -> NDArray[np.float64]:
        """The surface only where the returns leave no doubt; see `surface_patches`."""
        return self._patches_world(certain=True)

    def _patches_world(self, *, ends: NDArray[np.float64] | float = 0.5, certain: bool = False) -> NDArray[np.float64]:
        if self.grid is None:
            return np.empty((4, 0, 3))
        return surface_patches(
            self.points_sensor,
            self.cluster.points_world,
            world_from_sensor=self.world_from_sensor.rotation,
            grid=self.grid,
            ends=ends,
            certain=certain,
        )

    def shadow_world(self) -> NDArray[np.float64]:
        """What of the annotated shape lies behind its own returns: there the lidar sees nothing, and a camera may.

        Returns:
            (4, 2 M, 3) float64, m, world frame, of the M returns at the outline: what the middle lines of each patch,
            across and upright, sweep on their way along the beam to the end of the shape. Empty for point indices.
        """
        if not len(self.parts_world) or self.grid is None:
            return np.empty((4, 0, 3))
        outermost = (self.grid.neighbours < 0).any(axis=0)
        beams = normalise(self.world_from_sensor.rotate(self.points_sensor[outermost]))
        ways_m = way_out_m(self.cluster.points_world[outermost], beams, self.parts_world)
        left_above, right_above, right_below, left_below = self.patches_world[:, outermost]
        across = np.stack([left_above + left_below, right_above + right_below]) / 2
        upright = np.stack([left_above + right_above, left_below + right_below]) / 2
        lines = np.concatenate([across, upright], axis=1)
        return np.concatenate([lines, lines[::-1] + np.tile(beams * ways_m[:, None], (2, 1))])

    def unseen_world(self) -> NDArray[np.float64]:
        """What of the annotated shape lies below the lowest beam or above the highest.

        Returns:
            (Q, 2 K, 3) float64, m, corners of convex bodies, world frame; upright in the sensor frame.
        """
        lowest, highest = self.placed.slope_range
        found = []
        for corners in self.world_from_sensor.inverse().apply(self.parts_world):
            flat_m, heights_m = np.hypot(corners[:, 0], corners[:, 1]), corners[:, 2]
            bottom_m, top_m = heights_m.min(), heights_m.max()
            for slope, end_m in ((lowest, bottom_m), (highest, top_m)):
                limit_m = np.clip(slope * flat_m, bottom_m, top_m)
                if (limit_m != end_m).any():
                    ends = (np.column_stack([corners[:, :2], z]) for z in (limit_m, np.full_like(limit_m, end_m)))
                    found.append(np.concatenate(list(ends)))
        return self.world_from_sensor.apply(np.array(found).reshape(-1, 2 * self.parts_world.shape[1], 3))


def way_out_m(
    points: NDArray[np.float64], directions: NDArray[np.float64], parts: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(N,) float64, m: how far the end of an upright shape is from points within; 0 beyond it.

    Args:
        points: (N, 3) float64, m.
        directions: (N, 3) float64, unit.
        parts: (P, K, 3) float64, m, corners of the bodies that the shape is made of.
    """
    corners = parts.reshape(-1, 3)
    ring = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(corners[:, :2])))
    if len(ring) < 4:  # no area
        return np.zeros(len(points))
    sides, upwards = np.diff(ring, axis=0), np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    normals = np.concatenate([np.column_stack([sides[:, 1], -sides[:, 0], np.zeros(len(sides))]), upwards])
    ends = np.concatenate([np.column_stack([ring[:-1], np.zeros(len(sides))]), corners[[np.argmin(corners[:, 2])]],
                           corners[[np.argmax(corners[:, 2])]]])  # fmt: skip
    inwards = (normals * (corners.mean(axis=0) - ends)).sum(axis=1) > 0
    normals[inwards] *= -1
    heights, speeds = (normals * ends).sum(axis=1) - points @ normals.T, directions @ normals.T
    with np.errstate(divide="ignore", invalid="ignore"):
        ways = np.where(speeds > 0, heights / speeds, np.inf)
    return np.asarray(np.maximum(ways.min(axis=1), 0.0))
