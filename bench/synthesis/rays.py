"""Rays that hit triangles.

Embree says which triangle a ray meets first. Where it meets it is computed here, in double precision: Embree's own
distances are off by another last bit of single precision on each kind of processor. And of faces that lie on each other
(a cornice on a wall, panels of a car) the processor would choose, so for Embree the later one lies a little deeper.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from types import ModuleType

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.errors import UsageError
from bench.geometry import cross, dot, normalise
from bench.synthesis.mesh import Mesh

EMBREEX = find_spec("embreex") is not None  # there is no wheel for Linux on arm64 and macOS on Intel
PLANE_DECIMALS = 5  # faces lie in one plane whose normals and offsets (m) agree to so many
LEAST_OVERLAP_M2 = 1e-6
DEPTH_M = 2e-4  # between faces of one plane, ten times what single precision is off at 100 m


def depths_m(mesh: Mesh) -> NDArray[np.float64]:
    """Depth of each triangle, (T,): 0, unless it overlaps earlier ones of its plane that look otherwise."""
    corners_m = mesh.corners_m
    normals = normalise(cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0]))
    axes = np.abs(np.round(normals, PLANE_DECIMALS)).argmax(axis=1)
    normals *= np.sign(np.take_along_axis(normals, axes[:, None], axis=1))  # both sides of a face lie in one plane
    offsets_m = dot(normals, corners_m[:, 0])
    _, planes = np.unique(np.round([*normals.T, offsets_m], PLANE_DECIMALS) + 0.0, axis=1, return_inverse=True)
    _, looks = np.unique(mesh.surfaces, axis=0, return_inverse=True)
    kinds = np.bincount(np.unique([planes, looks], axis=1)[0])  # looks of each plane
    depths = np.zeros(len(corners_m), dtype=np.int64)
    for axis in range(3):
        rows = np.flatnonzero((kinds[planes] > 1) & (axes == axis))
        outlines = np.asarray(shapely.polygons(np.delete(corners_m[rows], axis, axis=2)))
        pairs = shapely.STRtree(outlines).query(outlines)
        first, later = rows[pairs]
        pairs = pairs[:, (first < later) & (planes[first] == planes[later]) & (looks[first] != looks[later])]
        overlaps_m2 = shapely.area(shapely.intersection(*outlines[pairs]))
        pairs = rows[pairs[:, overlaps_m2 > LEAST_OVERLAP_M2]]
        for first, later in pairs[:, np.lexsort(pairs)].T:  # by the later one, so that the first's depth is known
            depths[later] = max(depths[later], depths[first] + 1)
    return np.asarray(depths * DEPTH_M)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hits:
    """The first triangle that each ray meets.

    Attributes:
        distances_m: (N,) float64, in lengths of the ray's direction; infinite where it meets nothing.
        triangles: (N,) int64, row of the triangle; -1 where it meets nothing.
        normals: (N, 3) float64, unit length; anything where it meets nothing.
    """

    distances_m: NDArray[np.float64]
    triangles: NDArray[np.int64]
    normals: NDArray[np.float64]


class RayScene:
    """Triangles, ready to be hit: Embree, by its wheel where there is one, else as open3d holds it.

    Args:
        corners_m: (T, 3, 3), m; the frame of the rays.
        depths_m: (T,), see `depths_m`; None where it does not matter which of two faces of one plane is hit.
    """

    def __init__(self, corners_m: NDArray[np.float64], depths_m: NDArray[np.float64] | None = None) -> None:
        self._first_m = corners_m[:, 0]
        self._normals = normalise(cross(corners_m[:, 1] - self._first_m, corners_m[:, 2] - self._first_m))
        if depths_m is not None:
            corners_m = corners_m - np.nan_to_num(depths_m[:, None] * self._normals)[:, None]
        self._find = (_embreex_scene if EMBREEX else _open3d_scene)(np.ascontiguousarray(corners_m, dtype=np.float32))

    def cast(self, directions: NDArray[np.float64], origins_m: NDArray[np.float64] | None = None) -> Hits:
        """Follow rays.

        Args:
            directions: (N, 3), any length.
            origins_m: (N, 3), m; None for the origin.
        """
        origins = np.zeros_like(directions) if origins_m is None else origins_m
        triangles = self._find(origins.astype(np.float32, copy=False), directions.astype(np.float32, copy=False))
        normals, towards_m = self._normals[triangles], self._first_m[triangles] - origins
        with np.errstate(divide="ignore", invalid="ignore"):  # of what a ray runs along, or does not meet
            distances = dot(normals, towards_m) / dot(normals, directions)
        return Hits(distances_m=np.where(triangles < 0, np.inf, distances), triangles=triangles, normals=normals)


Find = Callable[[NDArray[np.float32], NDArray[np.float32]], NDArray[np.int64]]  # of origins and directions, (N, 3) each


def _embreex_scene(corners: NDArray[np.float32]) -> Find:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene(robust=True)  # no ray slips between triangles that share an edge
    TriangleMesh(scene, corners)
    return lambda origins, directions: scene.run(origins, directions).astype(np.int64)


@cache
def _open3d() -> ModuleType:
    """The open3d module, imported on the first call, which takes 0.6 s.

    The wheel links against `libusb-1.0.so.0`, which servers and containers often lack; the `libusb-package` wheel
    carries that library, and once it is loaded for the whole process the import finds it, without root.

    Raises:
        UsageError: libraries of the system that it links against are missing.
    """
    try:
        import libusb_package
    except ImportError:  # only wanted on Linux
        pass
    else:
        library = libusb_package.get_library_path()
        if library is not None:
            ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    # Its viewers import plotly and dash, which nothing here needs; an installation may leave them out.
    viewers = "open3d.visualization"
    without_viewers = not all(map(find_spec, ("plotly", "dash")))
    if without_viewers:
        sys.modules.setdefault(viewers, ModuleType(viewers))
    try:
        import open3d as module
    except (ImportError, OSError) as error:
        hint = "it links against libraries that slim systems lack, on Debian: apt-get install libegl1 libgl1 libx11-6"
        raise UsageError(f"open3d: expected a library that loads, got {error}; {hint}") from error
    finally:
        if without_viewers:
            del sys.modules[viewers]
    return module


def _open3d_scene(corners: NDArray[np.float32]) -> Find:
    library = _open3d()
    scene = library.t.geometry.RaycastingScene(nthreads=1)  # a worker process is one thread
    vertices = corners.reshape(-1, 3)
    rows = np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)
    scene.add_triangles(library.core.Tensor(vertices), library.core.Tensor(rows))

    def find(origins: NDArray[np.float32], directions: NDArray[np.float32]) -> NDArray[np.int64]:
        rays = np.concatenate([origins, directions], axis=1)
        hits = scene.cast_rays(library.core.Tensor(rays), nthreads=1)
        triangles = hits["primitive_ids"].numpy().astype(np.int64)
        return np.where(np.isfinite(hits["t_hit"].numpy()), triangles, -1)

    return find
