"""The piece of surface that each lidar return stands for, and the pixels of their union.

A hull of points ends at the outermost returns, which lie half a beam spacing inside the true outline on average, and
bridges whatever gaps its tightness allows. But a beam answers for the solid angle half-way to its neighbours. The union
of these patches estimates the silhouette without that bias and at the sensor's own resolution: legs stay apart, and a
wheel stays open where the lidar saw through it.

Patches are drawn all in one pass, in layers, which together give the surface as it most likely is and as it is at
least and at most. Most patches lie between neighbours on all sides, are part of all of these, and are drawn once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.geometry.raster import Raster
from bench.reference.exposure import Exposure
from bench.reference.grid import DOWN, LEFT, RIGHT, UP, Grid

Floats = NDArray[np.float64]

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

    def take(self, rows: NDArray[np.intp]) -> CutOff:
        """Of some of the returns."""
        return CutOff(self.grounded_m[rows], self.bottom_m, self.top_m[rows])

    def restored(self, corners_world: Floats) -> Floats:
        """Patches, (3, 4, N) float64, m, that reach as far."""
        reached = corners_world.copy()
        upper, lower = reached[2, :2], reached[2, 2:]
        np.minimum(lower, self.bottom_m, out=lower, where=lower < self.grounded_m)
        np.maximum(upper, self.top_m, out=upper)
        return reached


class Layer(IntEnum):
    """Patches that are part of the same extents."""

    SHARED = 0  # of all
    DOUBTFUL = 1  # between neighbours on all sides, not all of which leave no doubt
    FREE = 2  # with a free end, half-way to where the next beam would be
    DRAWN_IN = 3  # the same with free ends drawn in by one standard deviation
    DRAWN_OUT = 4  # and drawn out
    CERTAIN = 5  # of what is not shared, the part between returns that leave no doubt


# The extents of an object's surface, as unions of layers.
LIKELY = (Layer.SHARED, Layer.DOUBTFUL, Layer.FREE)
LEAST = (Layer.SHARED, Layer.DOUBTFUL, Layer.DRAWN_IN)
CERTAIN = (Layer.SHARED, Layer.CERTAIN)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Patches:
    """The patch of each return.

    Attributes:
        points: (3, N) float64, m, world frame, the returns at exposure.
        reach: (3, 4, N) float64, m, from each return to where its patch ends on each side: at the neighbour, else
            half-way to where the next beam would be.
        step: (3, 4, N) float64, m, to where the next beam would be.
        corners: (3, 4, N) float64, m, world frame: left above, right above, right below, left below.
        restored: (N,) bool, to which something is given back.
        grid: neighbours of the returns.
        cut_off: what is given back.
    """

    points: Floats
    reach: Floats
    step: Floats
    corners: Floats
    restored: NDArray[np.bool_]
    grid: Grid
    cut_off: CutOff

    def layers(self, error_m: Floats, *, solid: bool) -> tuple[Floats, NDArray[np.intp]]:
        """The patches of all extents.

        Args:
            error_m: (N,) float64, as for `end_spread`.
            solid: leaves no doubt between returns; what is certain is of no interest.

        Returns:
            corners: (3, 4, K) float64, m, as of `corners`, which come first.
            layer: (K,) intp, `Layer` of each.
        """
        linked = self.grid.linked.all(axis=0)
        free = np.flatnonzero(~linked)
        layer = np.where(linked, Layer.SHARED, Layer.FREE)
        spread = end_spread(self.grid.step_m.take(free, axis=1), error_m[free]).repeat(2, axis=0)
        change = np.where(self.grid.linked.take(free, axis=1), 0.0, self.step.take(free, axis=2) * spread)
        points, reach, cut_off = self.points.take(free, axis=1), self.reach.take(free, axis=2), self.cut_off.take(free)
        drawn_in, drawn_out = (cut_off.restored(_corners(points, reach + sign * change)) for sign in (-1.0, 1.0))
        moved = (drawn_out != self.corners.take(free, axis=2)).any(axis=(0, 1))
        parts = {Layer.DRAWN_IN: drawn_in, Layer.DRAWN_OUT: drawn_out.compress(moved, axis=2)}
        if not solid:
            doubtful = ~self.grid.certain.all(axis=0) | self.restored
            layer[linked & doubtful] = Layer.DOUBTFUL
            parts[Layer.CERTAIN] = self._certain_corners(np.flatnonzero(doubtful))
        numbers = [np.full(corners.shape[2], number) for number, corners in parts.items()]
        return np.concatenate([self.corners, *parts.values()], axis=2), np.concatenate([layer, *numbers])

    def _certain_corners(self, rows: NDArray[np.intp]) -> Floats:
        """Only between neighbours that leave no doubt, and not beyond a return without such a neighbour on its other
        side, since of a thing as thin as a beam nobody knows how thin it is; nothing is given back."""
        certain = self.grid.certain.take(rows, axis=1)
        step, reach = self.step.take(rows, axis=2), self.reach.take(rows, axis=2)
        return _corners(self.points.take(rows, axis=1), np.where(certain, reach, step * 0.5 * certain[OPPOSITE]))


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
    plain = _corners(points, reach)
    corners = cut_off.restored(plain)
    restored = (corners[2] != plain[2]).any(axis=0)
    return Patches(
        points=points, reach=reach, step=step, corners=corners, restored=restored, grid=grid, cut_off=cut_off
    )


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


def draw(
    corners: Floats, exposure: Exposure, layer: NDArray[np.intp] | None = None
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """As `count_patches`, of patches, (3, 4, N) float64, m, world frame, that the lens can see whole.

    Args:
        corners: of the patches.
        exposure: of the image.
        layer: (N,) intp, `Layer` of each; None for a single one.
    """
    camera, layers = exposure.camera.model, 1 if layer is None else len(Layer)
    layer = np.zeros(corners.shape[2], dtype=np.intp) if layer is None else layer
    patches_px = np.ascontiguousarray(exposure.project(corners.reshape(3, -1).T).T).reshape(2, 4, -1)
    seen = np.isfinite(patches_px[0]).all(axis=0)
    if not seen.all():
        patches_px, layer = patches_px.compress(seen, axis=2), layer[seen]
    return count_patches(patches_px, layer, layers=layers, width=camera.width, height=camera.height)


def draw_closed(corners: Floats, exposure: Exposure) -> Raster:
    """The pixels in V of patches, (3, 4, N) float64, m, world frame, without slits."""
    counts, corner = draw(corners, exposure)
    return exposure.crop(without_slits(union(counts)), corner - 1)


def count_patches(
    patches_px: Floats, layer: NDArray[np.intp], *, layers: int, width: int, height: int
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Count the convex patches that hold each pixel's centre, in one pass over all edges.

    Args:
        patches_px: (2, 4, N) float64, px, u and v of the corners in order, finite.
        layer: (N,) intp, to which layer each belongs.
        layers: number of these.
        width: of the image, px.
        height: of the image, px.

    Returns:
        counts: (layers, rows, columns) int32, of a window that may reach a few pixels beyond the image.
        corner: (2,) int64, (u, v) of the window's first pixel.
    """
    from bench.reference.loops import count_layers  # loads a compiler, which only these kinds of regions need

    if not patches_px.shape[2]:
        return np.zeros((layers, 0, 0), dtype=np.int32), np.zeros(2, dtype=np.int64)
    beyond = np.array([width, height]) + MARGIN_PX
    low = np.clip(np.floor(patches_px.min(axis=(1, 2))), -MARGIN_PX, beyond).astype(np.int64)
    high = np.clip(np.ceil(patches_px.max(axis=(1, 2))) + 1, -MARGIN_PX, beyond).astype(np.int64)
    columns, rows = (high - low).tolist()
    counts = np.zeros((layers, rows, columns + 1), dtype=np.int32)
    u, v = np.subtract(patches_px, low[:, None, None], order="C")
    count_layers(u, v, layer, counts)
    return counts[..., :columns], low


def union(counts: NDArray[np.int32], layers: Sequence[int] = (0,)) -> NDArray[np.bool_]:
    """(rows, columns) bool, the pixels of some layers, from `count_patches`."""
    return np.asarray(sum(counts[layer] for layer in layers) != 0)


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
