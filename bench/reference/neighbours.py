"""Which returns of a cluster are neighbours on the lidar's grid of rows and columns.

The grid is found from the returns alone, as angles seen from the lidar, so that it works for data without rings or
times and for any number of beams.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

QUERIES = 256  # returns of a cluster, evenly chosen, that tell the step between columns
NEIGHBOURS = 8  # enough to meet the next column even where rows lie four times closer than columns
BRIDGED_STEPS = 2.5  # one missing return between two is a dropout, two are a gap in the object
SAME_ROW = 0.35  # of the step between columns: returns closer in elevation lie in one row
LOCAL = 100  # returns that tell the usual angle between rows at their elevation
ROW_KEY = 8.0  # larger than any difference of elevations, which makes (column, elevation) one sortable number


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """Neighbours of each return, and how far apart the lidar's samples are.

    Attributes:
        left, right, up, down: (N,) intp, row of the neighbour; -1 where there is none within 2.5 steps.
        column_step_rad: between columns, one for the cluster.
        row_step_rad: (N,) float64, between rows at each return; the cluster's median where it has no neighbour.
    """

    left: NDArray[np.intp]
    right: NDArray[np.intp]
    up: NDArray[np.intp]
    down: NDArray[np.intp]
    column_step_rad: float
    row_step_rad: NDArray[np.float64]


def find_grid(points_beams: NDArray[np.floating]) -> Grid | None:
    """Find the neighbours of each return.

    Args:
        points_beams: (N, 3), m, the beams' own axes at each point's own time.

    Returns:
        The grid; None where no two returns lie beside each other in a row, so that the step between columns is unknown.
    """
    if len(points_beams) < 2:
        return None
    azimuth, elevation = _directions(points_beams)
    column_step = _column_step(azimuth, elevation)
    if column_step <= 0:
        return None
    up, down, middle = _above_and_below(azimuth, elevation, column_step)
    lifts = [np.where(to >= 0, np.abs(elevation[to] - elevation), np.nan) for to in (up, down)]
    row_step = np.fmin(*lifts)
    return Grid(
        left=_beside(azimuth, elevation, column_step, 1, middle / 2),
        right=_beside(azimuth, elevation, column_step, -1, middle / 2),
        up=up,
        down=down,
        column_step_rad=column_step,
        row_step_rad=np.where(np.isfinite(row_step), np.minimum(row_step, 1.5 * middle), middle),
    )


def _directions(points_beams: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Azimuth about the cluster's own middle, so that none is cut in two behind the sensor, and elevation; rad."""
    x, y, z = points_beams.astype(np.float64).T
    azimuth = np.arctan2(y, x) - np.arctan2(y.mean(), x.mean())
    return (azimuth + np.pi) % (2 * np.pi) - np.pi, np.arctan2(z, np.hypot(x, y))


def _column_step(azimuth: NDArray[np.float64], elevation: NDArray[np.float64]) -> float:
    """Median angle to the next return of the same row, on one side so that noise does not make it too small."""
    directions = np.column_stack([azimuth * np.cos(elevation), elevation])
    tree = cKDTree(directions, balanced_tree=False, compact_nodes=False)
    asked = np.arange(0, len(directions), max(1, len(directions) // QUERIES))
    _, nearest = tree.query(directions[asked], k=min(NEIGHBOURS + 1, len(directions)))
    steps = azimuth[nearest] - azimuth[asked][:, None]
    lifts = np.abs(elevation[nearest] - elevation[asked][:, None])
    found = np.where((steps > 0) & (lifts < steps / 2), steps, np.inf).min(axis=1)
    found = found[np.isfinite(found)]
    return float(np.median(found)) if found.size else 0.0


def _above_and_below(
    azimuth: NDArray[np.float64], elevation: NDArray[np.float64], column_step: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Neighbours in the same column, and the usual angle between rows at each return."""
    column = np.floor(azimuth / (1.5 * column_step)) * ROW_KEY  # wide enough to hold a return of every row
    order = np.argsort(column + elevation, kind="stable")
    keys = (column + elevation)[order]
    found, lifts = [], []
    for place in (
        np.searchsorted(keys, column + elevation + SAME_ROW * column_step),
        np.searchsorted(keys, column + elevation - SAME_ROW * column_step) - 1,
    ):
        other = order[np.clip(place, 0, len(order) - 1)]
        lift = np.abs(elevation[other] - elevation)
        same_column = (column[other] == column) & (lift >= SAME_ROW * column_step)
        found.append(other)
        lifts.append(np.where(same_column, lift, np.inf))
    usual = _usual_by_elevation(elevation, np.minimum(*lifts), otherwise=column_step)
    up, down = (np.where(lift <= BRIDGED_STEPS * usual, other, -1) for other, lift in zip(found, lifts, strict=True))
    return up, down, usual


def _usual_by_elevation(
    elevation: NDArray[np.float64], lifts: NDArray[np.float64], *, otherwise: float
) -> NDArray[np.float64]:
    """Median angle between rows around each return's elevation: lidars have rows close together near the horizon and
    several times further apart below."""
    order = np.argsort(elevation, kind="stable")
    parts = np.array_split(order, max(1, len(order) // LOCAL))
    usual = np.full(len(elevation), otherwise)
    whole = lifts[np.isfinite(lifts)]
    for part in parts:
        near = lifts[part][np.isfinite(lifts[part])]
        if near.size or whole.size:
            usual[part] = np.median(near if near.size else whole)
    return usual


def _beside(
    azimuth: NDArray[np.float64],
    elevation: NDArray[np.float64],
    column_step: float,
    side: int,
    most_lift: NDArray[np.float64],
) -> NDArray[np.intp]:
    """The return of nearest elevation in the next column, else in the one after it; `side` 1 is left, -1 right."""
    key = np.floor(azimuth / column_step) * ROW_KEY + elevation
    order = np.argsort(key, kind="stable")
    found = np.full(len(azimuth), -1, dtype=np.intp)
    for columns in (2, 1):
        least = most_lift
        place = np.searchsorted(key[order], key + side * columns * ROW_KEY)
        for shift in (-1, 0):
            other = order[np.clip(place + shift, 0, len(order) - 1)]
            step, lift = (azimuth[other] - azimuth) * side, np.abs(elevation[other] - elevation)
            better = (step > column_step / 4) & (step <= BRIDGED_STEPS * column_step) & (lift < least)
            found, least = np.where(better, other, found), np.where(better, lift, least)
    return found
