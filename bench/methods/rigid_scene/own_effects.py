"""The ego vehicle's own shadow and light on the road, which move with it and are no objects.

Such a pattern stands still in the image, or nearly so, while the road moves below it: the image is S(x) + T(x), with S
fixed in it and T moving with the road. The difference of two images at the same pixel is free of S, and it moves with
the road: the last difference is the one before it, displaced by the road's motion. A car ahead at the ego vehicle's
speed stands still in the image as well, but no road moves below its surface; it differs by noise alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.methods.rigid_scene.evidence import BELOW_HORIZON, WINDOW_PX, Evidence
from bench.methods.rigid_scene.scene import box_mean, sampled

LEAST_ROAD_PX = 4.0  # motion of the road, beyond its fine texture, from which it is told from what stands still
ON_ROAD = 0.7  # share of a region on road that moves so far
LEAST_CORRELATION = 0.3  # over a whole region, far above chance


def own_effects(
    region: NDArray[np.bool_], images: Sequence[NDArray[np.uint8]], evidence: Evidence
) -> NDArray[np.bool_]:
    """Components of a region through which the road is seen to move.

    Args:
        region: (H, W) bool, what may move.
        images: the last three, (H, W) uint8, grey, oldest first.
        evidence: of the last two.

    Returns:
        (H, W) bool.

    Source:
        Shizawa and Mase, Simultaneous multiple optical flow estimation, 1990: two transparent motions, one of them 0.
    """
    earlier, previous, current = (image.astype(np.float32) for image in images)
    now, before = current - previous, sampled(previous - earlier, evidence.road)
    now, before = now - box_mean(now, WINDOW_PX), before - box_mean(before, WINDOW_PX)
    moves = np.hypot(evidence.road[..., 0], evidence.road[..., 1]) > LEAST_ROAD_PX
    used = region & moves & (evidence.fall > BELOW_HORIZON) & ~evidence.edge
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(region.astype(np.uint8), connectivity=8)

    def summed(values: NDArray[np.float32]) -> NDArray[np.float64]:
        return np.bincount(labels[used], weights=values[used], minlength=count).astype(np.float64)

    pixels = np.bincount(labels[used], minlength=count)
    noise = pixels * evidence.noise**2 / 2
    found = summed(now * before) > LEAST_CORRELATION * np.hypot(
        np.sqrt(summed(now * now) * summed(before * before)), noise
    )
    found &= pixels > ON_ROAD * boxes[:, cv2.CC_STAT_AREA]
    found[0] = False
    return np.asarray(found[labels])
