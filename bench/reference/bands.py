"""The unknown band around a region: what is an object's for certain, and what may be.

The root of the squares of all causes is u, the standard deviation of the outline near each return; see
`outline_errors`. The **core** is the region less u, the **band** what lies within u of the outline on either side. What
else is not certain belongs to the band:

- where returns are missing between two, or so far apart in range that they may be two surfaces (a leg and a wheel), and
  beside what is as thin as a beam (spokes): air may lie there. Vehicles are solid and have none of these.
- what of the annotated shape lies below the lowest beam or above the highest: a lidar on the roof looks over what is
  beside the vehicle.
- what of the annotated shape lies behind its own returns: the lidar sees the back of who passes, the camera the front.
- what of a vehicle's shape lies in directions that returned nothing: black paint, glass, wet or tilted metal.

In the band a detection is neither right nor wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras import CameraModel, ray_grid
from bench.geometry import cross, dot
from bench.geometry.raster import Raster
from bench.reference.regions import Region
from bench.reference.scanned import ScannedObject, Surface
from bench.reference.silence import silent


def with_band(region: Region, scanned: ScannedObject) -> Region:
    """The region of a scanned object, divided into what is certain and what is possible."""
    surface, inside, points_camera = scanned.surface, scanned.inside, scanned.points_camera[scanned.inside]
    returns_px = np.rint(scanned.pixels[inside]).astype(np.intp)
    px_per_radian = pixels_per_radian(scanned.exposure.camera.model)[returns_px[:, 1], returns_px[:, 0]]
    half_width_px = scanned.error_m[inside] * (px_per_radian / np.sqrt(dot(points_camera, points_camera)))
    if scanned.grid is None:
        spacing2_px = region.polygon_px / max(len(returns_px), 1)
        half_width_px = np.sqrt(half_width_px**2 + spacing2_px / 12)
    return uncertain_region(
        region,
        scanned.exposure.valid,
        surface,
        returns_px=returns_px,
        half_width_px=half_width_px,
        unseen=scanned.unseen(),
        hidden=[raster for raster in (scanned.shadow(), silent(scanned)) if raster is not None],
    )


def uncertain_region(
    region: Region,
    valid: NDArray[np.bool_],
    surface: Surface,
    *,
    returns_px: NDArray[np.intp],
    half_width_px: NDArray[np.float64],
    unseen: Raster | None,
    hidden: Sequence[Raster],
) -> Region:
    """The core of a region, and what may be the object's beside it.

    Args:
        region: without a band.
        valid: (H, W) bool, the region V. Its border is no outline: the object goes on behind it.
        surface: what its patches are at least, at most and for certain; None in it stands for the whole region.
        returns_px: (N, 2) intp, (u, v), pixels of the object's returns.
        half_width_px: (N,) float64, what else is uncertain at each of them; the nearest tells by how much the
            least shrinks and the most grows.
        unseen: what of the annotated shape no beam reaches: possible, not certain; None for nothing.
        hidden: what of it the object's own surface hides from the lidar, and where nothing came back: possible.

    Returns:
        The core is the whole region where nothing of it is certain.
    """
    whole, certain = Raster(region.window, region.core), surface.certain
    least, most = surface.least or whole, surface.most or whole
    margin, shape = int(half_width_px.max(initial=0.0)) + 2, np.array(valid.shape)
    windows = [
        whole.window,
        *(one.window for one in (least, most, certain, unseen, *hidden) if one is not None),
    ]
    first = np.min([[axis.start for axis in window] for window in windows], axis=0) - margin
    last = np.max([[axis.stop for axis in window] for window in windows], axis=0) + margin
    top, left = np.clip(first, 0, shape).tolist()
    bottom, right = np.clip(last, 0, shape).tolist()
    window = slice(top, bottom), slice(left, right)
    covered, inside = _in_window(whole, window), valid[window]
    width_px = _of_the_nearest(half_width_px, returns_px - (left, top), covered.shape)
    drawn_in, drawn_out = _in_window(least, window), _in_window(most, window) | covered
    core = drawn_in & (_distance_px(drawn_in | ~inside) - 0.5 > width_px)  # the outline runs between two pixels
    possible = inside & (_distance_px(~drawn_out) - 0.5 <= width_px)
    if certain is not None:
        core &= _in_window(certain, window)
    if unseen is not None:
        core &= ~(beyond := _in_window(unseen, window))
        possible |= inside & beyond
    for raster in hidden:
        possible |= inside & _in_window(raster, window)
    return replace(region, window=window, core=core if core.any() else covered, possible=possible)


def _in_window(raster: Raster, window: tuple[slice, slice]) -> NDArray[np.bool_]:
    """The pixels of a raster in a window that holds it."""
    rows, columns = window
    part = np.zeros((rows.stop - rows.start, columns.stop - columns.start), dtype=bool)
    (height, width), (first_row, first_column) = raster.covered.shape, (axis.start for axis in raster.window)
    top, left = first_row - rows.start, first_column - columns.start
    part[top : top + height, left : left + width] = raster.covered
    return part


def _of_the_nearest(
    values: NDArray[np.float64], pixels: NDArray[np.intp], shape: tuple[int, ...]
) -> NDArray[np.float64]:
    """(rows, columns), root mean square of the values at the nearest pixel that has any; 0 where none has."""
    within = ((pixels >= 0) & (pixels < shape[::-1])).all(axis=1)
    if not within.any():
        return np.zeros(shape)
    u, v = pixels[within].T
    empty = np.ones(shape, dtype=np.uint8)
    empty[v, u] = 0
    _, nearest = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
    which = nearest[v, u]
    mean = np.bincount(which, weights=values[within] ** 2) / np.maximum(np.bincount(which), 1)
    return np.asarray(np.sqrt(mean)[nearest])


def _distance_px(mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Distance of each pixel of a mask to the nearest pixel outside of it; 0 outside."""
    return np.asarray(cv2.distanceTransform(mask.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE))


@lru_cache(maxsize=16)
def pixels_per_radian(camera: CameraModel) -> NDArray[np.float64]:
    """Return how large a radian appears at each pixel, (H, W) float64, px/rad, mean of all directions.

    At the border of the lens and beyond, where neighbours are missing, the median of all others.
    """
    rays = ray_grid(camera).rays_camera
    right, down = (np.asarray(np.gradient(rays, axis=axis)) for axis in (1, 0))
    areas = cross(right, down)  # length: the solid angle of a pixel
    scale = dot(areas, areas) ** -0.25
    return np.asarray(np.where(np.isfinite(scale), scale, np.nanmedian(scale)))
