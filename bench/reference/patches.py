"""The piece of surface that each lidar return stands for, and the pixels of their union.

A hull of points ends at the outermost returns, which lie half a beam spacing inside the true outline on average, and
bridges whatever gaps its tightness allows. But a beam answers for the solid angle half-way to its neighbours. The union
of these patches estimates the silhouette without that bias and at the sensor's own resolution: legs stay apart, and a
wheel stays open where the lidar saw through it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.geometry import Floats
from bench.reference.exposure import Exposure
from bench.reference.grid import DOWN, LEFT, RIGHT, UP, Grid
from bench.reference.raster import Raster

SLIT = np.ones((3, 3), dtype=np.uint8)  # closes what is a pixel wide: finer than a beam
MARGIN_PX = 4  # beyond the image, so that its border does not cut the outline
TALL, WIDE = [UP, UP, DOWN, DOWN], [LEFT, RIGHT, RIGHT, LEFT]  # sides that meet at each corner
OPPOSITE = [RIGHT, LEFT, DOWN, UP]


class CutOff(NamedTuple):
    """Parts that the clearance and the lidar's vertical field cut off, restored as far as the annotated shape goes.

    Patches that end within the clearance above the ground stand on it: shoes and tyres. Below the lowest beam and above
    the highest the lidar is blind, there the column goes on to the end of the annotated shape. Nothing else is added:
    under a bumper the lidar saw the road.

    Attributes:
        grounded_m: (N,) float64, m, heights: lower ends below this go on to the bottom; infinite at the lowest beam.
        bottom_m: height of the annotated shape's lowest point, world frame.
        top_m: (N,) float64, m, to which upper ends go on: the shape's highest point at the highest beam, else minus
            infinity.
    """

    grounded_m: Floats
    bottom_m: float
    top_m: Floats

    @classmethod
    def nothing(cls, count: int) -> CutOff:
        """Of returns without an annotated shape."""
        return cls(grounded_m=np.full(count, -np.inf), bottom_m=0.0, top_m=np.full(count, -np.inf))

    def restored(self, corners_world: Floats) -> Floats:
        """Patches, (3, 4, N) float64, m, that reach as far."""
        reached = corners_world.copy()
        upper, lower = reached[2, :2], reached[2, 2:]
        np.minimum(lower, self.bottom_m, out=lower, where=lower < self.grounded_m)
        np.maximum(upper, self.top_m, out=upper)
        return reached


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Patches:
    """The patch of each return.

    Attributes:
        points: (3, N) float64, m, world frame, the returns at exposure.
        reach: (3, 4, N) float64, m, from each return to where its patch ends on each side: at the neighbour, else
            half-way to where the next beam would be.
        step: (3, 4, N) float64, m, to where the next beam would be.
        corners: (3, 4, N) float64, m, world frame: left above, right above, right below, left below.
        grid: neighbours of the returns.
        cut_off: what is given back.
    """

    points: Floats
    reach: Floats
    step: Floats
    corners: Floats
    grid: Grid
    cut_off: CutOff

    def with_free_ends_moved(self, error_m: Floats) -> tuple[Floats, Floats]:
        """The corners with free ends drawn in, and drawn out, by one standard deviation.

        Args:
            error_m: (N,) float64, as for `end_spread`.

        Returns:
            drawn_in: (3, 4, N) float64, m, as `corners`.
            drawn_out: likewise.
        """
        spread = end_spread(self.grid.step_m, error_m).repeat(2, axis=0)
        change = np.where(self.grid.linked, 0.0, self.step * spread)
        drawn_in, drawn_out = (_corners(self.points, self.reach + sign * change) for sign in (-1.0, 1.0))
        return self.cut_off.restored(drawn_in), self.cut_off.restored(drawn_out)

    @property
    def certain_corners(self) -> Floats:
        """(3, 4, N) float64, m, only between neighbours that leave no doubt, and not beyond a return without such a
        neighbour on its other side, since an object as thin as a beam may be any thinner; nothing is given back."""
        certain = self.grid.certain
        return _corners(self.points, np.where(certain, self.reach, self.step * 0.5 * certain[OPPOSITE]))


def surface_patches(
    points_world: Floats, *, world_from_sensor: Floats, grid: Grid, cut_off: CutOff | None = None
) -> Patches:
    """The patch of each return.

    Towards a neighbour the patch reaches along the surface to the neighbour itself, so that patches overlap and leave
    no slits when seen from the camera. Where there is none it ends half-way to where the next beam would be.

    Args:
        points_world: (N, 3) float64, m, the returns at exposure.
        world_from_sensor: (3, 3) float64, from sensor axes to those of `points_world`.
        grid: neighbours of the same returns.
        cut_off: what to give back; None for nothing.
    """
    cut_off = cut_off or CutOff.nothing(len(points_world))
    points = np.ascontiguousarray(points_world.T)
    left, above = np.moveaxis((world_from_sensor @ grid.step_sensor.reshape(3, -1)).reshape(3, 2, -1), 1, 0)
    step = np.stack([left, -left, above, -above], axis=1)
    ways = points.take(grid.neighbours, axis=1) - points[:, None]
    reach = np.where(grid.linked, ways, step * 0.5)
    corners = cut_off.restored(_corners(points, reach))
    return Patches(points=points, reach=reach, step=step, corners=corners, grid=grid, cut_off=cut_off)


def _corners(points: Floats, reach: Floats) -> Floats:
    corners = np.empty_like(reach)
    for corner, (tall, wide) in enumerate(zip(TALL, WIDE, strict=True)):
        np.add(reach[:, tall], reach[:, wide], out=corners[:, corner])
    corners += points[:, None]
    return corners


def end_spread(step_m: Floats, error_m: Floats) -> Floats:
    """Return how far a patch without a neighbour may end from half-way to the next beam, as one standard deviation.

    The outline lies anywhere between the outermost return and the next beam, which missed: uniform over a step, half a
    step on average, with a standard deviation of step / sqrt(12). Together with an error that has other causes it is
    sqrt(error^2 + step^2 / 12); the part of this beyond the error moves the end, along the beams' own rows and columns.

    Args:
        step_m: (2, N) float64, m, to the next column and row.
        error_m: (N,) float64, m, standard deviation of the outline for all other causes, in every direction.

    Returns:
        (2, N) float64, in steps, 0 to 0.29.
    """
    return np.asarray((np.sqrt(error_m**2 + step_m**2 / 12) - error_m) / step_m)


def draw(corners: Floats, exposure: Exposure) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """As `covered_pixels`, of patches, (3, 4, N) float64, m, world frame, that the lens can see whole."""
    camera = exposure.camera.model
    patches_px = np.ascontiguousarray(exposure.project(corners.reshape(3, -1).T).T).reshape(2, 4, -1)
    seen = np.isfinite(patches_px[0]).all(axis=0)
    if not seen.all():
        patches_px = patches_px.compress(seen, axis=2)
    return covered_pixels(patches_px, width=camera.width, height=camera.height)


def draw_closed(corners: Floats, exposure: Exposure, *, solid: bool = False) -> Raster:
    """The pixels in V of patches, (3, 4, N) float64, m, world frame, `without_slits`."""
    covered, corner = draw(corners, exposure)
    return exposure.crop(without_slits(covered, solid=solid), corner - 1)


def covered_pixels(patches_px: Floats, *, width: int, height: int) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """The pixels whose centre lies in any of many convex patches, in one pass over all edges.

    Args:
        patches_px: (2, 4, N) float64, px, u and v of the corners in order, finite.
        width: of the image, px.
        height: of the image, px.

    Returns:
        covered: (rows, columns) bool, of a window that may reach a few pixels beyond the image.
        corner: (2,) int64, (u, v) of the window's first pixel.
    """
    from bench.reference.loops import count_patches  # loads a compiler, which only these kinds of regions need

    if not patches_px.shape[2]:
        return np.zeros((0, 0), dtype=bool), np.zeros(2, dtype=np.int64)
    beyond = np.array([width, height]) + MARGIN_PX
    low = np.clip(np.floor(patches_px.min(axis=(1, 2))), -MARGIN_PX, beyond).astype(np.int64)
    high = np.clip(np.ceil(patches_px.max(axis=(1, 2))) + 1, -MARGIN_PX, beyond).astype(np.int64)
    columns, rows = (high - low).tolist()
    counts = np.zeros((rows, columns + 1), dtype=np.int32)
    u, v = np.subtract(patches_px, low[:, None, None], order="C")
    count_patches(u, v, counts)
    return counts[:, :columns] != 0, low


def without_slits(covered: NDArray[np.bool_], *, solid: bool = False) -> NDArray[np.bool_]:
    """Close what is a pixel wide.

    Args:
        covered: (rows, columns) bool.
        solid: close holes, for bodies that cannot be looked through, whose windows and dark paint send nothing back;
            else they stay open.

    Returns:
        (rows + 2, columns + 2) bool, a pixel more on every side.
    """
    padded = cv2.copyMakeBorder(covered.view(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, SLIT)
    if solid:
        outlines, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        cv2.drawContours(closed, outlines, -1, 1, cv2.FILLED)
    return np.asarray(closed > 0)
