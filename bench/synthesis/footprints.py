"""The ground that bodies cover on their way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from bench.synthesis.driving.host import OUTLINE_M
from bench.synthesis.driving.path import Path
from bench.synthesis.ways import Ways

KEEP_CLEAR_M = 0.4  # from the ways to whatever stands beside them: a hand's breadth more than a mirror is wide


def watched_times(ways: Ways) -> NDArray[np.int64]:
    """(N,) int64, ns: the image times, carried on to where the lidar sees its first and its last point."""
    turn_ns = int(ways.sweep_times_ns[1] - ways.sweep_times_ns[0])
    first_ns, last_ns = int(ways.sweep_times_ns[0]) - turn_ns, int(ways.sweep_times_ns[-1]) + turn_ns
    images = ways.image_times_ns
    step_ns = int(images[1] - images[0]) if len(images) > 1 else turn_ns
    return np.arange(-(-first_ns // step_ns), last_ns // step_ns + 1, dtype=np.int64) * step_ns


def footprints(path: Path, outline_m: ArrayLike, times_ns: NDArray[np.int64]) -> NDArray[np.object_]:
    """Where an outline lies at each time.

    Args:
        path: of the body.
        outline_m: (K, 2), m, in the body's frame, not closed.
        times_ns: (N,) int64 within the path.

    Returns:
        (N,) shapely polygons, world, m.
    """
    poses = path.at(times_ns)
    return outlines_at(poses.rotations, poses.positions_m, outline_m)


def outlines_at(
    rotations: NDArray[np.float64], positions_m: NDArray[np.float64], outline_m: ArrayLike
) -> NDArray[np.object_]:
    """Where an outline lies at (N, 3, 3) turns and (N, 3) places of its body: (N,) shapely polygons, world, m."""
    outline = np.asarray(outline_m, dtype=np.float64)
    rings = np.einsum("nij,kj->nki", rotations[:, :2, :2], outline) + positions_m[:, None, :2]
    return np.asarray(shapely.polygons(rings))


def box_outline(size_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 2) float64, m: the box around a body from above, in its own frame."""
    return np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * size_m[:2]


def swept_ground(ways: Ways, sizes_m: Sequence[NDArray[np.float64]]) -> tuple[shapely.Polygon, ...]:
    """What the host and each actor cover during a recording, with a margin; nothing else may stand there.

    Args:
        ways: of the recording.
        sizes_m: (3,) each, m, the boxes around the actors' bodies.
    """
    times_ns = watched_times(ways)
    rows = [footprints(ways.host, OUTLINE_M, times_ns)]
    rows += [footprints(path, box_outline(size), times_ns) for path, size in zip(ways.actors, sizes_m, strict=True)]
    return tuple(_swept(row) for row in rows)


def _swept(row: NDArray[np.object_]) -> shapely.Polygon:
    """One polygon around a row of footprints: hulls of neighbours leave no gaps, however fast the body is."""
    pairs = shapely.convex_hull(shapely.union(row[:-1], row[1:]))
    swept = shapely.buffer(shapely.union_all(pairs), KEEP_CLEAR_M, join_style="mitre")
    return swept if isinstance(swept, shapely.Polygon) else shapely.convex_hull(swept)
