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
from enum import Enum
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.reference.exposure import Exposure
from bench.reference.grid import DOWN, LEFT, RIGHT, UP, Grid

SLIT = np.ones((3, 3), dtype=np.uint8)  # closes what is a pixel wide: finer than a beam
MARGIN_PX = 4  # beyond the image, so that its border does not cut the outline
TALL, WIDE = [UP, UP, DOWN, DOWN], [LEFT, RIGHT, RIGHT, LEFT]  # sides that meet at each corner
OPPOSITE, NEXT_CORNER = [RIGHT, LEFT, DOWN, UP], [1, 2, 3, 0]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bounds:
    """What the clearance and the lidar's vertical field cut off, to be given back as far as the annotated shape goes.

    Patches that end within the clearance above the ground stand on it: shoes and tyres. Below the lowest beam and above
    the highest the lidar is blind, there the column goes on to the end of the annotated shape. Nothing else is added:
    under a bumper the lidar saw the road.

    Attributes:
        at_lowest_beam: (N,) bool, returns of the lowest beam.
        at_highest_beam: (N,) bool, returns of the highest beam.
        bottom_m: height of the annotated shape's lowest point, world frame.
        top_m: of its highest.
        clearance_m: returns lower than this above the bottom were taken for the ground's.
    """

    at_lowest_beam: NDArray[np.bool_]
    at_highest_beam: NDArray[np.bool_]
    bottom_m: float
    top_m: float
    clearance_m: float

    def of(self, rows: NDArray[np.intp]) -> Bounds:
        """The same for some of the returns."""
        return Bounds(
            at_lowest_beam=self.at_lowest_beam[rows],
            at_highest_beam=self.at_highest_beam[rows],
            bottom_m=self.bottom_m,
            top_m=self.top_m,
            clearance_m=self.clearance_m,
        )

    def extend(self, corners_world: NDArray[np.float64]) -> NDArray[np.float64]:
        """Patches, (3, 4, N) float64, m, that reach as far."""
        reached = corners_world.copy()
        upper, lower = reached[2, :2], reached[2, 2:]
        grounded = self.at_lowest_beam | (lower < self.bottom_m + self.clearance_m)
        np.minimum(lower, self.bottom_m, out=lower, where=grounded)
        np.maximum(upper, self.top_m, out=upper, where=np.broadcast_to(self.at_highest_beam, upper.shape))
        return reached


class Extent(Enum):
    """Pixels of an object by what its returns leave open."""

    LIKELY = "likely"  # free ends half-way to where the next beam would be: the region
    LEAST = "least"  # free ends drawn in by one standard deviation
    MOST = "most"  # what free ends gain that are drawn out by one
    CERTAIN = "certain"  # only between returns that leave no doubt
    SHADOW = "shadow"  # of the annotated shape, what lies behind the returns


