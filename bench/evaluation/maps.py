"""Detection rate by place around the vehicle, the paper's second result."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from bench.evaluation.protocol import Protocol
from bench.reference.records import Direction


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RangeMap:
    """One class moving in one direction, on a square grid centred on the vehicle's origin.

    Attributes:
        object_class: of the objects.
        direction: of their motion relative to the host.
        edges_m: (K + 1,) float64, edges of the cells, the same along x and y, vehicle frame, m.
        object_frames: (K, K) int64, evaluated object-frames by their cluster's centroid; first index along x (forward),
            second along y (left).
        detected: (K, K) int64, those of them with any pixel detected.
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


def range_maps(objects: pa.Table, *, protocol: Protocol) -> RangeMaps:
    """Count the evaluated object-frames by class, direction and place.

    Args:
        objects: of `OBJECTS_SCHEMA`.
        protocol: that the run was made with. The grid reaches as far as its range limit or the furthest centroid.
    """
    rows = objects.to_pandas()
    evaluated = rows[rows["status"] == "evaluated"]
    edges_m = _edges_m(evaluated, protocol)
    kinds = [(name, direction) for name in protocol.reference.classes for direction in Direction]
    maps = tuple(_range_map(evaluated, name, direction, edges_m, protocol) for name, direction in kinds)
    placed = sum(int(found.object_frames.sum()) for found in maps)
    assert placed + int(evaluated["direction"].isna().sum()) == len(evaluated), "every place lies on the grid"
    return RangeMaps(maps=maps, unplaced=len(evaluated) - placed)


def _range_map(
    evaluated: pd.DataFrame, name: str, direction: Direction, edges_m: NDArray[np.float64], protocol: Protocol
) -> RangeMap:
    rows = evaluated[(evaluated["object_class"] == name) & (evaluated["direction"] == direction.value)]
    return RangeMap(
        object_class=name,
        direction=direction,
        edges_m=edges_m,
        object_frames=_count_by_cell(rows, edges_m),
        detected=_count_by_cell(rows[rows["tp"] > 0], edges_m),
        min_object_frames=protocol.range_map.min_object_frames,
    )


def _count_by_cell(rows: pd.DataFrame, edges_m: NDArray[np.float64]) -> NDArray[np.int64]:
    # Half-open cells [a, b), as the other bins; histogram2d would close the last one.
    along_x, along_y = (np.searchsorted(edges_m, rows[axis].to_numpy(), side="right") - 1 for axis in ("x_m", "y_m"))
    cells = len(edges_m) - 1
    return np.bincount(along_x * cells + along_y, minlength=cells * cells).reshape(cells, cells)


def _edges_m(evaluated: pd.DataFrame, protocol: Protocol) -> NDArray[np.float64]:
    cell_m = protocol.range_map.cell_m
    places_m = np.abs(evaluated[["x_m", "y_m"]].to_numpy(dtype=np.float64))
    furthest_m = float(places_m[np.isfinite(places_m)].max(initial=0.0))  # masks tell no place
    half = max(math.ceil(protocol.reference.range_limit_m / cell_m), math.floor(furthest_m / cell_m) + 1)
    return np.arange(-half, half + 1, dtype=np.float64) * cell_m
