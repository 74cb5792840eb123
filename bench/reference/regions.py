"""Which pixels of an image are an object's for certain, which may be, and which object they belong to.

The outline of an object's returns is as uncertain as its causes make it, each a standard deviation in pixels:

- **beam spacing**: the outline lies anywhere between the outermost return and the next beam, which missed. Each of N
  returns stands for an N-th of the region, so their spacing in the image is s = sqrt(area / N) on any surface, with or
  without rows; uniform over one spacing: s / sqrt(12).
- **range noise** moves a return along the lidar's ray, which the camera sees from the side: noise x sin(parallax).
- **calibration** between lidar and camera: an angle, and a displacement over the distance.
- **time** between return and exposure: the object's own motion is compensated, that of its limbs is not. A limb swings
  from its joint: its speed grows along it from 0 to a peak, and over a stride as a sine: rms = peak / sqrt(6).
  Without times of points the relative motion during a revolution is not compensated either: uniform over one.

Their root of squares is u, the standard deviation of the outline. The **core** is the region less u, the **band** what
lies within u of the outline on either side. What else is not certain belongs to the band:

- between returns so far apart in range that they may be two surfaces (a leg and a wheel), and where a beam went past
  between returns (spokes): seen from the camera, air may lie there. Vehicles are solid and have none of these.
- what of the annotated shape lies below the lowest beam or above the highest: a lidar on the roof looks over what is
  beside the vehicle.

In the band a detection is neither right nor wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras import CameraModel, ray_grid
from bench.geometry import cross, dot, normalise
from bench.reference.polygons import Raster
from bench.reference.records import IgnoreReason, OutlineErrors, ReferenceObject, Status

SECOND_NS = 1_000_000_000
LIMB_RMS = 6.0**-0.5  # of the peak speed at a limb's end: 1 / sqrt(3) along it, 1 / sqrt(2) over a stride


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Region:
    """Pixels of one object by itself, before occlusion.

    Attributes:
        window: rows and columns of the image that hold them all; may be empty.
        core: (rows, columns) bool, of the window; for certain.
        possible: (rows, columns) bool, the core and the band around it.
    """

    window: tuple[slice, slice]
    core: NDArray[np.bool_]
    possible: NDArray[np.bool_]


def limb_motion_m(peak_speed_mps: float, times_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """How far returns moved with limbs: (N,) float64, m, standard deviation.

    Args:
        peak_speed_mps: at a limb's end, relative to the body.
        times_ns: (N,) int64, of each return, since the exposure.
    """
    return LIMB_RMS * peak_speed_mps * np.abs(times_ns) / SECOND_NS


def outline_error_px(
    points_camera: NDArray[np.float64],
    sensor_camera: NDArray[np.float64],
    *,
    unknown_motion_m: NDArray[np.float64],
    region_px: int,
    camera: CameraModel,
    errors: OutlineErrors,
) -> float:
    """Half the width of an object's band: u.

    Args:
        points_camera: (N, 3) float64, m, the object's returns at exposure.
        sensor_camera: (3,) float64, m, where the lidar was.
        unknown_motion_m: (N,) float64, standard deviation of what of each return's motion nothing tells.
        region_px: area of the region.
        camera: the lens.
        errors: of the protocol.

    Returns:
        u in pixels; 0 where no return falls into the image.
    """
    pixels, valid = camera.project(points_camera)
    seen = valid & camera.contains(pixels)
    if not seen.any():
        return 0.0
    u, v = np.rint(pixels[seen]).astype(np.intp).T
    px_per_rad = pixels_per_radian(camera)[v, u]
    rays = points_camera[seen]
    px_per_m = px_per_rad / np.sqrt(dot(rays, rays))
    aside = np.nan_to_num(cross(normalise(rays), normalise(rays - sensor_camera)))  # its length: sine of the parallax
    spread_m2 = errors.range_noise_m**2 * dot(aside, aside) + errors.position_m**2
    spread_m2 = spread_m2 + unknown_motion_m[seen] ** 2
    variance_px2 = (px_per_rad * errors.angle_rad) ** 2 + px_per_m**2 * spread_m2
    spacing_px2 = region_px / np.count_nonzero(seen) / 12
    return float(np.sqrt(variance_px2.mean() + spacing_px2))


def without_band(raster: Raster) -> Region:
    """A region of which all is certain."""
    return Region(window=raster.window, core=raster.covered, possible=raster.covered)


def uncertain_region(
    raster: Raster,
    valid: NDArray[np.bool_],
    *,
    half_width_px: float,
    certain: Raster | None,
    gaps: Raster | None,
    unseen: Raster | None,
) -> Region:
    """The core of a region, and what may be the object's beside it.

    Args:
        raster: pixels of the region in V.
        valid: (H, W) bool, the region V. Its border is no outline: the object goes on behind it.
        half_width_px: u, of the band on either side of the outline.
        certain: where the surface between the returns is certain; None for everywhere.
        gaps: where beams went past between the returns; None for nowhere.
        unseen: what of the annotated shape the lidar cannot reach: possible, not certain; None for nothing.

    Returns:
        The core is the whole region where nothing of it is certain.
    """
    margin, shape = int(half_width_px) + 2, np.array(valid.shape)
    windows = [raster.window] if unseen is None else [raster.window, unseen.window]
    first = np.min([[axis.start for axis in window] for window in windows], axis=0) - margin
    last = np.max([[axis.stop for axis in window] for window in windows], axis=0) + margin
    top, left = np.clip(first, 0, shape).tolist()
    bottom, right = np.clip(last, 0, shape).tolist()
    window = slice(top, bottom), slice(left, right)
    region, inside = _in_window(raster, window, valid.shape), valid[window]
    core = region & (_distance_px(region | ~inside) - 0.5 > half_width_px)  # the outline runs between two pixels
    possible = inside & (_distance_px(~region) - 0.5 <= half_width_px)
    if certain is not None:
        core &= _in_window(certain, window, valid.shape)
    for excluded in (gaps, unseen):
        if excluded is not None:
            core &= ~_in_window(excluded, window, valid.shape)
    if unseen is not None:
        possible |= inside & _in_window(unseen, window, valid.shape)
    return Region(window=window, core=core if core.any() else region, possible=possible)


def _in_window(raster: Raster, window: tuple[slice, slice], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    whole = np.zeros(shape, dtype=bool)
    whole[raster.window] = raster.covered
    return whole[window]


def _distance_px(mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Distance of each pixel of a mask to the nearest pixel outside of it; 0 outside."""
    return np.asarray(cv2.distanceTransform(mask.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE))


