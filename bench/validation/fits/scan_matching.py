"""Motion between neighbouring lidar sweeps, measured by the sweeps alone: neither ego-motion nor mounting is believed.

Returns of the later sweep are moved until they lie on the surfaces of the earlier one (point to plane). Both are
motion-compensated by the motion that is being estimated, as constant over the two. What cannot be measured, such as the
way along a corridor, has no weight in the step's `information`.

Flow alone cannot tell a camera that looks a degree aside from a vehicle that slips, or whose nose dives. The lidar can:
how its sweeps meet says where it went, in its own axes, and a camera has to fit the lidar.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from bench.errors import DataError
from bench.geometry import advance_twist, twist_between
from bench.recordings import Recording
from bench.times import SECOND_NS
from bench.validation.findings import distance_to, on_objects, sweep_times
from bench.validation.fits.readings import DEGREE

Array = NDArray[np.float64]


MOST_STEPS = 30  # pairs of neighbouring sweeps; more than these are not needed for the intervals asked for
RUN = 11  # of neighbouring sweeps in one piece; a long drive is looked at in several
APART_S = (0.03, 0.35)  # time between sweeps that count as neighbours
SPAN_M = (2.5, 50.0)  # of returns from the lidar; nearer ones are the vehicle's own, farther ones are thin
CELL_M = 0.2  # returns are averaged in cubes of this side, so that near surfaces do not count for more
CELLS = 15_000  # of a sweep that are taken, at random: dense sweeps fill 50,000 and take as many times longer
SOURCE_POINTS = 2500  # returns of the later sweep that are moved
SURFACE_POINTS = 10  # neighbours that make a surface
THICKNESS = 0.1  # of a surface, largest share of the thinnest axis in the next, as variances
WIDTH = 0.05  # of a surface, smallest share of the second axis in the first, as variances: one ring is no surface
REACH_M = (1.0, 0.6, 0.4, 0.3, 0.3, 0.3)  # how far a surface may be in each round
SOFT_M = 0.06  # distance at which a return counts half: it was hidden, or moves
COARSE_M = (0.8, 1.6, 2.5, 3.5)  # starts of the first match, along four directions and none; 35 m/s at 10 Hz
ARM_M = 10.0  # distance at which an error of the rotation counts as one of the path
# Mean square of the share of a motion that surfaces feel, 16 % of it; normals scatter by 3 degrees, and a motion that
# is felt by less is not measured.
LEAST_INFORMATION = 0.025
LEAST_POINTS = 200  # returns of a sweep; with fewer there is no match
LEAST_MET = 0.2  # share of the returns that meet a surface in each round; with less there is no match
LEAST_NEAR = 0.5  # share of the returns within `SOFT_M` of their surfaces; with less there is no match


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step:
    """Motion of the lidar from one sweep to the next, in the axes of its points as the files give them.

    Attributes:
        first_ns: reference time of the earlier sweep.
        last_ns: reference time of the later one.
        turn_rad: (3,) float64, rotation vector of the whole step, lidar axes.
        path_m: (3,) float64, m, path of the lidar's origin in its own axes over the whole step.
        information: (6, 6) float64, for an error (rotation, translation) x of the step x @ information @ x is the mean
            square of the distance that it puts between returns and surfaces, m2.
    """

    first_ns: int
    last_ns: int
    turn_rad: Array
    path_m: Array
    information: Array

    @property
    def tells_all(self) -> bool:
        """Every part of the motion is measured; along a plain wall the way is not."""
        return int(np.linalg.matrix_rank(self.information)) == len(self.information)

    @property
    def twist(self) -> Array:
        """(6,) float64, rotation vector and path per second."""
        return np.concatenate([self.turn_rad, self.path_m]) / ((self.last_ns - self.first_ns) / SECOND_NS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Returns:
    """Returns of the static world, averaged in cells: points (N, 3) m and times (N,) s after the reference time."""

    time_ns: int
    points: Array
    seconds: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Scan:
    """Returns compensated by a twist, and the surfaces on which they lie."""

    returns: _Returns
    tree: cKDTree
    points: Array
    normals: Array  # NaN where neighbours make no surface


@lru_cache(maxsize=1)  # its lidar's motion and every camera ask for those of one recording
def scan_steps(recording: Recording) -> tuple[Step, ...]:
    """Match neighbouring sweeps.

    Args:
        recording: the drive; its mounting and ego-motion choose only which returns are left out, and which sweeps.

    Returns:
        Steps that could be matched, by time.
    """
    steps: list[Step] = []
    for run in _runs(recording):
        before: _Scan | None = None
        twist: Array | None = None
        for row in run:
            returns = _static_returns(recording, row)
            if returns is None:
                before = twist = None
                continue
            scan = _scan(returns, np.zeros(6) if twist is None else twist)
            if before is not None:
                step = _first_match(scan, before) if twist is None else _match(scan, before, twist)
                twist = None if step is None else step.twist
                steps += [step] if step is not None else []
            before = scan if twist is None else _recompensated(scan, twist)
    return tuple(steps)


def neighbouring(recording: Recording) -> NDArray[np.bool_]:
    """Steps between sweeps, (N - 1,), that are neither too short nor too long to be matched."""
    steps_s = np.diff(sweep_times(recording)) / SECOND_NS
    return np.asarray((steps_s > APART_S[0]) & (steps_s < APART_S[1]))


def _runs(recording: Recording) -> Iterator[Sequence[int]]:
    """Stretches of neighbouring sweeps: those in which the stated speed and yaw rate change most, clocks show there."""
    times_ns = sweep_times(recording)
    steps_s, near = np.diff(times_ns) / SECOND_NS, neighbouring(recording)
    if not near.any():
        return
    starts = np.arange(0, len(times_ns) - 1, RUN - 1)
    rotations, positions_m, _ = recording.trajectory.at(times_ns)
    speed = np.linalg.norm(np.diff(positions_m, axis=0), axis=1) / steps_s
    turn = np.linalg.norm(np.diff(rotations[:, :, 0], axis=0), axis=1) / steps_s
    worth = []
    for start in starts:
        rows = slice(start, start + RUN - 1)
        moving = np.nan_to_num(speed[rows] / 10.0), np.nan_to_num(turn[rows])
        worth.append(sum(float(np.ptp(values)) + 0.1 * float(values.mean()) for values in moving))
    chosen = np.argsort(worth, kind="stable")[::-1][: max(1, round(MOST_STEPS / (RUN - 1)))]
    for start in np.sort(starts[chosen]):
        run = [int(start)]
        for row in range(int(start), min(int(start) + RUN - 1, len(times_ns) - 1)):
            if not near[row]:
                yield run
                run = []
            run.append(row + 1)
        yield run


def _static_returns(recording: Recording, row: int) -> _Returns | None:
    """Returns within reach that lie on no annotated object, averaged in cells; None for too few or an unread sweep."""
    try:
        sweep = recording.sweeps[row].read()
    except DataError:
        return None  # reported by the check of the sweeps
    points = sweep.points_lidar.astype(np.float64)
    away_m = np.linalg.norm(points - recording.lidar_from_sensor.translation_m, axis=1)
    rows = np.flatnonzero((away_m > SPAN_M[0]) & (away_m < SPAN_M[1]))
    rows = rows[~on_objects(recording.vehicle_from_lidar.apply(points[rows]), sweep.timestamp_ns, recording)]
    if len(rows) < LEAST_POINTS:
        return None
    offsets_ns = sweep.time_offset_ns
    seconds = np.zeros(len(rows)) if offsets_ns is None else offsets_ns[rows] / SECOND_NS
    cell = np.floor(points[rows] / CELL_M).astype(np.int64) + 1000
    _, number, count = np.unique(cell @ [1, 4000, 16_000_000], return_inverse=True, return_counts=True)
    columns = [np.bincount(number, weights=values) / count for values in (*points[rows].T, seconds)]
    kept = np.random.default_rng(0).permutation(len(count))[:CELLS]
    return _Returns(time_ns=sweep.timestamp_ns, points=np.column_stack(columns[:3])[kept], seconds=columns[3][kept])


def _compensated(returns: _Returns, twist: Array, rows: NDArray[np.intp] | slice = slice(None)) -> Array:
    """Returns in the lidar's frame at the reference time, by a constant twist per second; first order in the twist."""
    points, seconds = returns.points[rows], returns.seconds[rows, None]
    return np.asarray(points + seconds * (np.cross(twist[:3], points) + twist[3:]))


