"""Visual odometry from two views: rotation and direction of translation, never its length.

Everything is measured on unit rays, so rays beyond 90 degrees count like all others; the usual essential matrix on a
plane z = 1 cannot hold them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from bench.errors import ShapeError, UsageError
from bench.geometry import Bools, Floats, angle_between, cross, dot, normalise

EIGHT = 8  # tracks that give an essential matrix
ROUNDS = 15  # of weighted least squares, at most
CONVERGED_RAD = 1e-7
STATIONARY_SHARE = 0.75  # tracks without parallax of a stationary camera; the rest may be on moving objects
REFINED = 3  # of the drawn matrices, the best, since the best of a draw need not lie nearest to the best of all


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VisualMotion:
    """Motion of a camera, as far as its images show it.

    Attributes:
        rotation: (3, 3) float64, current_from_previous.
        direction: (3,) float64, unit vector of t = C - C' in the current camera frame, the previous centre seen from
            the current camera; NaN where the camera is stationary or only rotates.
        inliers: (N,) bool; tracks that agree with it.
    """

    rotation: Floats
    direction: Floats
    inliers: Bools

    @property
    def moves(self) -> bool:
        """True where there is a direction."""
        return bool(np.isfinite(self.direction).all())


def draw_essentials(
    rays_previous: Floats,
    rays_current: Floats,
    rotation: Floats,
    *,
    draws: int,
    generator: np.random.Generator,
) -> Floats:
    """Essential matrices E with p'.E p = 0, from random sets of tracks.

    One for each set of eight tracks, which assumes nothing but fails where all eight lie on one plane; and one for the
    first two tracks of each set, which takes the rotation as given and so has an answer on a road, too.

    Args:
        rays_previous: (N, 3) float64, unit rays p, N >= 8.
        rays_current: (N, 3) float64, unit rays p'.
        rotation: (3, 3) float64, current_from_previous as far as it is known.
        draws: sets of tracks.
        generator: of random numbers.

    Returns:
        (2 * draws, 3, 3) float64, each with singular values (1, 1, 0).

    Source:
        Longuet-Higgins 1981; Hartley and Zisserman, section 11.2; unit rays need no
        normalisation.
    """
    chosen = generator.random((draws, len(rays_current))).argpartition(EIGHT - 1, axis=1)[:, :EIGHT]
    previous, current = rays_previous[chosen], rays_current[chosen]
    rows = (current[..., :, None] * previous[..., None, :]).reshape(draws, EIGHT, 9)
    general = np.linalg.svd(rows)[2][:, -1].reshape(draws, 3, 3)
    left, _, right = np.linalg.svd(general)
    general = left @ np.diag([1.0, 1.0, 0.0]) @ right
    planes = cross(previous[:, :2] @ rotation.T, current[:, :2])
    direction = normalise(np.nan_to_num(cross(planes[:, 0], planes[:, 1])) + 1e-12)
    return np.concatenate([general, _skew(direction) @ rotation])


def epipolar_sines(rays_previous: Floats, rays_current: Floats, rotation: Floats, direction: Floats) -> Floats:
    """Sine of the angle between each current ray and the epipolar plane of its previous one; (N,) float64, >= 0."""
    normals = normalise(cross(np.broadcast_to(direction, rays_previous.shape), rays_previous @ rotation.T))
    return np.abs(np.nan_to_num(dot(normals, rays_current)))


def best_pose(
    essential: Floats,
    rays_previous: Floats,
    rays_current: Floats,
    *,
    tolerance_rad: float,
) -> tuple[Floats, Floats]:
    """Of the four poses of an essential matrix, the one that sees most in front of it.

    "In front" means along the rays, in both views, whichever way the camera looks. A track counts by its parallax, up
    to ten times the tolerance, since the depth of a far point has the sign of its noise.

    Returns:
        rotation (3, 3) and direction (3,), a unit vector, both current_from_previous.

    Source:
        Hartley and Zisserman, result 9.19.
    """
    left, _, right = np.linalg.svd(essential)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rotations = [left @ w @ right for w in (quarter, quarter.T)]
    poses = [(r * np.sign(np.linalg.det(r)), sign * left[:, 2]) for r in rotations for sign in (1.0, -1.0)]
    votes = [_vote(rays_previous @ r.T, rays_current, t, tolerance_rad=tolerance_rad) for r, t in poses]
    return poses[int(np.argmax(votes))]


def _vote(q: Floats, rays_current: Floats, t: Floats, *, tolerance_rad: float) -> float:
    """Parallax of the tracks whose rays `a q + t` and `b p'` meet at a, b > 0."""
    translation = np.broadcast_to(t, q.shape)
    plane = cross(q, rays_current)
    front_current = dot(cross(q, translation), plane) > 0  # b (q x p') = q x t
    front_previous = dot(cross(rays_current, translation), plane) > 0  # a (p' x q) = -(p' x t)
    parallax = np.sqrt(dot(plane, plane))
    near = epipolar_sines(q, rays_current, np.eye(3), t) < tolerance_rad
    return float(np.minimum(parallax, 10 * tolerance_rad)[front_current & front_previous & near].sum())


def _skew(vectors: Floats) -> Floats:
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.moveaxis(np.array(rows), -1, 0)


def fit_rotation(rays_previous: Floats, rays_current: Floats, *, tolerance_rad: float) -> Floats:
    """The rotation that brings previous rays nearest to current ones.

    Weighted least squares, repeated with Cauchy's weights, whose scale is the median of what is left, but not less
    than half the tolerance.

    Returns:
        (3, 3) float64, current_from_previous.

    Source:
        Kabsch 1976.
    """
    weights = np.ones(len(rays_current))
    rotation = np.eye(3)
    for _ in range(ROUNDS):
        left, _, right = np.linalg.svd((weights[:, None] * rays_current).T @ rays_previous)
        new = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        moved_rad = float(np.linalg.norm(new - rotation))
        rotation = new
        if moved_rad < CONVERGED_RAD:
            break
        angles_rad = angle_between(rays_previous @ rotation.T, rays_current)
        scale_rad = max(float(np.median(angles_rad)), tolerance_rad / 2)
        weights = 1.0 / (1.0 + (angles_rad / scale_rad) ** 2)
    return rotation


def refine_pose(
    rays_previous: Floats,
    rays_current: Floats,
    rotation: Floats,
    direction: Floats,
    *,
    tolerance_rad: float,
) -> tuple[Floats, Floats]:
    """Gauss-Newton on the sine of the angle to the epipolar plane, over the five unknowns of rotation and direction.

    Tukey's weights leave out what lies beyond the tolerance; its first rounds are three times as wide.

    Returns:
        rotation (3, 3) and direction (3,), a unit vector, current_from_previous.
    """
    for number in range(ROUNDS):
        cut_rad = tolerance_rad * (3.0 if number < ROUNDS // 3 else 1.0)
        q = rays_previous @ rotation.T
        plane = cross(q, rays_current)
        length = np.linalg.norm(cross(np.broadcast_to(direction, q.shape), q), axis=1)
        scale = 1.0 / np.maximum(length, 1e-3)  # next to the epipole there is no plane
        off = (plane @ direction) * scale
        weights = np.maximum(1.0 - (off / cut_rad) ** 2, 0.0) ** 2
        # s = t.(q x p') changes by dw.((t.q) p' - (q.p') t) when q rotates by dw, and by dt.(q x p') when t moves.
        by_rotation = (q @ direction)[:, None] * rays_current - dot(q, rays_current)[:, None] * direction
        across = _tangents(direction)
        slopes = np.hstack([by_rotation, plane @ across.T]) * scale[:, None]
        weighted = slopes * weights[:, None]
        step = np.linalg.lstsq(weighted.T @ slopes, -weighted.T @ off, rcond=1e-12)[0]
        rotation = Rotation.from_rotvec(step[:3]).as_matrix() @ rotation
        direction = normalise(direction + step[3:] @ across)
        if np.abs(step).max() < CONVERGED_RAD and number > ROUNDS // 3:
            break
    return rotation, direction


def _tangents(direction: Floats) -> Floats:
    """Two unit vectors across a direction: (2, 3)."""
    axis = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = normalise(cross(direction, axis))
    return np.stack([first, cross(direction, first)])


@dataclass(frozen=True, slots=True, kw_only=True)
class VisualOdometry:
    """Estimates rotation and direction from tracks of a scene that is mostly static.

    Attributes:
        tolerance_rad: a track agrees that lies this close to its epipolar plane; 0.33 px at 165 px per radian.
        min_parallax_rad: the camera counts as stationary, or only rotating, where a pure rotation leaves less than this
            angle on three quarters of the tracks: a direction would be that of the noise, or of what moves. 0.25 px at
            165 px per radian.
        draws: sets of eight tracks that are tried.
        scored: tracks that a drawn matrix is scored on.
        min_tracks: fewer tracks, or fewer that agree, give no motion.
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

    def __call__(self, rays_previous: Floats, rays_current: Floats) -> VisualMotion | None:
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
        if np.quantile(left_rad, STATIONARY_SHARE) < self.min_parallax_rad:
            agree, direction = left_rad < 3 * self.min_parallax_rad, np.full(3, np.nan)
        else:
            rotation, direction = self._travel(previous, current, rotation)
            agree = epipolar_sines(previous, current, rotation, direction) < self.tolerance_rad
        if agree.sum() < self.min_tracks:
            return None
        inliers = np.zeros(len(rays_current), dtype=bool)
        inliers[usable] = agree
        return VisualMotion(rotation=rotation, direction=direction, inliers=inliers)

    def _travel(self, previous: Floats, current: Floats, rotation: Floats) -> tuple[Floats, Floats]:
        """Draw, score on some tracks, refine the best on all, and take the best of these."""
        generator = np.random.default_rng(self.seed)
        scored = generator.permutation(len(previous))[: self.scored]
        drawn = draw_essentials(previous, current, rotation, draws=self.draws, generator=generator)
        normals = previous[scored] @ drawn.transpose(0, 2, 1)  # E p, (2 draws, scored, 3)
        costs = self._cost(dot(normals, current[scored]) / np.maximum(np.sqrt(dot(normals, normals)), 1e-12))
        best: tuple[float, Floats, Floats] | None = None
        for index in np.argsort(costs, kind="stable")[:REFINED]:
            rotation, direction = best_pose(drawn[index], previous, current, tolerance_rad=self.tolerance_rad)
            rotation, direction = refine_pose(previous, current, rotation, direction, tolerance_rad=self.tolerance_rad)
            cost = float(self._cost(epipolar_sines(previous, current, rotation, direction)))
            if best is None or cost < best[0]:
                best = cost, rotation, direction
        assert best is not None, "at least one matrix was drawn"
        return best[1], best[2]

    def _cost(self, sines: Floats) -> Floats:
        """Mean of squares, truncated at the tolerance."""
        return np.asarray(np.minimum((sines / self.tolerance_rad) ** 2, 1.0).mean(axis=-1))
