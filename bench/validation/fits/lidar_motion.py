"""The lidar's own motion against what odometry, clock and mounting make of it: the one that is wrong is fitted.

Odometry and mounting predict the motion between two sweeps. Each hypothesis frees one quantity (clock, mounting, speed,
yaw rate), lets the others be off by as much as good ones are, and is fitted to the same measured steps. Pitch, roll and
heave of the body are measured but not compared: odometry is planar.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bench.egomotion.trajectory import Trajectory
from bench.geometry import RigidTransform, twist_between
from bench.times import SECOND_NS
from bench.validation.fits.readings import DEGREE
from bench.validation.fits.scan_matching import LEAST_INFORMATION, Step

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """A quantity that may be wrong between lidar, odometry and their clocks.

    Attributes:
        stated: its value where all is right.
        usual: standard deviation of good drives: tyres, sensors, mountings.
        tolerated: good drives are off by less; wheel ticks at walking pace make 3 % of the speed.
        small: what is off by more is another sign, unit or axis.
        known: standard deviation up to which a value counts as known; the report says of others that it cannot tell.
        field: of a finding.
        kind: of a finding, in findings.yaml.
        unit: in which it is reported.
        scale: of these units in one.
        why: what the drive may lack where it is not known, beside sweeps that match; "" for nothing.
    """

    stated: float = 0.0
    usual: float
    tolerated: float
    small: float
    known: float
    field: str
    kind: str
    unit: str
    scale: float
    why: str

    def interval(self, value: float, sigma: float) -> str:
        """A fitted value less the stated one, with its interval of 95 %."""
        off, half = self.scale * (value - self.stated), 1.96 * self.scale * sigma
        return f"{off:+.3g} [{off - half:+.3g}, {off + half:+.3g}] {self.unit}"


QUANTITIES = {
    "late_s": Quantity(
        usual=0.001, tolerated=0.004, small=0.3, known=0.005, unit="ms", scale=1e3,
        field="clock of lidar sweeps against ego-motion", kind="clock-offset",
        why="it has too little braking, acceleration or turning"),
    "speed": Quantity(
        stated=1.0, usual=0.01, tolerated=0.03, small=0.2, known=0.01, unit="%", scale=1e2,
        field="scale of the speed", kind="ego-motion-scale: speed",
        why="it hardly drives, or sees little across its way"),
    "turn": Quantity(
        stated=1.0, usual=0.02, tolerated=0.06, small=0.5, known=0.03, unit="%", scale=1e2,
        field="scale of the yaw rate", kind="ego-motion-scale: yaw rate",
        why="it hardly turns"),
    "bias_radps": Quantity(
        usual=0.0017, tolerated=0.007, small=0.09, known=0.005, unit="deg/s", scale=1 / DEGREE,
        field="bias of the yaw rate", kind="ego-motion-scale: bias", why=""),
    "yaw_rad": Quantity(
        usual=0.009, tolerated=0.021, small=0.5, known=0.009, unit="degrees", scale=1 / DEGREE,
        field="lidar.vehicle_from_lidar, yaw", kind="lidar-pose: yaw",
        why="it hardly moves"),
}  # fmt: skip
PARAMETERS = tuple(QUANTITIES)
STATED, USUAL = (np.array([getattr(one, name) for one in QUANTITIES.values()]) for name in ("stated", "usual"))


MOST_USUAL = 4.0  # standard deviations of good drives; beyond them a drive is not good
STEP_M = 0.0015  # error of a step: noise, cells, and what constant motion over two sweeps leaves out
SOFT_M = 0.02  # error of a step beyond which it counts less: a match that slipped
LONGEST_LATE_S = 0.2  # of clocks that are tried


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mounting:
    """Parameters by which the lidar's level motion follows from the vehicle's.

    Attributes:
        level_from_vehicle: (2, 2) float64, orthogonal; of determinant -1 where the points are mirrored.
        lever_m: (2,) float64, m, x and y of the points' origin in the vehicle frame.
    """

    level_from_vehicle: Array
    lever_m: Array

    def axes(self, yaw_rad: float) -> Array:
        """(2, 2) float64, `level_from_vehicle` with the lidar turned to the left on the vehicle."""
        cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
        return np.asarray(self.level_from_vehicle @ np.array([[cosine, sine], [-sine, cosine]]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LevelSteps:
    """Measured steps along the road, seen from the road below the points' origin.

    Attributes:
        lidar_from_level: (3, 3) float64, axes x, y and up of the level frame as columns, axes of the points.
        first_s: (K,) float64, s after `epoch_ns`.
        last_s: (K,) float64.
        epoch_ns: zero of the times.
        motion: (K, 3) float64, path along x and y in m, turn about up in rad.
        root: (K, 3, 3) float64, `root @ error` are the distances in m that an error of `motion` puts between surfaces.
    """

    lidar_from_level: Array
    first_s: Array
    last_s: Array
    epoch_ns: int
    motion: Array
    root: Array

    def stated(self, vehicle_from_lidar: RigidTransform) -> Mounting:
        """The mounting that a transform states."""
        matrix = (vehicle_from_lidar.rotation @ self.lidar_from_level)[:2, :2].T
        left, _, right = np.linalg.svd(matrix)
        return Mounting(level_from_vehicle=left @ right, lever_m=vehicle_from_lidar.translation_m[:2])


def level_steps(steps: Sequence[Step], up: Array, height_m: float, forward: Array) -> LevelSteps:
    """Reduce steps to the road's plane.

    Args:
        steps: as measured.
        up: (3,) float64, unit, normal of the road, axes of the points.
        height_m: of the points' origin above the road.
        forward: (3,) float64, direction that becomes x, axes of the points; any that is not along `up`.
    """
    x = forward - up * (up @ forward)
    x /= np.linalg.norm(x)
    axes = np.column_stack([x, np.cross(up, x), up])
    a = height_m * up
    cross = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    lidar_from_road = np.block([[np.eye(3), np.zeros((3, 3))], [-cross, np.eye(3)]])
    both = lidar_from_road @ np.kron(np.eye(2), axes)
    kept, free = [3, 4, 2], [0, 1, 5]
    motion, roots = [], []
    for step in steps:
        path = step.path_m - np.cross(step.turn_rad, a)
        motion.append([*(axes.T @ path)[:2], (axes.T @ step.turn_rad)[2]])
        whole = both.T @ step.information @ both
        across = whole[np.ix_(kept, free)]
        level = whole[np.ix_(kept, kept)] - across @ np.linalg.pinv(whole[np.ix_(free, free)], rcond=1e-6) @ across.T
        # Along a wall a step tells only how far the lidar turned.
        if np.linalg.eigvalsh(level[:2, :2])[0] < LEAST_INFORMATION:
            level = np.diag([0.0, 0.0, level[2, 2] - level[2, :2] @ np.linalg.pinv(level[:2, :2]) @ level[:2, 2]])
        sizes, directions = np.linalg.eigh(level)
        roots.append(np.sqrt(np.maximum(sizes, 0.0))[:, None] * directions.T)
    epoch_ns = steps[0].first_ns
    return LevelSteps(
        lidar_from_level=axes,
        first_s=np.array([step.first_ns - epoch_ns for step in steps]) / SECOND_NS,
        last_s=np.array([step.last_ns - epoch_ns for step in steps]) / SECOND_NS,
        epoch_ns=epoch_ns,
        motion=np.array(motion),
        root=np.array(roots),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Odometry:
    """Path along x and y and turn since the first pose, vehicle axes: (N,) s and (N, 3) m, m, rad."""

    seconds: Array
    travelled: Array

    @classmethod
    def of(cls, path: Trajectory, epoch_ns: int) -> Odometry:
        """Sum of the steps of a path."""
        turns, paths_m = twist_between(
            path.rotations[:-1], path.positions_m[:-1], path.rotations[1:], path.positions_m[1:]
        )
        steps = np.column_stack([paths_m[:, :2], turns[:, 2]])
        return cls(
            seconds=(path.timestamps_ns - epoch_ns) / SECOND_NS,
            travelled=np.vstack([np.zeros(3), np.cumsum(steps, axis=0)]),
        )

    def between(self, first_s: Array, last_s: Array) -> Array:
        """(K, 3) float64, motion between times (K,); NaN beyond the ends."""
        first, last = (
            np.column_stack([np.interp(at_s, self.seconds, way, left=np.nan, right=np.nan) for way in self.travelled.T])
            for at_s in (first_s, last_s)
        )
        return np.asarray(last - first)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """A fitted hypothesis.

    Attributes:
        values: (5,) float64, `QUANTITIES`: lateness of sweeps against odometry, factors of speed and yaw rate, what is
            added to the yaw rate, turn of the lidar to the left.
        sigma: (5,) float64, standard deviations.
        cost: sum of squares of errors over their standard deviations, large ones counted less.
        apart_m: root mean square of the distances that are left between sweeps, m.
    """

    values: Array
    sigma: Array
    cost: float
    apart_m: float

    def of(self, name: str) -> tuple[float, float]:
        """Value of one of `QUANTITIES`, and its standard deviation."""
        i = PARAMETERS.index(name)
        return float(self.values[i]), float(self.sigma[i])


def _errors(steps: LevelSteps, odometry: Odometry, mounting: Mounting, values: Array) -> Array:
    """(K, 3) float64, distances in m that values (5,), as in `Fit`, leave between sweeps; 0 without odometry."""
    late_s, speed, turn, bias_radps, yaw_rad = values
    moved = odometry.between(steps.first_s - late_s, steps.last_s - late_s)
    turned = turn * moved[:, 2] + bias_radps * (steps.last_s - steps.first_s)
    sideways = np.array([-mounting.lever_m[1], mounting.lever_m[0]])
    path_m = (speed * moved[:, :2] + turned[:, None] * sideways) @ mounting.axes(yaw_rad).T
    mirror = np.linalg.det(mounting.level_from_vehicle)
    error = np.column_stack([path_m, turned * mirror]) - steps.motion
    return np.asarray(np.nan_to_num(np.einsum("kij,kj->ki", steps.root, error)))


def fitted(
    steps: LevelSteps,
    odometry: Odometry,
    mounting: Mounting,
    *,
    free: Sequence[str] = (),
    starts: Sequence[Array] = (STATED,),
) -> Fit:
    """Fit all parameters, those that are not free close to their usual values.

    Args:
        steps: measured.
        odometry: stated.
        mounting: of the lidar.
        free: of `QUANTITIES`.
        starts: values (5,) at which the fit begins; the best end counts.
    """
    freed = np.isin(PARAMETERS, free)
    prior = np.where(freed, 1e-3, 1.0)  # weak, so that nothing is singular
    limit = np.where(freed, np.inf, MOST_USUAL)
    limit[0] = LONGEST_LATE_S / USUAL[0] if freed[0] else limit[0]

    def residuals(scaled: Array) -> Array:
        errors = _errors(steps, odometry, mounting, STATED + scaled * USUAL)
        size = np.linalg.norm(errors, axis=-1, keepdims=True) / SOFT_M
        less = np.sqrt(np.log1p(size**2)) / np.maximum(size, 1e-9)  # Cauchy
        return np.concatenate([(errors * less / STEP_M).ravel(), prior * scaled])

    fits = [
        least_squares(residuals, (start - STATED) / USUAL, bounds=(-limit, limit), x_scale="jac") for start in starts
    ]
    best = min(fits, key=lambda fit: fit.cost)
    values = STATED + best.x * USUAL
    errors = _errors(steps, odometry, mounting, values)
    excess = max(1.0, 2.0 * best.cost / max(errors.size - len(USUAL), 1))
    jacobian = np.asarray(best.jac)
    covariance = np.linalg.inv(jacobian.T @ jacobian) * excess
    return Fit(
        values=values,
        sigma=np.sqrt(np.diag(covariance)) * USUAL,
        cost=2.0 * best.cost,
        apart_m=float(np.sqrt((errors**2).sum() / max(len(errors), 1))),
    )
