"""Errors of the ego-motion between two images, measured by the lidar where neighbouring sweeps meet.

Flow alone cannot tell a camera that looks a degree aside from a vehicle that slips, or whose nose dives. The lidar can:
how its sweeps meet says where it went, in its own axes, and a camera has to fit the lidar.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.geometry import twist_between
from bench.recordings import Recording
from bench.times import SECOND_NS
from bench.validation.drive import distance_to
from bench.validation.findings import DEGREE
from bench.validation.scan_matching import Step

Floats = NDArray[np.float64]

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
    errors: Floats
    path_m: Floats

    def at(self, times_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Times, (N,), at which the motion is measured."""
        if not len(self.middle_ns):
            return np.zeros(len(times_ns), dtype=bool)
        return distance_to(times_ns, self.middle_ns) < NEAR_NS

    def between(self, times_ns: NDArray[np.int64]) -> tuple[Floats, Floats]:
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
