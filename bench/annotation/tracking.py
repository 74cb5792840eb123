"""Clusters of returns that may be one moving object each, followed over the sweeps.

Tracks have a Kalman filter each, and there is one assignment a sweep.
A revolution takes a tenth of a second, so an object is seen at a time of its own: predictions are made for that time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import count

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from bench.annotation.prepared import Cloud
from bench.annotation.settings import ProposalSettings
from bench.times import SECOND_NS

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
UPRIGHT = np.array([1.0, 1.0, 0.6])  # beams lie further apart in height than along the scan
ANGLES_RAD = np.radians(np.arange(0, 90, 2))
AHEAD, LEFT = np.stack([np.cos(ANGLES_RAD), np.sin(ANGLES_RAD)]), np.stack([-np.sin(ANGLES_RAD), np.cos(ANGLES_RAD)])
MOST_POINTS = 500  # that are looked at
STRAY = 0.01  # share of the returns that may lie outside at each side
LEAST_SEEDS, LEAST_SEED_SHARE = 3, 0.3  # of a cluster that was cut out of a larger component
YOUNG = 3  # observations before which the velocity is hardly known
REFUSED = 1e3
START_VARIANCE = np.diag([0.1, 0.1, 100.0, 100.0])  # m2, m2/s2
MOST_SIZE_RATIO = 1.2  # logarithm


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """A cluster in a sweep.

    Attributes:
        cloud: of the sweep.
        rows: (N,) intp, its points.
    """

    cloud: Cloud
    rows: NDArray[np.intp]

    @property
    def points(self) -> Floats:
        """(N, 3) float64, m, as in the cloud."""
        return self.cloud.points[self.rows]

    @cached_property
    def centre(self) -> Floats:
        """(2,) float64, m, mean of its points."""
        return np.asarray(self.points[:, :2].mean(axis=0))

    @cached_property
    def offset_s(self) -> float:
        """Mean time of its points after the sweep's."""
        return float(self.cloud.offset_s[self.rows].mean())

    @cached_property
    def length_m(self) -> float:
        """Length of its points seen from above, m."""
        return extent(self.points)[0]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fragment:
    """Observations of one object, or of a part of one.

    Attributes:
        chain: equal for what the tracker followed without a break, over several segments.
        observations: in time, one a sweep.
        joined: fragments that were joined to this one.
        part: number of the person among people side by side, 0 for anybody alone.
    """

    chain: int
    observations: tuple[Observation, ...]
    joined: int = 0
    part: int = 0

    @property
    def name(self) -> tuple[int, int]:
        """Equal for one object over several segments."""
        return self.chain, self.part

    @property
    def points(self) -> int:
        """Number of points over all sweeps."""
        return sum(len(observation.rows) for observation in self.observations)

    def seen_through(self, least: int) -> float:
        """Share of its points that at least so many sweeps saw through, the mean over its sweeps."""
        return float(np.mean([(one.cloud.seen_through[one.rows] >= least).mean() for one in self.observations]))

    @property
    def numbers(self) -> list[int]:
        """Of the sweeps."""
        return [observation.cloud.number for observation in self.observations]


@dataclass(slots=True, kw_only=True, eq=False)
class _Live:
    """A track while it is followed: mean and covariance of place and velocity at the time of the last sweep."""

    chain: int
    mean: Floats
    covariance: Floats
    length_m: float
    seen: int = 1
    missed: int = 0
    observations: list[Observation] = field(default_factory=list)


class Tracker:
    """Takes clusters sweep by sweep and gives tracks back, a segment at a time.

    Args:
        settings: of the proposals.
    """

    def __init__(self, settings: ProposalSettings) -> None:
        self._settings = settings
        self._live: list[_Live] = []
        self._ended: list[_Live] = []
        self._time_ns: int | None = None
        self._chains = count()

    def add(self, cloud: Cloud, clusters: Sequence[NDArray[np.intp]]) -> None:
        """Assign the clusters of a sweep to tracks; the rest begin new ones."""
        seconds = 0.0 if self._time_ns is None else (cloud.timestamp_ns - self._time_ns) / SECOND_NS
        self._time_ns = cloud.timestamp_ns
        motion = np.eye(4)  # at constant velocity
        motion[0, 2] = motion[1, 3] = seconds
        gain = np.array([[seconds**2 / 2, 0.0], [0.0, seconds**2 / 2], [seconds, 0.0], [0.0, seconds]])
        noise = self._settings.acceleration_mps2**2 * gain @ gain.T
        for track in self._live:
            track.mean = motion @ track.mean
            track.covariance = motion @ track.covariance @ motion.T + noise
        seen = [Observation(cloud=cloud, rows=rows) for rows in clusters]
        assigned = self._assigned(seen)
        for number, track in enumerate(self._live):
            if number in assigned:
                _update(track, seen[assigned[number]])
            else:
                track.missed += 1
        for number, observation in enumerate(seen):
            if number not in assigned.values():
                begun = _Live(
                    chain=next(self._chains),
                    mean=np.concatenate([observation.centre, np.zeros(2)]),
                    covariance=START_VARIANCE,
                    length_m=observation.length_m,
                    observations=[observation],
                )
                self._live.append(begun)
        self._ended += [track for track in self._live if track.missed > self._settings.missed]
        self._live = [track for track in self._live if track.missed <= self._settings.missed]

    def take(self) -> list[Fragment]:
        """All tracks so far; those that go on do so without what is given back here."""
        given = [
            Fragment(chain=track.chain, observations=tuple(track.observations))
            for track in sorted([*self._ended, *self._live], key=lambda track: track.chain)
            if track.observations
        ]
        self._ended = []
        for track in self._live:
            track.observations = []
        return given

    def _assigned(self, seen: Sequence[Observation]) -> dict[int, int]:
        """Number of a live track -> number of the observation that goes on with it."""
        if not (seen and self._live):
            return {}
        costs = np.array([[_cost(track, observation) for observation in seen] for track in self._live])
        return {int(a): int(b) for a, b in zip(*linear_sum_assignment(costs), strict=True) if costs[a, b] < REFUSED}


def _cost(track: _Live, seen: Observation) -> float:
    """Distance as a share of what is allowed, and difference in size."""
    away_m = float(np.hypot(*(seen.centre - track.mean[:2] - seen.offset_s * track.mean[2:])))
    largest_m = max(track.length_m, seen.length_m)
    allowed_m = max(0.8, min(3.5, 0.9 * largest_m)) if track.seen < YOUNG else 0.7 + 0.25 * largest_m
    allowed_m += 0.3 * track.missed
    ratio = abs(float(np.log((track.length_m + 0.4) / (seen.length_m + 0.4))))
    return away_m / allowed_m + 0.5 * ratio if away_m < allowed_m and ratio < MOST_SIZE_RATIO else REFUSED


def _update(track: _Live, seen: Observation) -> None:
    measured = np.zeros((2, 4))
    measured[0, 0] = measured[1, 1] = 1.0
    measured[0, 2] = measured[1, 3] = seen.offset_s
    noise = np.eye(2) * (0.1 + 0.1 * seen.length_m) ** 2
    gain = track.covariance @ measured.T @ np.linalg.inv(measured @ track.covariance @ measured.T + noise)
    track.mean = track.mean + gain @ (seen.centre - measured @ track.mean)
    track.covariance = track.covariance - gain @ measured @ track.covariance
    track.length_m = seen.length_m
    track.seen += 1
    track.missed = 0
    track.observations.append(seen)
