"""The lowest and the highest beam of a lidar, from the returns of a sweep.

Beams need not start in one point. Those of an HDL-64E come out of two blocks, 8 cm apart and up to 0.2 m above the
origin of its points: seen from there, its highest beam lies at 5.7 degrees at 3 m and at 2.3 degrees at 30 m. A beam is
a line of heights over range, from where it starts on the lidar's axis.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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

    def heights_m(self, flat_m: NDArray[np.float64]) -> NDArray[np.float64]:
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

    def starts_m(self, points_sensor: NDArray[np.float64]) -> NDArray[np.float64]:
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
    may be stray. The height is right from which returns at the most different ranges lie on this beam. Of heights as
    good counts for the highest beam the one nearest to the sensor's origin, for the lowest the one nearest to
    half of the highest's; these themselves where too few ranges tell.

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
