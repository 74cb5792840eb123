"""Maps of found objects: around the vehicle (the paper's second result), in the image, and by how much is covered."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.evaluation.counts import Regions, count_by_cell
from bench.evaluation.definitions import coverage, detected
from bench.evaluation.protocol import Protocol
from bench.evaluation.rows import EVALUATED, Rows, read_parts
from bench.records.reference import Direction

COLUMNS = ("object_class", "direction", "x_m", "y_m", "tp", "fn")


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


def range_maps(objects: Rows, *, protocol: Protocol, level: float = 0.0) -> RangeMaps:
    """Count the evaluated object-frames by class, direction and place, a few recordings in memory at a time.

    Args:
        objects: of `OBJECTS_SCHEMA`, rows in any order, in memory or stored.
        protocol: that the run was made with. The grid reaches as far as its range limit or the furthest centroid.
        level: coverage from which on an object counts as detected; 0 for any pixel.
    """
    cell_m = protocol.range_map.cell_m
    key = ["object_class", "direction", "x", "y"]  # cells half-open, [a, b), counted from the vehicle's origin
    parts = []
    for rows in _evaluated(objects, COLUMNS):
        found = detected(rows) & (coverage(rows) >= level)
        x, y = (np.floor(rows[name] / cell_m) for name in ("x_m", "y_m"))
        placed = rows.assign(x=x, y=y, object_frames=1, detected=found)[[*key, "object_frames", "detected"]]
        parts.append(placed.groupby(key, dropna=False).sum())
    counted = pd.concat(parts).groupby(key, dropna=False).sum().astype(np.int64).reset_index()
    reached = abs(counted[["x", "y"]].to_numpy() + 0.5) + 0.5  # cells from the origin; NaN for masks, which tell none
    half = max(math.ceil(protocol.reference.range_limit_m / cell_m), int(np.fmax.reduce(reached.ravel(), initial=0.0)))
    maps = tuple(
        _range_map(counted, name, direction, half=half, protocol=protocol)
        for name in protocol.reference.classes
        for direction in Direction
    )
    placed_rows = sum(int(one.object_frames.sum()) for one in maps)
    unplaced = counted["direction"].isna()
    assert placed_rows == counted["object_frames"][~unplaced].sum(), "every place lies on the grid"
    return RangeMaps(maps=maps, unplaced=int(counted["object_frames"][unplaced].sum()))


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


def _evaluated(objects: Rows, columns: Sequence[str]) -> Iterator[pd.DataFrame]:
    for rows in read_parts(objects, ["status", *columns]):
        yield rows[rows["status"] == EVALUATED]


STEPS = 1000  # finer than any picture
THRESHOLDS: NDArray[np.float64] = np.arange(STEPS + 1) / STEPS
THRESHOLDS.setflags(write=False)
CURVE_COLUMNS = ("category", "tp", "fn", "chance_tp")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoverageCurve:
    """Object-frames by how much of them is covered.

    Attributes:
        at_least: (STEPS + 1,) int64, those covered by at least `THRESHOLDS`; the first counts any pixel, the paper's
            rule.
        object_frames: all of them.
    """

    at_least: NDArray[np.int64]
    object_frames: int

    @property
    def rate(self) -> NDArray[np.float64]:
        """(STEPS + 1,) float64, share of the object-frames; NaN without any."""
        return self.at_least / self.object_frames if self.object_frames else np.full(STEPS + 1, np.nan)


def coverage_curves(objects: Rows, *, protocol: Protocol) -> dict[str, tuple[CoverageCurve, CoverageCurve]]:
    """The curve of each category and that of chance, a few recordings in memory at a time.

    Args:
        objects: of `OBJECTS_SCHEMA`, rows in any order, in memory or stored.
        protocol: that the run was made with.

    Returns:
        By category: the curve of its evaluated object-frames, and that against the masks of other frames, over the
        object-frames that have one.
    """
    curves = {str(name): (_nothing(), _nothing()) for name in protocol.reference.categories}
    for rows in _evaluated(objects, CURVE_COLUMNS):
        for name, (found, by_chance) in curves.items():
            of_kind = rows[rows["category"] == name]
            chance = of_kind[of_kind["chance_tp"].notna()]
            curves[name] = (
                _add(found, coverage(of_kind)),
                _add(by_chance, chance["chance_tp"] / (chance["tp"] + chance["fn"])),
            )
    return curves


def _nothing() -> CoverageCurve:
    return CoverageCurve(at_least=np.zeros(STEPS + 1, dtype=np.int64), object_frames=0)


def _add(curve: CoverageCurve, covered: pd.Series[float]) -> CoverageCurve:
    reached = np.searchsorted(THRESHOLDS, covered, side="right")  # thresholds that are not above it
    from_above = np.cumsum(np.bincount(reached, minlength=STEPS + 2)[::-1])[::-1]
    at_least = from_above[1:].astype(np.int64)
    at_least[0] = np.count_nonzero(covered > 0)
    return CoverageCurve(
        at_least=curve.at_least + at_least,
        object_frames=curve.object_frames + len(covered),
    )


CELL_PX = 8

Grid = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImageMap:
    """Sums over the scored images of one camera and size, on square cells that tile the image from its first pixel.

    Attributes:
        camera: name.
        width: of the images, px.
        height: of the images, px.
        cell_px: side of a cell, px.
        frames: images summed.
        reference_px: (rows, columns) int64, pixels of all G.
        missed_px: (rows, columns) int64, pixels of all G minus D.
        false_px: (rows, columns) int64, pixels of D minus (all G u I).
    """

    camera: str
    width: int
    height: int
    cell_px: int
    frames: int
    reference_px: Grid
    missed_px: Grid
    false_px: Grid

    @classmethod
    def of(cls, regions: Regions, *, camera: str) -> ImageMap:
        """Count one image."""
        height, width = regions.moving.shape
        return cls(
            camera=camera,
            width=width,
            height=height,
            cell_px=CELL_PX,
            frames=1,
            reference_px=count_by_cell(regions.moving, CELL_PX),
            missed_px=count_by_cell(regions.moving & ~regions.true, CELL_PX),
            false_px=count_by_cell(regions.false, CELL_PX),
        )

    def __add__(self, other: ImageMap) -> ImageMap:
        """The sums over the images of both, which are of the same camera, size and cell."""
        return replace(
            self,
            frames=self.frames + other.frames,
            reference_px=self.reference_px + other.reference_px,
            missed_px=self.missed_px + other.missed_px,
            false_px=self.false_px + other.false_px,
        )

    @property
    def missed_rate(self) -> NDArray[np.float64]:
        """(rows, columns) float64, share of the reference's pixels that were missed; NaN where there never were any."""
        seen = self.reference_px > 0
        return np.where(seen, self.missed_px / np.where(seen, self.reference_px, 1), np.nan)

    @property
    def false_rate(self) -> NDArray[np.float64]:
        """(rows, columns) float64, mean share of the cell that was false; NaN without images."""
        area_px = count_by_cell(np.ones((self.height, self.width), dtype=bool), self.cell_px)
        return self.false_px / (area_px * self.frames) if self.frames else np.full(area_px.shape, np.nan)


def add_image_maps(maps: Iterable[ImageMap]) -> tuple[ImageMap, ...]:
    """Add those of the same camera, size and cell; the order in which they come does not matter.

    Returns:
        One per camera, size and cell, in that order.
    """
    sums: dict[tuple[str, int, int, int], ImageMap] = {}
    for item in maps:
        key = (item.camera, item.width, item.height, item.cell_px)
        sums[key] = sums[key] + item if key in sums else item
    return tuple(sums[key] for key in sorted(sums))
