"""The beams of a lidar, from the returns of a sweep: the lowest and the highest, and neighbours on rows and columns.

Beams need not start in one point. Those of an HDL-64E come out of two blocks, 8 cm apart and up to 0.2 m above the
origin of its points: seen from there, its highest beam lies at 5.7 degrees at 3 m and at 2.3 degrees at 30 m. A beam is
a line of heights over range, from where it starts on the lidar's axis.

Neighbours among the returns of an object are found from their directions alone, which works for data without rings or
times and for any number of beams. The directions have to be those from the sensor: a data set that gives its points in
other axes has to state `Recording.lidar_from_sensor`. Beams that start in several places leave a gap between their rows
that is wider the nearer the object is. Nothing is missing there, unless another return lies in the gap: then a beam
went through.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bench.geometry import Floats

OFFSETS_M = np.arange(-25, 26) / 50  # where beams may start
NEAREST_M, FARTHEST_M = 1.0, 1000.0  # nearer returns are the housing's, or none at all; their directions are noise
BINS_PER_E = 100  # ranges a hundredth apart
STRAYS = 5  # returns beyond the last beam
SAME_BEAM_M = 0.01  # returns of one beam lie this close to its line
LEAST_RANGES = 10  # at which a beam has to meet something, or nothing tells where it starts
ENOUGH = 0.95  # of the most ranges: as good, since distances are rounded


class Beam(NamedTuple):
    """Heights of a beam over range, sensor frame.

    Attributes:
        offset_m: m, height of its start on the sensor's upright axis.
        slope: tangent of its elevation.
    """

    offset_m: float
    slope: float

    def heights_m(self, flat_m: Floats) -> Floats:
        """(N,) float64, m, of the beam at horizontal distances from the axis."""
        return self.offset_m + self.slope * flat_m


class Envelope(NamedTuple):
    """All that a lidar's beams reach.

    Attributes:
        lowest: beam.
        highest: beam that meets anything.
    """

    lowest: Beam
    highest: Beam

    @property
    def starts_apart_m(self) -> float:
        """How far apart beams start, m."""
        return abs(self.highest.offset_m - self.lowest.offset_m)

    def starts_m(self, points_sensor: Floats) -> Floats:
        """Heights at which the beams of returns start: between the lowest and the highest in proportion.

        Args:
            points_sensor: (N, 3) float64, m, sensor frame.

        Returns:
            (N,) float64, m; beyond the two beams that of the nearer one.
        """
        x, y, z = points_sensor.T
        flat_m = np.hypot(x, y)
        low_m, high_m = self.lowest.heights_m(flat_m), self.highest.heights_m(flat_m)
        share = np.clip((z - low_m) / np.maximum(high_m - low_m, 1e-9), 0.0, 1.0)
        return np.asarray(self.lowest.offset_m + share * (self.highest.offset_m - self.lowest.offset_m))


def find_envelope(points_sensor: NDArray[np.floating]) -> Envelope:
    """Find the lowest and the highest beam.

    For every height at which a beam may start, the last beam is that of the sixth return from the end, since up to five
    may be stray. The right height is that whose last beam has returns at the most different ranges. Of equally good
    heights, the highest beam takes the one nearest to the sensor's origin, the lowest the one nearest to half of the
    highest's. Where even the best beam has returns at too few ranges, it starts at the origin, or at that half.

    Args:
        points_sensor: (N, 3), m, a whole sweep, sensor frame; N >= 1.
    """
    x, y, z = points_sensor.T
    with np.errstate(over="ignore"):  # what float32 cannot hold is as good as infinite
        flat_m = np.maximum(np.sqrt(x * x + y * y), 1e-9)  # many times faster than `hypot`
    slopes, within = z / flat_m, (flat_m >= NEAREST_M) & (flat_m <= FARTHEST_M)
    if not within.any():
        return Envelope(lowest=Beam(0.0, float(slopes.min())), highest=Beam(0.0, float(slopes.max())))
    flat_m, slopes = flat_m[within], slopes[within]
    bins = (np.log(flat_m) * BINS_PER_E).astype(np.intp)
    highest = _last_beam(bins, flat_m, slopes, usual_m=0.0)
    below = _last_beam(bins, flat_m, -slopes, usual_m=-highest.offset_m / 2)
    return Envelope(lowest=Beam(-below.offset_m, -below.slope), highest=highest)


def _last_beam(
    bins: NDArray[np.intp], flat_m: NDArray[np.floating], slopes: NDArray[np.floating], *, usual_m: float
) -> Beam:
    """The highest beam of returns in bins of range; it usually starts at a height."""
    offsets_m = OFFSETS_M[np.argsort(np.abs(OFFSETS_M - usual_m), kind="stable")]
    last = np.full(bins.max() + 1, -np.inf, dtype=slopes.dtype)
    np.maximum.at(last, bins, slopes)
    rows = np.flatnonzero((last[bins] - slopes) * flat_m < SAME_BEAM_M)
    rows = rows[np.lexsort((-slopes[rows], bins[rows]))]
    first_of_bin = np.flatnonzero(np.diff(bins[rows], prepend=-1))
    rank = np.arange(len(rows)) - np.repeat(first_of_bin, np.diff(first_of_bin, append=len(rows)))
    rows = rows[rank <= STRAYS]  # more of one bin change nothing
    first_of_bin = np.flatnonzero(np.diff(bins[rows], prepend=-1))
    flat_m, slopes = flat_m[rows].astype(np.float64), slopes[rows].astype(np.float64)
    from_starts = slopes - offsets_m[:, None] / flat_m
    place = max(len(rows) - 1 - STRAYS, 0)
    beams = np.partition(from_starts, place, axis=1)[:, place]
    on_beam = np.abs(from_starts - beams[:, None]) * flat_m < SAME_BEAM_M
    ranges = np.logical_or.reduceat(on_beam, first_of_bin, axis=1).sum(axis=1)
    best = int(np.argmax(ranges >= ENOUGH * ranges.max())) if ranges.max() >= LEAST_RANGES else 0
    return Beam(float(offsets_m[best]), float(beams[best]))


QUERIES = 64  # returns of a cluster, evenly chosen, that tell the step between columns
NEIGHBOURS = 8  # enough to meet the next column even where rows lie four times closer than columns
BRIDGED_STEPS = 2.5  # one missing return between two is a dropout, two are a gap in the object
ADJACENT_STEPS = 1.5  # between these two no return is missing
SAME_ROW = 0.35  # of the step between columns: returns closer in elevation lie in one row
LOCAL = 100  # returns that tell the usual angle between rows at their elevation
DEEPEST_STEPS = BRIDGED_STEPS * np.tan(np.radians(80))  # as on a surface this oblique; further behind is another one
CERTAIN_STEPS = (BRIDGED_STEPS**2 - 1) ** 0.5  # a link as long as that over a missing return
ROW_KEY = 8.0  # larger than any difference of elevations, which makes (column, elevation) one sortable number
LEFT, RIGHT, UP, DOWN = range(4)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """Neighbours of each return, and how far apart the lidar's samples are.

    Attributes:
        neighbours: (4, N) intp, row of the neighbour to the left, to the right, above and below; -1 where there is none
            within 2.5 steps, and above and below within what lies between starts of beams if nothing was met there.
        linked: (4, N) bool, the neighbour lies on the same surface: no further behind or before than an oblique one.
        certain: (4, N) bool, no return is missing between the two, and they are as near as over one missing return;
            others may be two surfaces.
        column_step_rad: between columns, one for the cluster.
        row_step_rad: (N,) float64, between rows at each return; without a neighbour, the usual step at its elevation.
        step_sensor: (3, 2, N) float64, m, sensor axes, from each return to where the next beam to the left and the next
            above would meet a surface square to the beam; NaN on the lidar's axis.
    """

    neighbours: NDArray[np.intp]
    linked: NDArray[np.bool_]
    certain: NDArray[np.bool_]
    column_step_rad: float
    row_step_rad: Floats
    step_sensor: Floats

    @property
    def step_m(self) -> Floats:
        """Length of `step_sensor`, (2, N) float64, m."""
        return np.asarray(np.sqrt(np.square(self.step_sensor).sum(axis=0)))


def find_grid(
    points_sensor: NDArray[np.floating], *, starts_apart_m: float = 0.0, others_sensor: Floats | None = None
) -> Grid | None:
    """Find the neighbours of each return.

    Args:
        points_sensor: (N, 3), m, from where each beam starts, sensor axes at each point's own time.
        starts_apart_m: m, `Envelope.starts_apart_m`.
        others_sensor: (M, 3) float64, m, returns of the sweep from what else lies in these directions; None for none.

    Returns:
        The grid; None where no two returns lie beside each other in a row, so that the step between columns is unknown.
    """
    if len(points_sensor) < 2:
        return None
    middle = float(np.arctan2(points_sensor[:, 1].mean(), points_sensor[:, 0].mean()))
    azimuth, elevation = _directions(points_sensor, middle)
    column_step = _column_step(azimuth, elevation)
    if column_step <= 0:
        return None
    x, y, z = points_sensor.astype(np.float64).T
    flat_m = np.sqrt(x * x + y * y)
    ranges_m = np.sqrt(flat_m * flat_m + z * z)
    gap_rad = starts_apart_m / np.maximum(ranges_m, 1e-9)
    others = _directions(np.zeros((0, 3)) if others_sensor is None else others_sensor, middle)
    above_below, lifts, usual = _above_and_below(azimuth, elevation, column_step, gap_rad, others)
    beside, turns = _beside(azimuth, elevation, column_step, usual / 2)
    nearest = np.where(above_below >= 0, lifts, np.inf).min(axis=0)
    row_step = np.where(np.isfinite(nearest), np.minimum(nearest, 1.5 * usual), usual)
    neighbours, steps = np.concatenate([beside, above_below]), np.concatenate([turns / column_step, lifts / usual])
    depth_steps = np.abs(ranges_m[neighbours] - ranges_m)
    with np.errstate(invalid="ignore", divide="ignore"):  # on the lidar's axis: a step is NaN, nothing lies beside
        depth_steps[:2] /= flat_m * column_step
        depth_steps[2:] /= ranges_m * row_step
        slope = z / flat_m
        left, above = np.array([-y, x, np.zeros_like(x)]), np.array([-x * slope, -y * slope, flat_m])
    return Grid(
        neighbours=neighbours,
        linked=(neighbours >= 0) & (depth_steps <= DEEPEST_STEPS),
        certain=(neighbours >= 0) & (steps <= ADJACENT_STEPS) & (depth_steps <= CERTAIN_STEPS),
        column_step_rad=column_step,
        row_step_rad=row_step,
        step_sensor=np.stack([left * column_step, above * row_step], axis=1),
    )


def _directions(points_sensor: NDArray[np.floating], middle: float) -> tuple[Floats, Floats]:
    """Azimuth about the middle direction, so that no cluster is cut in two behind the sensor, and elevation; rad."""
    x, y, z = points_sensor.astype(np.float64).T
    cosine, sine = np.cos(middle), np.sin(middle)
    return np.arctan2(y * cosine - x * sine, x * cosine + y * sine), np.arctan2(z, np.hypot(x, y))


def _column_step(azimuth: Floats, elevation: Floats) -> float:
    """Median angle to the next return of the same row, on one side so that noise does not make it too small."""
    directions = np.column_stack([azimuth * np.cos(elevation), elevation])
    tree = cKDTree(directions, leafsize=64, balanced_tree=False, compact_nodes=False)
    asked = np.arange(0, len(directions), max(1, len(directions) // QUERIES))
    _, nearest = tree.query(directions[asked], k=min(NEIGHBOURS + 1, len(directions)))
    steps = azimuth[nearest] - azimuth[asked][:, None]
    lifts = np.abs(elevation[nearest] - elevation[asked][:, None])
    nearest_steps = np.where((steps > 0) & (lifts < steps / 2), steps, np.inf).min(axis=1)
    nearest_steps = nearest_steps[np.isfinite(nearest_steps)]
    return float(np.median(nearest_steps)) if nearest_steps.size else 0.0


def _above_and_below(
    azimuth: Floats, elevation: Floats, column_step: float, gap_rad: Floats, others: tuple[Floats, Floats]
) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Neighbours in the same column, (2, N), the angles to them, and the usual angle between rows at each return."""
    columns, other_columns = (
        np.floor(angles / (1.5 * column_step)) * ROW_KEY for angles in (azimuth, others[0])
    )  # wide enough to hold a return of every row
    keys, other_keys = columns + elevation, np.sort(other_columns + others[1])
    order = np.argsort(keys, kind="stable")
    keys, column, elevation = keys[order], columns[order], elevation[order]
    least = SAME_ROW * column_step
    places = np.array([np.searchsorted(keys, keys + least), np.searchsorted(keys, keys - least) - 1])
    nearest = np.clip(places, 0, len(order) - 1)
    lifts = np.abs(elevation[nearest] - elevation)
    lifts[(column[nearest] != column) | (lifts < least)] = np.inf
    usual = _usual_by_elevation(elevation, lifts.min(axis=0), otherwise=column_step)
    lower, upper = np.minimum(keys[nearest], keys) + least, np.maximum(keys[nearest], keys) - least
    nothing_met = np.searchsorted(other_keys, lower) >= np.searchsorted(other_keys, upper)
    reach = BRIDGED_STEPS * usual + np.where(nothing_met, gap_rad[order], 0.0)
    neighbours = np.where(lifts <= reach, order[nearest], -1)
    back = np.argsort(order)
    return neighbours.take(back, axis=1), lifts.take(back, axis=1), usual[back]


