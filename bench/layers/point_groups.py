"""Groups of points that no tool gave a number: by nearness within a sweep, and from sweep to sweep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from bench.lidar import open3d

NEIGHBOUR_M = 0.5  # points nearer than this belong together; people who walk abreast stay apart
FARTHEST_STEP_M = 3.0  # between sweeps, beyond what the motion so far foretells: 30 m/s at ten sweeps a second
LONGEST_GAP_NS = 600_000_000  # some annotate twice a second
SECOND_NS = 1_000_000_000


def near_groups(points: NDArray[np.floating]) -> NDArray[np.int64]:
    """Euclidean clustering: points that a chain of steps under half a metre joins are one group.

    Args:
        points: (N, 3), m.

    Returns:
        (N,) int64, number of the group of each point, from 0 on.
    """
    if not len(points):
        return np.empty(0, dtype=np.int64)
    library = open3d()
    cloud = library.geometry.PointCloud(library.utility.Vector3dVector(np.asarray(points, dtype=np.float64)))
    return np.asarray(cloud.cluster_dbscan(eps=NEIGHBOUR_M, min_points=1), dtype=np.int64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroupedSweep:
    """The groups of one sweep.

    Attributes:
        timestamp_ns: of the sweep.
        middles_m: (K, 3) float64, m, world frame, mean of the points of each group; NaN where unknown.
    """

    timestamp_ns: int
    middles_m: NDArray[np.float64]


def linked_groups(sweeps: Sequence[GroupedSweep]) -> tuple[tuple[int, ...], ...]:
    """Number the groups so that one object keeps its number from sweep to sweep.

    Groups are paired with where the objects so far should be, all at once with the smallest sum of distances; what is
    further than a step away is a new object.

    Args:
        sweeps: by increasing time.

    Returns:
        For each sweep the object of each of its groups, from 0 on.
    """
    followed: dict[int, _Followed] = {}
    count = 0
    numbers = []
    for sweep in sweeps:
        followed = {i: o for i, o in followed.items() if sweep.timestamp_ns - o.seen_ns <= LONGEST_GAP_NS}
        foretold = np.array([one.foretold(sweep.timestamp_ns) for one in followed.values()]).reshape(-1, 3)
        due, found = list(followed), dict(_pairs(sweep.middles_m, foretold))
        row = []
        for group, middle in enumerate(sweep.middles_m):
            if group in found:
                number = due[found[group]]
                followed[number] = followed[number].moved(middle, sweep.timestamp_ns)
            else:
                number, count = count, count + 1
                followed[number] = _Followed(seen_ns=sweep.timestamp_ns, place_m=middle, velocity_mps=np.zeros(3))
            row.append(number)
        numbers.append(tuple(row))
    return tuple(numbers)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Followed:
    """An object where it was last seen."""

    seen_ns: int
    place_m: NDArray[np.float64]
    velocity_mps: NDArray[np.float64]

    def foretold(self, timestamp_ns: int) -> NDArray[np.float64]:
        return np.asarray(self.place_m + self.velocity_mps * (timestamp_ns - self.seen_ns) / SECOND_NS)

    def moved(self, place_m: NDArray[np.float64], timestamp_ns: int) -> _Followed:
        velocity = (place_m - self.place_m) * SECOND_NS / (timestamp_ns - self.seen_ns)
        return _Followed(seen_ns=timestamp_ns, place_m=place_m, velocity_mps=velocity)


def _pairs(middles_m: NDArray[np.float64], foretold_m: NDArray[np.float64]) -> list[tuple[int, int]]:
    """(group, object) of all pairs within a step, with the smallest sum of distances."""
    away_m = np.nan_to_num(cdist(middles_m, foretold_m), nan=np.inf)
    # Pairs that are too far cost the same, so that they do not push near ones apart.
    rows, columns = linear_sum_assignment(np.minimum(away_m, FARTHEST_STEP_M))
    return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if away_m[r, c] < FARTHEST_STEP_M]
