"""Which pixels of an image are an object's for certain, which may be, and which object they belong to.

The outline of an object's returns is as uncertain as its causes make it, each a standard deviation in pixels:

- **beam spacing**: the outline lies anywhere between the outermost return and the next beam, which missed, uniform over
  one step between columns or rows: step / sqrt(12), along that step. Lidars have rows close together near the horizon
  and far apart below. Where the returns form no rows, each of N stands for an N-th of the region: s = sqrt(area / N).
- **range noise** moves a return along the lidar's ray, which the camera sees from the side: noise x sin(parallax).
- **calibration** between lidar and camera: an angle, and a displacement over the distance.
- **time** between return and exposure: the object's own motion is compensated, that of its limbs is not. A limb swings
  along the direction of travel, as a sine (rms = peak / sqrt(2)), the faster the farther from its joint: feet move, the
  head does not. The camera sees what of it lies across its ray.
  Without times of points the relative motion during a revolution is not compensated either: uniform over one.

Their root of squares is u, the standard deviation of the outline near each return. The **core** is the region less u,
the **band** what lies within u of the outline on either side. Beam spacing differs by direction, so its part of u moves
the ends of the patches (`certain_and_possible_ends`), and the rest the outline of their union. What else is not certain
belongs to the band:

- where returns are missing between two, or so far apart in range that they may be two surfaces (a leg and a wheel), and
  beside what is as thin as a beam (spokes): air may lie there. Vehicles are solid and have none of these.
- what of the annotated shape lies below the lowest beam or above the highest: a lidar on the roof looks over what is
  beside the vehicle.
- what of the annotated shape lies behind its own returns: the lidar sees the back of who passes, the camera the front.

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
from bench.geometry import cross, dot
from bench.geometry.raster import Raster
from bench.records.reference import IgnoreReason, Limb, OutlineErrors, ReferenceObject, Status

SECOND_NS = 1_000_000_000
SINE_RMS = 2.0**-0.5  # of a peak speed, over a stride


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


def limb_motion_m(
    limbs: Sequence[Limb], heights: NDArray[np.float64], *, speed_mps: float, times_ns: NDArray[np.int64]
) -> NDArray[np.float64]:
    """How far returns moved with limbs: (N,) float64, m, standard deviation along the direction of travel.

    Args:
        limbs: of the object; the fastest at each return's height counts.
        heights: (N,) float64, of each return above the object's bottom, over the object's height.
        speed_mps: of the object.
        times_ns: (N,) int64, of each return, since the exposure.
    """
    shares = [limb.speed * (limb.joint - heights) / (limb.joint - limb.end) for limb in limbs]
    reached = [np.where(heights >= limb.end, share, 0.0) for limb, share in zip(limbs, shares, strict=True)]
    fastest = np.maximum.reduce([np.zeros_like(heights), *reached])
    return np.asarray(fastest * SINE_RMS * speed_mps * np.abs(times_ns) / SECOND_NS)


def outline_error_m(
    points_camera: NDArray[np.float64],
    *,
    sensor_camera: NDArray[np.float64],
    variance_m2: NDArray[np.float64],
    errors: OutlineErrors,
) -> NDArray[np.float64]:
    """How uncertain an object's outline is near each of its returns, for all causes but the spacing of the beams.

    Args:
        points_camera: (N, 3) float64, m, these returns at exposure.
        sensor_camera: (3,) float64, m, where the lidar was.
        variance_m2: (N,) float64, square of the standard deviation of what of each return's motion nothing tells, as
            the camera sees it.
        errors: of the protocol.

    Returns:
        (N,) float64, m, standard deviation across the camera's ray.
    """
    beams = points_camera - sensor_camera
    distance2_m2, aside = dot(points_camera, points_camera), cross(points_camera, beams)
    parallax2 = np.nan_to_num(dot(aside, aside) / (distance2_m2 * dot(beams, beams)))  # squared sine
    variance_m2 = variance_m2 + errors.range_noise_m**2 * parallax2 + errors.position_m**2
    return np.asarray(np.sqrt(errors.angle_rad**2 * distance2_m2 + variance_m2))


def without_band(raster: Raster) -> Region:
    """A region of which all is certain."""
    return Region(window=raster.window, core=raster.covered, possible=raster.covered)


def uncertain_region(
    raster: Raster,
    valid: NDArray[np.bool_],
    *,
    least: Raster,
    most: Raster,
    returns_px: NDArray[np.intp],
    half_width_px: NDArray[np.float64],
    certain: Raster | None,
    unseen: Raster | None,
    shadow: Raster | None,
) -> Region:
    """The core of a region, and what may be the object's beside it.

    Args:
        raster: pixels of the region in V.
        valid: (H, W) bool, the region V. Its border is no outline: the object goes on behind it.
        least: the region with the ends of its patches drawn in as far as the spacing of the beams allows.
        most: what it gains with its ends drawn out.
        returns_px: (N, 2) intp, (u, v), pixels of the object's returns.
        half_width_px: (N,) float64, what else is uncertain at each of them; the nearest tells by how much `least`
            shrinks and `most` grows.
        certain: where the surface between the returns is certain; None for everywhere.
        unseen: what of the annotated shape no beam reaches: possible, not certain; None for nothing.
        shadow: what of it the object's own surface hides from the lidar: possible; None for nothing.

    Returns:
        The core is the whole region where nothing of it is certain.
    """
    margin, shape = int(half_width_px.max(initial=0.0)) + 2, np.array(valid.shape)
    windows = [raster.window, *(one.window for one in (least, most, certain, unseen, shadow) if one is not None)]
    first = np.min([[axis.start for axis in window] for window in windows], axis=0) - margin
    last = np.max([[axis.stop for axis in window] for window in windows], axis=0) + margin
    top, left = np.clip(first, 0, shape).tolist()
    bottom, right = np.clip(last, 0, shape).tolist()
    window = slice(top, bottom), slice(left, right)
    region, inside = _in_window(raster, window), valid[window]
    width_px = _of_the_nearest(half_width_px, returns_px - (left, top), region.shape)
    drawn_in, drawn_out = _in_window(least, window), _in_window(most, window) | region
    core = drawn_in & (_distance_px(drawn_in | ~inside) - 0.5 > width_px)  # the outline runs between two pixels
    possible = inside & (_distance_px(~drawn_out) - 0.5 <= width_px)
    if certain is not None:
        core &= _in_window(certain, window)
    if unseen is not None:
        core &= ~(beyond := _in_window(unseen, window))
        possible |= inside & beyond
    if shadow is not None:
        possible |= inside & _in_window(shadow, window)
    return Region(window=window, core=core if core.any() else region, possible=possible)


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