def _scan(returns: _Returns, twist: Array) -> _Scan:
    points = _compensated(returns, twist)
    tree = cKDTree(points)
    neighbours = points[tree.query(points, k=SURFACE_POINTS)[1]]
    offsets = neighbours - neighbours.mean(axis=1, keepdims=True)
    variances, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets))
    thin, middle, wide = variances.T
    flat = (thin < THICKNESS * middle) & (middle > WIDTH * wide)
    return _Scan(returns=returns, tree=tree, points=points, normals=np.where(flat[:, None], axes[:, :, 0], np.nan))


def _recompensated(scan: _Scan, twist: Array) -> _Scan:
    """The scan with its returns moved a little; normals hardly turn."""
    points = _compensated(scan.returns, twist)
    return replace(scan, points=points, tree=cKDTree(points))


def _first_match(scan: _Scan, before: _Scan) -> Step | None:
    """Of many starts the one whose match brings most returns onto surfaces; then both sweeps compensated by it."""
    seconds = (scan.returns.time_ns - before.returns.time_ns) / SECOND_NS
    along = [(x, y) for away in COARSE_M for x, y in ((away, 0), (-away, 0), (0, away), (0, -away))]
    starts = [np.array([0, 0, 0, x, y, 0]) / seconds for x, y in [(0, 0), *along]]
    tried = [_moved(scan, before, start, SOURCE_POINTS // 4, REACH_M[:4]) for start in starts]
    matches = [one for one in tried if one is not None]
    if not matches:
        return None
    twist = max(matches, key=lambda one: one[2])[0]
    return _match(_scan(scan.returns, twist), _scan(before.returns, twist), twist)


def _match(scan: _Scan, before: _Scan, twist: Array) -> Step | None:
    """The twist, begun at that of the step before."""
    moved = _moved(scan, before, twist, SOURCE_POINTS, REACH_M)
    if moved is None or moved[2] < LEAST_NEAR:
        return None
    twist, information, _ = moved
    first_ns, last_ns = before.returns.time_ns, scan.returns.time_ns
    whole = twist * (last_ns - first_ns) / SECOND_NS
    return Step(first_ns=first_ns, last_ns=last_ns, turn_rad=whole[:3], path_m=whole[3:], information=information)


def _sample(normals: Array, most: int) -> NDArray[np.intp]:
    """As many rows of surfaces across each axis: else the road and walls along it outvote all that tells the speed."""
    rows = np.random.default_rng(0).permutation(np.flatnonzero(np.isfinite(normals[:, 0])))
    axis = np.abs(normals[rows]).argmax(axis=1)
    return np.concatenate([rows[axis == i][: most // 3] for i in range(3)])


def _moved(
    scan: _Scan, before: _Scan, twist: Array, most: int, reaches_m: Sequence[float]
) -> tuple[Array, Array, float] | None:
    """Gauss-Newton on the distances of returns to before.

    Returns:
        Twist per second, information of the step, and share of the returns that are near; None where too few surfaces
        are met.
    """
    rows = _sample(scan.normals, most)
    seconds = (scan.returns.time_ns - before.returns.time_ns) / SECOND_NS
    for reach_m in reaches_m:
        points = _compensated(scan.returns, twist, rows)
        rotation, advance_m = advance_twist(twist[None, :3] * seconds, twist[None, 3:] * seconds, np.ones(1))
        placed = rotation.apply(points) + advance_m
        distances_m, nearest = map(np.asarray, before.tree.query(placed, distance_upper_bound=reach_m))
        met = np.flatnonzero(np.isfinite(distances_m))
        met = met[np.isfinite(before.normals[nearest[met], 0])]
        if len(met) < LEAST_MET * len(rows):
            return None
        normals = before.normals[nearest[met]]
        away_m = np.einsum("ni,ni->n", normals, placed[met] - before.points[nearest[met]])
        soft_m = max(SOFT_M, reach_m / 4)
        weights = (soft_m**2 / (soft_m**2 + away_m**2)) ** 2  # Geman and McClure
        design = np.column_stack([np.cross(placed[met], normals), normals])
        design[:, :3] /= ARM_M
        sizes, directions = np.linalg.eigh(design.T @ (weights[:, None] * design) / weights.sum())
        known = directions[:, sizes > LEAST_INFORMATION]
        gradient = known.T @ design.T @ (weights * away_m) / weights.sum()
        change = -known @ (gradient / sizes[sizes > LEAST_INFORMATION])
        change[:3] /= ARM_M
        turned = Rotation.from_rotvec(change[:3])
        turn, path_m = twist_between(
            Rotation.identity(1), np.zeros((1, 3)), turned * rotation, turned.apply(advance_m) + change[3:]
        )
        twist = np.concatenate([turn[0], path_m[0]]) / seconds
    near = np.abs(away_m) < SOFT_M
    scaled = known * np.repeat([ARM_M, 1.0], 3)[:, None]
    information = scaled * sizes[sizes > LEAST_INFORMATION] @ scaled.T
    return twist, information, float(near.sum() / len(placed))


NEAR_NS = 60_000_000  # of the middle of a step to that of a pair
LEAST_MPS = 0.5  # slower ones tell no direction
# Of a step, as they scatter in clean rendered drives: rotation about the vehicle's axes, rad/s; speed to the front, to
# the left and up, parts of the speed. A body dives within a step; and what of the path is not measured better, m.
SIGMAS = np.array([0.3 * DEGREE, 0.5 * DEGREE, 0.1 * DEGREE, 0.005, 0.003, 0.003])
PATH_SIGMA_M = 0.0025
# As good ego-motion is wrong at most; beyond that what moves close to the lidar misleads it, or there is a fault that
# other checks find.
MOST = np.array([6.0 * DEGREE, 6.0 * DEGREE, 1.2 * DEGREE, 0.06, 0.04, 0.06])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredMotion:
    """Errors of the stated ego-motion by the lidar.

    Attributes:
        middle_ns: (K,) int64, sorted, of steps that say all of a motion.
        errors: (K, 6) float64, measured less stated, as `SIGMAS`.
        path_m: (K,) float64, of the step.
    """

    middle_ns: NDArray[np.int64]
    errors: Array
    path_m: Array

    def at(self, times_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Times, (N,), at which the motion is measured."""
        if not len(self.middle_ns):
            return np.zeros(len(times_ns), dtype=bool)
        return distance_to(times_ns, self.middle_ns) < NEAR_NS

    def between(self, times_ns: NDArray[np.int64]) -> tuple[Array, Array]:
        """Errors of the motion at times (N,), and their standard deviations, (N, 6)."""
        errors, path_m = (
            np.column_stack([np.interp(times_ns, self.middle_ns, column) for column in columns])
            for columns in (self.errors.T, [self.path_m])
        )
        sigmas = np.tile(SIGMAS, (len(times_ns), 1))
        sigmas[:, 3:] = np.maximum(sigmas[:, 3:], PATH_SIGMA_M / path_m)
        return errors, sigmas


def measured_motion(recording: Recording, steps: Sequence[Step]) -> MeasuredMotion:
    """Compare the ego-motion with the lidar's steps; those along a wall, or misled, are left out.

    Args:
        recording: with its ego-motion and mounting of the lidar.
        steps: as the lidar measured them.
    """
    mounting, steps = recording.vehicle_from_lidar, [step for step in steps if step.tells_all]
    times_ns = np.array([(step.first_ns, step.last_ns) for step in steps], dtype=np.int64).reshape(-1, 2)
    seconds = np.diff(times_ns, axis=1) / SECOND_NS
    turns_radps = np.array([step.turn_rad for step in steps]).reshape(-1, 3) @ mounting.rotation.T / seconds
    of_lidar_mps = np.array([step.path_m for step in steps]).reshape(-1, 3) @ mounting.rotation.T / seconds
    seen = np.hstack([turns_radps, of_lidar_mps - np.cross(turns_radps, mounting.translation_m)])

    rotations, positions_m, valid = recording.trajectory.at(times_ns.ravel())
    rotations[~valid] = np.eye(3)  # their positions are NaN, which compares as False below
    first, last = ((Rotation.from_matrix(rotations[i::2]), positions_m[i::2]) for i in (0, 1))
    stated = np.hstack(twist_between(*first, *last)) / seconds
    speeds_mps = np.linalg.norm(stated[:, 3:], axis=1)
    errors = seen - stated
    errors[:, 3:] /= np.maximum(speeds_mps, LEAST_MPS)[:, None]
    good = (speeds_mps > LEAST_MPS) & (np.abs(errors) < MOST).all(axis=1)
    middle_ns = times_ns[good, 0] + np.diff(times_ns[good], axis=1)[:, 0] // 2
    return MeasuredMotion(middle_ns=middle_ns, errors=errors[good], path_m=(speeds_mps * seconds[:, 0])[good])
