"""Clusters of returns that may be one moving object each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from bench.annotation.prepared import Cloud
from bench.annotation.settings import ProposalSettings

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
UPRIGHT = np.array([1.0, 1.0, 0.6])  # beams lie further apart in height than along the scan
ANGLES_RAD = np.radians(np.arange(0, 90, 2))
AHEAD, LEFT = np.stack([np.cos(ANGLES_RAD), np.sin(ANGLES_RAD)]), np.stack([-np.sin(ANGLES_RAD), np.cos(ANGLES_RAD)])
MOST_POINTS = 500  # that are looked at
STRAY = 0.01  # share of the returns that may lie outside at each side
LEAST_SEEDS, LEAST_SEED_SHARE = 3, 0.3  # of a cluster that was cut out of a larger component


def find_clusters(cloud: Cloud, settings: ProposalSettings) -> list[Rows]:
    """Rows of the points of each cluster.

    A component of which enough was seen through, and that fits an object, is one; of others (somebody who leans on a
    wall) what was seen through, without what other sweeps only met. In between both may be: who walks along a parked
    vehicle, or a long vehicle that is so slow that most of it covers itself in other sweeps.
    """
    through, met = cloud.seen_through, cloud.met
    seed = (through >= settings.least_through) & (through >= settings.through_share * (through + met))
    fixed = (met >= settings.least_through) & (through == 0)
    movable = ~fixed & ((through > 0) | (met < settings.least_through))
    found = []
    for rows in _components(cloud.points, seed, settings.neighbour_m):
        seeds = np.count_nonzero(seed[rows])
        if seeds < LEAST_SEEDS:
            continue
        whole = _fits(cloud.points[rows], settings)
        if whole and seeds >= settings.slow_share * len(rows):
            found.append(rows)
        if whole and seeds >= settings.seed_share * len(rows):
            continue
        for part in _components(cloud.points[rows[movable[rows]]], None, settings.neighbour_m):
            inner = rows[movable[rows]][part]
            seeds = np.count_nonzero(seed[inner])
            if seeds >= max(LEAST_SEEDS, LEAST_SEED_SHARE * len(inner)) and _fits(cloud.points[inner], settings):
                found.append(inner)
    return found


def extent(points: Floats) -> tuple[float, float]:
    """Length and width, m, of the smallest rectangle around points (N, 2 or more), seen from above.

    A few stray returns, as at edges and in mirrors, lie outside.
    """
    xy = points[:: -(-len(points) // MOST_POINTS), :2]
    (low, high), (right, left) = (ends_without_stray(xy @ axes) for axes in (AHEAD, LEFT))
    along, across = high - low, left - right
    best = int(np.argmin(along * across + 0.2 * (along + across)))
    return float(max(along[best], across[best])), float(min(along[best], across[best]))


def ends_without_stray(places_m: Floats) -> Floats:
    """(2, ...) float64, m, lowest and highest of places (N, ...), but for a few stray ones."""
    ends = [int(STRAY * len(places_m)), len(places_m) - 1 - int(STRAY * len(places_m))]
    return np.asarray(np.partition(places_m, ends, axis=0)[ends])


def _fits(points: Floats, settings: ProposalSettings) -> bool:
    length, width = extent(points)
    return length <= settings.longest_m and width <= settings.widest_m


def _components(points: Floats, seed: NDArray[np.bool_] | None, neighbour_m: float) -> Iterator[Rows]:
    """Rows of each set of points that are connected by neighbours; with `seed` of those that hold one."""
    if seed is not None:  # most of a street is far from what moved
        near = np.flatnonzero(_near_seeds(points, seed, neighbour_m))
        yield from (near[rows] for rows in _components(points[near], None, neighbour_m) if seed[near[rows]].any())
        return
    if not len(points):
        return
    pairs = KDTree(points * UPRIGHT).query_pairs(neighbour_m, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), dtype=bool), tuple(pairs.T)), shape=(len(points), len(points)))
    labels = connected_components(graph, directed=False)[1]
    order = np.argsort(labels, kind="stable")
    yield from np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)


def _near_seeds(points: Floats, seed: NDArray[np.bool_], neighbour_m: float) -> NDArray[np.bool_]:
    """(N,) bool, points that may be connected to a seed: those of the same patch of cells, seen from above."""
    if not seed.any():
        return seed
    cells = np.floor(points[:, :2] / neighbour_m).astype(np.int64)
    cells -= cells.min(axis=0)
    filled = np.zeros(cells.max(axis=0) + 1, dtype=bool)
    filled[tuple(cells.T)] = True
    patches = ndimage.label(filled, structure=np.ones((3, 3)))[0][tuple(cells.T)]
    return np.asarray(np.isin(patches, np.unique(patches[seed])))