@lru_cache(maxsize=16)
def pixels_per_radian(camera: CameraModel) -> NDArray[np.float64]:
    """How large a radian appears at each pixel, (H, W) float64, px/rad, mean of all directions.

    At the border of the lens and beyond, where neighbours are missing, as large as it usually does.
    """
    rays = ray_grid(camera).rays_camera
    right, down = (np.asarray(np.gradient(rays, axis=axis)) for axis in (1, 0))
    areas = cross(right, down)  # length: the solid angle of a pixel
    scale = dot(areas, areas) ** -0.25
    return np.asarray(np.where(np.isfinite(scale), scale, np.nanmedian(scale)))


def compose(
    objects: Sequence[tuple[ReferenceObject, Region | None]], valid: NDArray[np.bool_]
) -> tuple[tuple[ReferenceObject, ...], NDArray[np.int32], NDArray[np.bool_]]:
    """Give every pixel to the nearest annotated object that covers it.

    Static and ignored objects occlude as well: behind a parked car nothing can be detected. In the band of a nearer
    object it is unknown whether a farther one is seen. An evaluated object of which nothing certain remains becomes
    ignored as occluded.

    Args:
        objects: nearest first, each with its pixels inside V; None where it has no polygon.
        valid: (H, W) bool, the region V.

    Returns:
        objects: with `region_px` and `unknown_px` filled in.
        labels: (H, W) int32, k + 1 for pixels of G of object k, else 0.
        ignored: (H, W) bool, the region I: bands, and polygons of ignored objects, minus every G.
    """
    labels, ignored = np.zeros(valid.shape, dtype=np.int32), np.zeros(valid.shape, dtype=bool)
    hidden, uncertain = np.zeros(valid.shape, dtype=bool), np.zeros(valid.shape, dtype=bool)
    settled = []
    for number, (found, region) in enumerate(objects, start=1):
        if region is None:
            settled.append(found)
            continue
        window, core, possible = region.window, region.core, region.possible
        visible = possible & ~hidden[window]
        certain = core & visible & ~uncertain[window]
        hidden[window] |= core
        uncertain[window] |= possible & ~core
        region_px = int(np.count_nonzero(certain))
        result = found
        if found.status is Status.EVALUATED and region_px:
            unknown = visible & ~certain
            np.copyto(labels[window], number, where=certain)
            ignored[window] |= unknown
            result = replace(found, region_px=region_px, unknown_px=int(np.count_nonzero(unknown)))
        elif found.status is Status.EVALUATED:
            result = replace(found, status=Status.IGNORED, reason=IgnoreReason.OCCLUDED)
        if result.status is Status.IGNORED:
            ignored[window] |= possible & (labels[window] == 0)  # later G begin where this polygon ends
        settled.append(result)
    return tuple(settled), labels, ignored