def _usual_by_elevation(elevation: Floats, lifts: Floats, *, otherwise: float) -> Floats:
    """Median angle between rows around each return's elevation: lidars have rows close together near the horizon and
    several times further apart below. Infinite `lifts` are unknown."""
    order = np.argsort(elevation, kind="stable")
    parts = -(-len(order) // LOCAL)
    of_part = np.full(parts * LOCAL, np.inf)
    of_part[: len(order)] = lifts[order]
    of_part = np.sort(of_part.reshape(parts, LOCAL), axis=1)
    known = np.isfinite(of_part).sum(axis=1)
    medians = of_part[np.arange(parts), np.maximum(known - 1, 0) // 2]
    if not known.all():
        whole = lifts[np.isfinite(lifts)]
        medians[known == 0] = np.median(whole) if whole.size else otherwise
    usual = np.empty(len(order))
    usual[order] = np.repeat(medians, LOCAL)[: len(order)]
    return usual


def _beside(
    azimuth: Floats, elevation: Floats, column_step: float, most_lift: Floats
) -> tuple[NDArray[np.intp], Floats]:
    """To the left and to the right, (2, N), the return of nearest elevation in the next column, else in the one after
    it, and the angles to them."""
    keys = np.floor(azimuth / column_step) * ROW_KEY + elevation
    order = np.argsort(keys, kind="stable")
    keys, azimuth, elevation, most_lift = keys[order], azimuth[order], elevation[order], most_lift[order]
    beside, turns = np.full((2, len(order)), -1, dtype=np.intp), np.full((2, len(order)), np.inf)
    for side, sign in enumerate((1, -1)):
        for columns in (1, 2):
            position, least = np.searchsorted(keys, keys + sign * columns * ROW_KEY), most_lift.copy()
            missing = beside[side] < 0
            for other in (np.maximum(position - 1, 0), np.minimum(position, len(keys) - 1)):
                turn, lift = (azimuth[other] - azimuth) * sign, np.abs(elevation[other] - elevation)
                nearer = missing & (column_step / 4 < turn) & (turn <= BRIDGED_STEPS * column_step) & (lift < least)
                for values, better in ((beside[side], other), (turns[side], turn), (least, lift)):
                    np.copyto(values, better, where=nearer)
    back = np.argsort(order)
    return np.where(beside >= 0, order[beside], -1).take(back, axis=1), turns.take(back, axis=1)