class Layer(NamedTuple):
    """Patches that are part of the same extents.

    Attributes:
        corners: (3, 4, K) float64, m, world frame: left above, right above, right below, left below.
        extents: these.
    """

    corners: NDArray[np.float64]
    extents: tuple[Extent, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Patches:
    """The patch of each return.

    Attributes:
        points: (3, N) float64, m, world frame, the returns at exposure.
        reach: (3, 4, N) float64, m, from each return to where its patch ends on each side: at the neighbour, else
            half-way to where the next beam would be.
        step: (3, 4, N) float64, m, to where the next beam would be.
        corners: (3, 4, N) float64, m, world frame, as of `Layer`.
        grid: neighbours of the returns.
        bounds: None to give nothing back.
    """

    points: NDArray[np.float64]
    reach: NDArray[np.float64]
    step: NDArray[np.float64]
    corners: NDArray[np.float64]
    grid: Grid
    bounds: Bounds | None

    def layers(self, error_m: NDArray[np.float64], *, solid: bool) -> list[Layer]:
        """The layers of all extents.

        Args:
            error_m: (N,) float64, as for `end_spread`.
            solid: leaves no doubt between returns, so that nothing is drawn of what is certain.
        """
        linked = self.grid.linked.all(axis=0)
        free, plain = np.flatnonzero(~linked), linked
        layers = []
        if not solid:
            certain = self._certain_corners()
            plain = self.grid.certain.all(axis=0) & (certain == self.corners).all(axis=(0, 1))
            layers.append(Layer(certain[..., ~plain], (Extent.CERTAIN,)))
        spread = end_spread(self.grid.step_m[:, free], error_m[free]).repeat(2, axis=0)
        drawn = np.where(self.grid.linked[:, free], 0.0, self.step[..., free] * spread)
        bounds = self.bounds and self.bounds.of(free)
        least, most = (
            _corners(self.points[:, free], self.reach[..., free] + change, bounds) for change in (-drawn, drawn)
        )
        moved = (most != self.corners[..., free]).any(axis=(0, 1))
        everywhere = (Extent.LIKELY, Extent.LEAST) if solid else (Extent.LIKELY, Extent.LEAST, Extent.CERTAIN)
        return [
            *layers,
            Layer(self.corners[..., plain], everywhere),
            Layer(self.corners[..., linked & ~plain], (Extent.LIKELY, Extent.LEAST)),
            Layer(self.corners[..., free], (Extent.LIKELY,)),
            Layer(least, (Extent.LEAST,)),
            Layer(most[..., moved], (Extent.MOST,)),
        ]

    def _certain_corners(self) -> NDArray[np.float64]:
        """Only between neighbours that leave no doubt, and not beyond a return without such a neighbour on its other
        side, since of a thing as thin as a beam nobody knows how thin it is; nothing is given back."""
        certain = self.grid.certain
        return _corners(self.points, np.where(certain, self.reach, self.step * 0.5 * certain[OPPOSITE]), None)


def surface_patches(
    points_world: NDArray[np.float64],
    *,
    world_from_sensor: NDArray[np.float64],
    grid: Grid,
    bounds: Bounds | None = None,
) -> Patches:
    """The patch of each return.

    Towards a neighbour the patch reaches along the surface to the neighbour itself, so that patches overlap and leave
    no slits when seen from the camera. Where there is none it ends half-way to where the next beam would be.

    Args:
        points_world: (N, 3) float64, m, the returns at exposure.
        world_from_sensor: (3, 3) float64, from sensor axes to those of `points_world`.
        grid: neighbours of the same returns.
        bounds: of the object.
    """
    points = np.ascontiguousarray(points_world.T)
    left, above = np.moveaxis((world_from_sensor @ grid.step_sensor.reshape(3, -1)).reshape(3, 2, -1), 1, 0)
    step = np.stack([left, -left, above, -above], axis=1)
    reach = np.where(grid.linked, points[:, grid.neighbours] - points[:, None], step * 0.5)
    corners = _corners(points, reach, bounds)
    return Patches(points=points, reach=reach, step=step, corners=corners, grid=grid, bounds=bounds)


def _corners(points: NDArray[np.float64], reach: NDArray[np.float64], bounds: Bounds | None) -> NDArray[np.float64]:
    corners = reach[:, TALL] + reach[:, WIDE] + points[:, None]
    return corners if bounds is None else bounds.extend(corners)


def end_spread(step_m: NDArray[np.float64], error_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far a patch without a neighbour may end from half-way to the next beam, as one standard deviation.

    The outline lies anywhere between the outermost return and the next beam, which missed: uniform over a step, half a
    step on average, with a standard deviation of step / sqrt(12). Together with an error that has other causes it is
    sqrt(error^2 + step^2 / 12); what of this exceeds the error moves the end, along the beams' own rows and columns.

    Args:
        step_m: (2, N) float64, m, to the next column and row.
        error_m: (N,) float64, m, standard deviation of the outline for all other causes, in every direction.

    Returns:
        (2, N) float64, in steps, 0 to 0.29.
    """
    return np.asarray((np.sqrt(error_m**2 + step_m**2 / 12) - error_m) / step_m)


def count_patches(
    patches_px: NDArray[np.float64], layer: NDArray[np.intp], *, layers: int, width: int, height: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """How many of many convex patches hold each pixel's centre, in one pass over all edges.

    Every edge adds one to the pixels right of it where it runs down and subtracts one where it runs up, with all
    patches oriented the same way.

    Args:
        patches_px: (2, 4, N) float64, px, u and v of the corners in order, finite.
        layer: (N,) intp, which layer each belongs to.
        layers: number of these.
        width: of the image, px.
        height: of the image, px.

    Returns:
        counts: (layers, rows, columns) float64, whole numbers, of a window that may reach a few pixels beyond the
            image.
        corner: (2,) int64, (u, v) of the window's first pixel.
    """
    if not patches_px.shape[2]:
        return np.zeros((layers, 0, 0)), np.zeros(2, dtype=np.int64)
    beyond = np.array([width, height]) + MARGIN_PX
    low = np.clip(np.floor(patches_px.min(axis=(1, 2))), -MARGIN_PX, beyond).astype(np.int64)
    high = np.clip(np.ceil(patches_px.max(axis=(1, 2))) + 1, -MARGIN_PX, beyond).astype(np.int64)
    columns, rows = (high - low).tolist()
    u, v = patches_px - low[:, None, None]
    orientation = np.sign((u[2] - u[0]) * (v[3] - v[1]) - (v[2] - v[0]) * (u[3] - u[1]))
    first = np.clip(np.ceil(v), 0, rows).astype(np.int64)  # row of pixels at or below each corner
    start, patch = np.nonzero(first != first[NEXT_CORNER])  # edges that cross the centres of a row
    end = np.array(NEXT_CORNER)[start]
    start_u, start_v, end_u, end_v = u[start, patch], v[start, patch], u[end, patch], v[end, patch]
    start_row, end_row = first[start, patch], first[end, patch]
    count = np.abs(end_row - start_row)
    edge = np.repeat(np.arange(len(count)), count)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count - np.minimum(start_row, end_row), count)
    slope = (end_u - start_u) / (end_v - start_v)
    crossing_u = (start_u - start_v * slope)[edge] + row * slope[edge]
    column = np.clip(np.ceil(crossing_u), 0, columns).astype(np.int64)
    signs = np.where(end_row > start_row, orientation[patch], -orientation[patch])
    at = (row + (layer[patch] * rows)[edge]) * (columns + 1) + column
    changes = np.bincount(at, weights=signs[edge], minlength=layers * rows * (columns + 1))
    return np.asarray(np.cumsum(changes.reshape(layers, rows, columns + 1), axis=2)[..., :columns], np.float64), low


def draw_layers(
    layers: Sequence[Layer], exposure: Exposure
) -> tuple[dict[Extent, NDArray[np.bool_]], NDArray[np.int64]]:
    """The pixels of each extent, all in one window; of the patches that the lens can see whole.

    Returns:
        covered: (rows, columns) bool each.
        corner: (2,) int64, (u, v) of the window's first pixel, which may lie outside the image.
    """
    camera, corners = exposure.camera.model, np.concatenate([layer.corners for layer in layers], axis=2)
    number = np.repeat(np.arange(len(layers)), [layer.corners.shape[2] for layer in layers])
    patches_px = exposure.project(corners.reshape(3, -1).T).T.reshape(2, 4, -1)
    seen = np.isfinite(patches_px[0]).all(axis=0)
    counts, corner = count_patches(
        patches_px[..., seen], number[seen], layers=len(layers), width=camera.width, height=camera.height
    )
    members = {extent: [i for i, layer in enumerate(layers) if extent in layer.extents] for extent in Extent}
    return {extent: np.add.reduce([counts[i] for i in rows]) != 0 for extent, rows in members.items() if rows}, corner


def without_slits(covered: NDArray[np.bool_], *, solid: bool = False) -> NDArray[np.bool_]:
    """Close what is a pixel wide.

    Args:
        covered: (rows, columns) bool.
        solid: close holes, for bodies that cannot be looked through, whose windows and dark paint send nothing back;
            else they stay open.

    Returns:
        (rows + 2, columns + 2) bool, a pixel more on every side.
    """
    closed = cv2.morphologyEx(np.pad(covered, 1).view(np.uint8), cv2.MORPH_CLOSE, SLIT)
    if solid:
        outlines, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        cv2.drawContours(closed, outlines, -1, 1, cv2.FILLED)
    return np.asarray(closed > 0)
