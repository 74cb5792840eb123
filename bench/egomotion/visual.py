"""Visual odometry from two views: rotation and direction of travel, never its length.

Everything is measured on unit rays, so rays beyond 90 degrees count like all others; the usual essential matrix on a
plane z = 1 cannot hold them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.egomotion.essential import best_pose, draw_essentials, epipolar_sines
from bench.egomotion.refinement import fit_rotation, refine_pose
from bench.errors import ShapeError, UsageError
from bench.geometry import angle_between, dot

STANDING_SHARE = 0.75  # tracks without parallax from which on a camera stands; the rest may be on moving objects
REFINED = 3  # of the drawn matrices, the best, since the best of a draw need not lie nearest to the best of all


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VisualMotion:
    """How a camera moved, as far as its images tell.

    Attributes:
        rotation: (3, 3) float64, current_from_previous.
        direction: (3,) float64, unit vector of t = C - C' in the current camera frame, the previous centre seen from
            the current camera; NaN where the camera stands or only turns.
        inliers: (N,) bool; tracks that agree with it.
        parallax_rad: angle that the rotation leaves between the rays of a track, exceeded by a quarter of the tracks.
    """

    rotation: NDArray[np.float64]
    direction: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    parallax_rad: float

    @property
    def moves(self) -> bool:
        """Whether there is a direction."""
        return bool(np.isfinite(self.direction).all())


@dataclass(frozen=True, slots=True, kw_only=True)
class VisualOdometry:
    """Estimates rotation and direction from tracks of a scene that mostly stands still.

    Attributes:
        tolerance_rad: a track agrees that lies this close to its epipolar plane; 0.33 px at 165 px per radian.
        min_parallax_rad: the camera counts as standing, or only turning, where a pure rotation leaves less than this
            angle on three quarters of the tracks: a direction would be that of the noise, or of what moves. 0.25 px at
            165 px per radian.
        draws: sets of eight tracks that are tried.
        scored: tracks that a drawn matrix is scored on.
        min_tracks: fewer tracks, or fewer that agree, say nothing.
        seed: of the draws; the same tracks give the same motion, whichever image came before.

    Raises:
        UsageError: a number that is out of its domain.

    Source:
        Hartley and Zisserman, Multiple view geometry, chapters 9 and 11 (eight points, four poses of an essential
        matrix); Fischler and Bolles 1981 (RANSAC); Torr and Zisserman 2000 (truncated squares); Chum et al. 2003 (local
        optimisation). Rays instead of plane coordinates as in Mariotti and Eising, section III-A.
    """

    tolerance_rad: float = 2e-3
    min_parallax_rad: float = 1.5e-3
    draws: int = 120
    scored: int = 400
    min_tracks: int = 50
    seed: int = 0

    def __post_init__(self) -> None:
        if min(self.tolerance_rad, self.min_parallax_rad) <= 0 or min(self.draws, self.scored) < 1:
            raise UsageError("visual odometry: expected positive angles, draws and scored")
        if self.min_tracks < 8:
            raise UsageError(f"visual odometry: expected min_tracks >= 8, got {self.min_tracks}")

    def __call__(self, rays_previous: NDArray[np.float64], rays_current: NDArray[np.float64]) -> VisualMotion | None:
        """Estimate the motion between two images.

        Args:
            rays_previous: (N, 3) float64, unit rays p, previous camera frame; NaN where not valid.
            rays_current: (N, 3) float64, unit rays p', current camera frame; NaN where not valid.

        Returns:
            The motion; None where too few tracks are there or agree.

        Raises:
            ShapeError: rays of different shapes.
        """
        if rays_previous.shape != rays_current.shape or rays_current.ndim != 2 or rays_current.shape[1] != 3:
            raise ShapeError(f"rays: expected two arrays (N, 3), got {rays_previous.shape} and {rays_current.shape}")
        usable = np.isfinite(rays_previous + rays_current).all(axis=1)
        if np.count_nonzero(usable) < self.min_tracks:
            return None
        previous, current = rays_previous[usable], rays_current[usable]
        rotation = fit_rotation(previous, current, tolerance_rad=self.tolerance_rad)
        left_rad = angle_between(previous @ rotation.T, current)
        parallax_rad = float(np.quantile(left_rad, STANDING_SHARE))
        if parallax_rad < self.min_parallax_rad:
            agree, direction = left_rad < 3 * self.min_parallax_rad, np.full(3, np.nan)
        else:
            rotation, direction = self._travel(previous, current, rotation)
            agree = epipolar_sines(previous, current, rotation, direction) < self.tolerance_rad
        if agree.sum() < self.min_tracks:
            return None
        inliers = np.zeros(len(rays_current), dtype=bool)
        inliers[usable] = agree
        return VisualMotion(rotation=rotation, direction=direction, inliers=inliers, parallax_rad=parallax_rad)

    def _travel(
        self, previous: NDArray[np.float64], current: NDArray[np.float64], turn: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw, score on some tracks, refine the best on all, and take the best of these."""
        generator = np.random.default_rng(self.seed)
        judges = generator.permutation(len(previous))[: self.scored]
        drawn = draw_essentials(previous, current, turn, draws=self.draws, generator=generator)
        normals = previous[judges] @ drawn.transpose(0, 2, 1)  # E p, (2 draws, scored, 3)
        costs = self._cost(dot(normals, current[judges]) / np.maximum(np.sqrt(dot(normals, normals)), 1e-12))
        best: tuple[float, NDArray[np.float64], NDArray[np.float64]] | None = None
        for index in np.argsort(costs, kind="stable")[:REFINED]:
            rotation, direction = best_pose(drawn[index], previous, current, tolerance_rad=self.tolerance_rad)
            rotation, direction = refine_pose(previous, current, rotation, direction, tolerance_rad=self.tolerance_rad)
            cost = float(self._cost(epipolar_sines(previous, current, rotation, direction)))
            if best is None or cost < best[0]:
                best = cost, rotation, direction
        assert best is not None, "at least one matrix was drawn"
        return best[1], best[2]

    def _cost(self, sines: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean of squares, truncated at the tolerance."""
        return np.asarray(np.minimum((sines / self.tolerance_rad) ** 2, 1.0).mean(axis=-1))
