"""Flat shapes scanned by a lidar with a regular grid of beams, so that the true outline is known."""

import numpy as np
import shapely

from bench.reference.grid import find_grid
from bench.reference.patches import surface_patches

SENSORS = {  # steps between columns and rows, degrees
    "hdl-64e": (0.1728, 0.42),
    "128 rows": (0.2, 0.2),
    "wide columns": (0.7, 0.35),
    "32 rows": (0.2, 1.33),
}


def scan(shape, *, steps_deg, distance_m=6.0, phase=(0.3, 0.6), jitter_rad=0.0, seed=0):
    """Returns of a shape in the plane x = distance, given in its (y, z); (N, 3) m, lidar frame."""
    columns, rows = (
        np.radians(np.arange(-30, 30, step) + part * step) for step, part in zip(steps_deg, phase, strict=True)
    )
    azimuth, elevation = (angles.ravel() for angles in np.meshgrid(columns, rows))
    rng = np.random.default_rng(seed)
    azimuth = azimuth + jitter_rad * rng.standard_normal(azimuth.shape)
    elevation = elevation + jitter_rad * rng.standard_normal(elevation.shape)
    points = np.column_stack(
        [
            np.full(len(azimuth), distance_m),
            distance_m * np.tan(azimuth),
            distance_m * np.tan(elevation) / np.cos(azimuth),
        ]
    )
    return points[shapely.contains_xy(shape, points[:, 1], points[:, 2])]


def patches_of(points):
    """Corners of the patches, (3, 4, N) m, lidar frame."""
    grid = find_grid(points)
    assert grid is not None
    return surface_patches(points, world_from_sensor=np.eye(3), grid=grid).corners


def union_of(corners):
    """Patches, (3, 4, N) m, in the shape's own plane, (y, z) m."""
    return shapely.union_all(shapely.polygons(corners[1:].T))


def silhouette_of(points):
    """The union of the patches in the shape's own plane, (y, z) m."""
    return union_of(patches_of(points))


def iou(one, other):
    return one.intersection(other).area / one.union(other).area
