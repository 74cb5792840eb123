"""Maps of found objects around the vehicle, the paper's second result."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.errors import DataError
from bench.evaluation.definitions import coverage, detected
from bench.evaluation.protocol import Protocol
from bench.records.reference import Direction

# The limit is the camera's distance from the nearest return: to the vehicle's origin, and to the middle of a long
# vehicle, it is further.
BEYOND_M = 25.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RangeMap:
    """One class moving in one direction, on a square grid centred on the vehicle's origin.

    Attributes:
        object_class: of the objects.
        direction: of their motion relative to the ego vehicle.
        edges_m: (K + 1,) float64, edges of the cells, the same along x and y, vehicle frame, m.
        object_frames: (K, K) int64, evaluated object-frames by their cluster's centroid; first index along x (forward),
            second along y (left).
        detected: (K, K) int64, those of them that are detected, by any pixel or by the coverage asked for.
        min_object_frames: cells with fewer say nothing.
    """

    object_class: str
    direction: Direction
    edges_m: NDArray[np.float64]
    object_frames: NDArray[np.int64]
    detected: NDArray[np.int64]
    min_object_frames: int

    @property
    def rate(self) -> NDArray[np.float64]:
        """(K, K) float64, detection rate; NaN in cells without object-frames."""
        seen = self.object_frames > 0
        return np.where(seen, self.detected / np.where(seen, self.object_frames, 1), np.nan)

    @property
    def enough(self) -> NDArray[np.bool_]:
        """(K, K) bool, cells with enough object-frames to be coloured."""
        return self.object_frames >= self.min_object_frames


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RangeMaps:
    """All maps of a run.

    Attributes:
        maps: by class, then direction (lateral, longitudinal), in the protocol's order of classes.
        unplaced: evaluated object-frames in none of the maps, as their direction is unknown.
    """

    maps: tuple[RangeMap, ...]
    unplaced: int


PLACED = ["object_class", "direction", "x_m", "y_m", "tp", "fn"]


def range_maps(objects: Iterable[pd.DataFrame], *, protocol: Protocol, level: float = 0.0) -> RangeMaps:
    """Count the evaluated object-frames by class, direction and place.

    Args:
        objects: evaluated rows of `OBJECTS_SCHEMA`, some at a time, at least the columns `PLACED`.
        protocol: that the run was made with. The grid reaches as far as its range limit or the furthest centroid.
        level: coverage from which on an object counts as detected; 0 for any pixel.

    Raises:
        DataError: an evaluated object far beyond the protocol's range.
    """
    cell_m = protocol.range_map.cell_m
    key = ["object_class", "direction", "x", "y"]  # cells half-open, [a, b), counted from the vehicle's origin
    parts = []
    for rows in objects:
        found = detected(rows) & (coverage(rows) >= level)
        x, y = (np.floor(rows[name] / cell_m) for name in ("x_m", "y_m"))
        placed = rows.assign(x=x, y=y, object_frames=1, detected=found)[[*key, "object_frames", "detected"]]
        parts.append(placed.groupby(key, dropna=False).sum())
    counted = pd.concat(parts).groupby(key, dropna=False).sum().astype(np.int64).reset_index()
    reached = abs(counted[["x", "y"]].to_numpy() + 0.5) + 0.5  # cells from the origin; NaN for masks, which tell none
    furthest_m = protocol.reference.range_limit_m + BEYOND_M
    if (reached > furthest_m / cell_m + 1).any():
        got = f"{cell_m * np.nanmax(reached):g} m from it"
        expected = f"centroids of evaluated objects within {furthest_m:g} m of the vehicle's origin"
        raise DataError("counts of the run", field="x_m, y_m", expected=expected, got=got)
    half = max(math.ceil(protocol.reference.range_limit_m / cell_m), int(np.fmax.reduce(reached.ravel(), initial=0.0)))
    maps = tuple(
        _range_map(counted, name, direction, half=half, protocol=protocol)
        for name in protocol.reference.classes
        for direction in Direction
    )
    return RangeMaps(maps=maps, unplaced=int(counted["object_frames"][counted["direction"].isna()].sum()))


def _range_map(
    counted: pd.DataFrame, object_class: str, direction: Direction, *, half: int, protocol: Protocol
) -> RangeMap:
    """The map of a class and a direction, `half` cells to each side."""
    own = counted[(counted["object_class"] == object_class) & (counted["direction"] == direction.value)]
    grids = np.zeros((2, 2 * half, 2 * half), dtype=np.int64)
    places = [own[axis].to_numpy(np.int64) + half for axis in ("x", "y")]
    grids[:, places[0], places[1]] = own[["object_frames", "detected"]].to_numpy().T
    return RangeMap(
        object_class=object_class,
        direction=direction,
        edges_m=np.arange(-half, half + 1, dtype=np.float64) * protocol.range_map.cell_m,
        object_frames=grids[0],
        detected=grids[1],
        min_object_frames=protocol.range_map.min_object_frames,
    )
