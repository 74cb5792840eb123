"""Which triangle each pixel sees: every triangle is drawn into the pixels whose rays pass through it.

This holds for rays in any direction, so a fisheye image needs neither an image plane nor a cut in front of the camera,
and it is exact where a camera of straight lines would not be.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.imaging.drawing import draw
from bench.synthesis.imaging.lens import TILE_PX, Lens
from bench.synthesis.imaging.planes import BUCKETS, COLUMNS, find_planes, nearest_first

LEAST_MARGIN_PX = 0.05  # around boxes of triangles, beside what the chart is off
NOTHING = -1  # triangle of a pixel that sees the sky


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """What a camera sees.

    Attributes:
        planes: (T, 16) float32, columns as in `planes`; of triangles that are not hidden.
        triangles: (H / 8, W / 8, 64) int32, row of what each pixel sees, or NOTHING; tile by tile, see `untiled`.
        nearness: (H / 8, W / 8, 64) float32, 1 / m, 1 over the distance of what is seen; 0 where there is nothing.
    """

    planes: NDArray[np.float32]
    triangles: NDArray[np.int32]
    nearness: NDArray[np.float32]


def look(
    corners_m: NDArray[np.float64],
    lens: Lens,
    *,
    camera_from_world: NDArray[np.float64],
    origin_m: NDArray[np.float64],
    reach_m: float = np.inf,
) -> View:
    """Find out what each pixel sees.

    Args:
        corners_m: (T, 3, 3), m, world.
        lens: of the camera.
        camera_from_world: (3, 3), rotation.
        origin_m: (3,), m, the camera in the world.
        reach_m: what looks small and lies further away is left out.
    """
    count, shape = len(corners_m), (lens.valid.shape[0], lens.valid.shape[1])
    planes, boxes = np.empty((count, COLUMNS), dtype=np.float32), np.empty((count, 4), dtype=np.int16)
    distances_m, order = np.empty(count, dtype=np.float32), np.empty(count, dtype=np.int32)
    find_planes(
        corners_m, camera_from_world, origin_m, lens.chart, 2.0 * lens.chart_error_px + LEAST_MARGIN_PX,
        lens.px_per_rad, lens.widest_rad, reach_m, shape, planes, boxes,
        distances_m, np.empty((3, 3)),
    )  # fmt: skip
    seen = nearest_first(boxes, distances_m.view(np.int32), np.empty(BUCKETS, dtype=np.int32), order)
    rows, columns = lens.tiles.shape[:2]
    nearness = np.zeros((rows, columns, TILE_PX * TILE_PX), dtype=np.float32)
    triangles = np.full(nearness.shape, NOTHING, dtype=np.int32)
    farthest, changed = np.zeros((rows, columns), dtype=np.float32), np.zeros((rows, columns), dtype=np.bool_)
    draw(
        planes, boxes, order[:seen], lens.tile_rays, lens.regions, lens.blocks, lens.tiles,
        nearness.view(np.int32), triangles, farthest, farthest.view(np.int32), changed,
    )  # fmt: skip
    return View(planes=planes, triangles=triangles, nearness=nearness)
