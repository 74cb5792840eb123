"""Rays against triangles, by open3d's Embree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.lidar.cloud_files import open3d

ONE_THREAD = 1  # a worker process is one thread


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hits:
    """The first triangle that each ray meets.

    Attributes:
        distances_m: (N,) float32, in lengths of the ray's direction; infinite where it meets nothing.
        triangles: (N,) int64, row of the triangle; anything where it meets nothing.
        normals: (N, 3) float32, unit length.
    """

    distances_m: NDArray[np.float32]
    triangles: NDArray[np.int64]
    normals: NDArray[np.float32]


class RayScene:
    """Triangles, ready to be hit.

    Args:
        corners_m: (T, 3, 3), m; the frame of the rays.
    """

    def __init__(self, corners_m: NDArray[np.float64]) -> None:
        self._o3d = open3d()
        self._scene = self._o3d.t.geometry.RaycastingScene(nthreads=ONE_THREAD)
        vertices = np.ascontiguousarray(corners_m.reshape(-1, 3), dtype=np.float32)
        rows = np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)
        self._scene.add_triangles(self._o3d.core.Tensor(vertices), self._o3d.core.Tensor(rows))

    def cast(self, directions: NDArray[np.floating], origins_m: NDArray[np.floating] | None = None) -> Hits:
        """Follow rays.

        Args:
            directions: (N, 3), any length.
            origins_m: (N, 3), m; None for the origin.
        """
        rays = np.empty((len(directions), 6), dtype=np.float32)
        rays[:, :3] = 0.0 if origins_m is None else origins_m
        rays[:, 3:] = directions
        found = self._scene.cast_rays(self._o3d.core.Tensor(rays), nthreads=ONE_THREAD)
        return Hits(
            distances_m=found["t_hit"].numpy(),
            triangles=found["primitive_ids"].numpy().astype(np.int64),
            normals=found["primitive_normals"].numpy(),
        )
