"""The motion of a track, from registering its points over one and several sweeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from bench.annotation.settings import ProposalSettings
from bench.annotation.tracking import Fragment
from bench.times import SECOND_NS

Floats = NDArray[np.float64]
ROUNDS = 2  # of registration, the second with points moved to one time
UPRIGHT = np.array([1.0, 1.0, 0.7])
MOST_POINTS = 200  # of a sweep that are registered
STEPS, CONVERGED_M, KEPT = 8, 0.005, 0.7  # iterations; the nearest share of pairs counts
REACH_M, LEAST_PAIRS = 1.0, 6
PARABOLA_FROM = 6  # positions; through fewer goes a line
SMOOTH, CENTRED = 3.0, 0.05  # weights of constant speed and of the clusters' means beside registrations
LEAST_STEP_S = 0.03
CUT_M = 0.3  # from the end of an object, where a point at the edge of the sector says that it may go on
HIDDEN_M = 2.0  # that ends of an object differ in their shifts, where one of them is not seen twice
LONG_M = 2.0  # objects whose flat sides say little of their motion
END_POINTS = 5
LEAST_SHIFT_M = 0.05  # that tells a direction


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """Positions and velocities of a track at the times of its observations.

    Attributes:
        times_s: (K,) float64, when the object was seen, from the first sweep's time on.
        offset_s: (K,) float64, that time after the sweep's.
        positions_m: (K, 2) float64, of a point of the object, world frame.
        velocity_mps: (K, 2) float64.
        points: for each observation (N, 3) float64, m, all moved to the time it was seen.
        cut_off: for each observation (N,) bool, points at the edge of the lidar's sector.
    """

    times_s: Floats
    offset_s: Floats
    positions_m: Floats
    velocity_mps: Floats
    points: tuple[Floats, ...]
    cut_off: tuple[NDArray[np.bool_], ...]

    @property
    def speed_mps(self) -> Floats:
        """(K,) float64."""
        return np.asarray(np.hypot(*self.velocity_mps.T))


def track_motion(fragment: Fragment, settings: ProposalSettings) -> Motion:
    """Fit positions to shifts between observations; speed changes smoothly."""
    seen = fragment.observations
    raw = [observation.points for observation in seen]
    later_s = [observation.cloud.offset_s[observation.rows] for observation in seen]
    offset_s = np.array([times.mean() for times in later_s])
    start_ns = seen[0].cloud.timestamp_ns
    times_s = np.array([(observation.cloud.timestamp_ns - start_ns) / SECOND_NS for observation in seen]) + offset_s
    times_s = np.maximum.accumulate(times_s + 1e-4 * np.arange(len(seen)))
    cut_off = tuple(observation.cloud.cut_off[observation.rows] for observation in seen)
    centres = np.array([points[:, :2].mean(axis=0) for points in raw])
    degree = min(2 if len(seen) >= 8 else 1, len(seen) - 1)
    positions_m = _windowed_polynomial(times_s, centres, degree)
    velocity_mps = slopes(times_s, positions_m, settings.fit_s)
    points: list[Floats] = []
    for _ in range(ROUNDS):
        points = [
            np.column_stack([one[:, :2] + np.outer(offset - times, velocity), one[:, 2]])
            for one, times, offset, velocity in zip(raw, later_s, offset_s, velocity_mps, strict=True)
        ]
        positions_m = _fitted(times_s, centres, points, cut_off, positions_m, settings)
        velocity_mps = slopes(times_s, positions_m, settings.fit_s)
    return Motion(
        times_s=times_s, offset_s=offset_s, positions_m=positions_m, velocity_mps=velocity_mps, points=tuple(points),
        cut_off=cut_off,
    )  # fmt: skip


def cut_ends(along_m: Floats, cut_off: NDArray[np.bool_]) -> tuple[bool, bool]:
    """Say whether an object may go on beyond its lowest and its highest point along an axis, (N,)."""
    at_edge = along_m[cut_off]
    return bool((at_edge < along_m.min() + CUT_M).any()), bool((at_edge > along_m.max() - CUT_M).any())


def _visible_shift(
    points: tuple[Floats, Floats], cut_off: tuple[NDArray[np.bool_], NDArray[np.bool_]], guess_m: Floats
) -> Floats:
    """(2,) float64, m, the guess corrected by the ends of the object that both sweeps see.

    The flat side of a long object lies as well on itself a metre further on, and while an object comes into the lidar's
    sector, the mean of its points moves at half its speed.
    """
    length_m = float(np.hypot(*guess_m))
    if length_m < LEAST_SHIFT_M:
        return guess_m
    along = [one[:, :2] @ (guess_m / length_m) for one in points]
    cut = [cut_ends(one, flags) for one, flags in zip(along, cut_off, strict=True)]
    if min(np.ptp(one) for one in along) < LONG_M and not (cut_off[0].any() or cut_off[1].any()):
        return guess_m
    ends = [(one[-END_POINTS:].mean(), one[:END_POINTS].mean()) for one in map(np.sort, along)]
    shifts = np.array([ends[1][end] - ends[0][end] for end in (0, 1) if not (cut[0][1 - end] or cut[1][1 - end])])
    if not len(shifts):
        return guess_m
    if np.ptp(shifts) > HIDDEN_M:  # one end was hidden in one of the sweeps
        shifts = shifts[[np.argmin(np.abs(shifts - length_m))]]
    return np.asarray(guess_m / length_m * shifts.mean())


def slopes(times_s: Floats, positions_m: Floats, within_s: float) -> Floats:
    """(K, 2) float64, m/s, slope of a parabola through the positions within a time; at least five if there are."""
    out = np.zeros_like(positions_m)
    for i, time_s in enumerate(times_s):
        near = np.flatnonzero(np.abs(times_s - time_s) <= within_s / 2)
        if len(near) < 3 or np.ptp(times_s[near]) < 0.1:
            near = np.argsort(np.abs(times_s - time_s), kind="stable")[:5]
        degree = 2 if len(near) >= PARABOLA_FROM else min(1, len(near) - 1)
        out[i] = np.polyfit(times_s[near] - time_s, positions_m[near], degree)[-2] if degree else 0.0
    return out


def _windowed_polynomial(times_s: Floats, values: Floats, degree: int) -> Floats:
    """First guess: a polynomial through the means of the clusters; of long tracks piece by piece."""
    out = np.empty_like(values)
    pieces = max(1, round(float(times_s[-1] - times_s[0]) / 2.5))
    for part in np.array_split(np.arange(len(times_s)), pieces):
        fits = min(degree, len(part) - 1)
        out[part] = np.stack(
            [np.polyval(np.polyfit(times_s[part] - times_s[part[0]], v[part], fits), times_s[part] - times_s[part[0]])
             for v in values.T], axis=1,
        )  # fmt: skip
    return out


def _fitted(
    times_s: Floats,
    centres: Floats,
    points: Sequence[Floats],
    cut_off: Sequence[NDArray[np.bool_]],
    guess_m: Floats,
    settings: ProposalSettings,
) -> Floats:
    """Least squares of shifts, of constant velocity and, weakly, of the means, as normal equations."""
    n = len(times_s)
    trees = [KDTree(sampled * UPRIGHT) for sampled in (one[:: -(-len(one) // MOST_POINTS)] for one in points)]
    normal, right = CENTRED**2 * np.eye(n), CENTRED**2 * centres
    for gap in settings.shifts:
        for i in range(n - gap):
            j = i + gap
            begin_m = _visible_shift((points[i], points[j]), (cut_off[i], cut_off[j]), guess_m[j] - guess_m[i])
            found = register(trees[i], trees[j], begin_m)
            if found is not None:
                shift_m, residual_m = found
                weight = (0.05 + residual_m) ** -2
                normal[[i, j], [i, j]] += weight
                normal[[i, j], [j, i]] -= weight
                right[i] -= weight * shift_m
                right[j] += weight * shift_m
    for i in range(n - 2):
        before, after = np.maximum(np.diff(times_s[i : i + 3]), LEAST_STEP_S)
        change = np.array([1 / before, -1 / before - 1 / after, 1 / after])
        normal[i : i + 3, i : i + 3] += SMOOTH**2 * np.outer(change, change)
    return np.asarray(np.linalg.solve(normal, right))


def register(start: KDTree, end: KDTree, guess_m: Floats) -> tuple[Floats, float] | None:
    """Shift that lays points on others, by trimmed nearest neighbours in both directions.

    Args:
        start: points, (N, 3), heights shrunk by `UPRIGHT`.
        end: points to lay them on, likewise.
        guess_m: (2,) float64, where to begin.

    Returns:
        (2,) float64, m, and the median distance that is left; None where too few have a neighbour.
    """
    shift, distances = np.array([*guess_m, 0.0]), np.zeros(0)
    here, there = np.asarray(start.data), np.asarray(end.data)
    for _ in range(STEPS):
        ahead_m, nearest = map(np.asarray, end.query(here + shift, distance_upper_bound=REACH_M))
        back_m, opposite = map(np.asarray, start.query(there - shift, distance_upper_bound=REACH_M))
        ahead, back = np.isfinite(ahead_m), np.isfinite(back_m)
        left = np.concatenate(
            [there[nearest[ahead]] - (here[ahead] + shift), there[back] - shift - here[opposite[back]]]
        )
        if len(left) < LEAST_PAIRS:
            return None
        distances = np.concatenate([ahead_m[ahead], back_m[back]])
        step = left[np.argsort(distances, kind="stable")[: max(1, round(KEPT * len(distances)))]].mean(axis=0)
        shift[:2] += step[:2]
        if np.hypot(step[0], step[1]) < CONVERGED_M:
            break
    return shift[:2], float(np.median(distances))
