"""What the lidar says of one object at an exposure: its surface, the gaps in it, and what was out of reach."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.reference.clusters import Cluster
from bench.reference.patches import (
    CERTAIN_STEPS,
    DEEPEST_STEPS,
    Grid,
    find_grid,
    gap_patches,
    reach_bounds,
    surface_patches,
)
from bench.reference.sweeps import PosedSweep, slopes_of


@dataclass(frozen=True, kw_only=True, eq=False)
class ScannedObject:
    """An object that a sweep has met.

    Attributes:
        cluster: its returns.
        placed: the sweep that they are of.
        parts_world: (P, K, 3) float64, m, the annotated shape at exposure, corners of convex bodies, world frame; none
            for point indices.
    """

    cluster: Cluster
    placed: PosedSweep
    parts_world: NDArray[np.float64]

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
        return find_grid(self.points_sensor)

    def patches_world(self, *, clearance_m: float, certain: bool = False) -> NDArray[np.float64]:
        """The surface that the returns stand for, (N, 4, 3) float64, m, world frame; empty where too few tell.

        Args:
            clearance_m: returns lower than this above the bottom of the shape were taken for the ground's.
            certain: only between neighbours no further apart than over a missing return; else they may be two surfaces.
        """
        if self.grid is None:
            return np.empty((0, 4, 3))
        patches = surface_patches(
            self.points_sensor,
            self.cluster.points_world,
            world_from_sensor=self.world_from_sensor.rotation,
            grid=self.grid,
            deepest_steps=CERTAIN_STEPS if certain else DEEPEST_STEPS,
        )
        if not len(self.parts_world):
            return patches
        slopes, (lowest, highest) = slopes_of(self.points_sensor), self.placed.slope_range
        return reach_bounds(
            patches,
            at_lowest_beam=slopes < lowest + self.grid.row_step_rad / 2,
            at_highest_beam=slopes > highest - self.grid.row_step_rad / 2,
            bottom_m=float(self.parts_world[..., 2].min()),
            top_m=float(self.parts_world[..., 2].max()),
            clearance_m=clearance_m,
        )

    def gaps_world(self) -> NDArray[np.float64]:
        """Where beams went past between the returns, (M, 4, 3) float64, m, world frame, patches as of the surface."""
        if self.grid is None:
            return np.empty((0, 4, 3))
        around = self.placed.rows_towards(self.points_sensor)
        others = around[~np.isin(around, self.cluster.rows, assume_unique=True)]
        return gap_patches(
            self.points_sensor,
            self.cluster.points_world,
            self.placed.points_sensor(others),
            world_from_sensor=self.world_from_sensor.rotation,
            grid=self.grid,
        )

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
