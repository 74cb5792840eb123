"""Essential matrices of rays: drawn from a few of them, and taken apart into rotation and direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.geometry import cross, dot, normalise

EIGHT = 8


def draw_essentials(
    rays_previous: NDArray[np.float64],
    rays_current: NDArray[np.float64],
    turn: NDArray[np.float64],
    *,
    draws: int,
    generator: np.random.Generator,
) -> NDArray[np.float64]:
    """Essential matrices E with p'.E p = 0, from random sets of tracks.

    One for each set of eight tracks, which assumes nothing but fails where all eight lie on one plane; and one for the
    first two tracks of each set, which takes the rotation as given and so has an answer on a road, too.

    Args:
        rays_previous: (N, 3) float64, unit rays p, N >= 8.
        rays_current: (N, 3) float64, unit rays p'.
        turn: (3, 3) float64, rotation current_from_previous as far as it is known.
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
    planes = cross(previous[:, :2] @ turn.T, current[:, :2])
    return np.concatenate([general, _skew(normalise(np.nan_to_num(cross(planes[:, 0], planes[:, 1])) + 1e-12)) @ turn])


def epipolar_sines(
    rays_previous: NDArray[np.float64],
    rays_current: NDArray[np.float64],
    rotation: NDArray[np.float64],
    direction: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Sine of the angle between each current ray and the epipolar plane of its previous one; (N,) float64, >= 0."""
    normals = normalise(cross(np.broadcast_to(direction, rays_previous.shape), rays_previous @ rotation.T))
    return np.abs(np.nan_to_num(dot(normals, rays_current)))


def best_pose(
    essential: NDArray[np.float64],
    rays_previous: NDArray[np.float64],
    rays_current: NDArray[np.float64],
    *,
    tolerance_rad: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
    turns = [left @ w @ right for w in (quarter, quarter.T)]
    poses = [(turn * np.sign(np.linalg.det(turn)), sign * left[:, 2]) for turn in turns for sign in (1.0, -1.0)]
    votes = [_vote(rays_previous @ turn.T, rays_current, t, tolerance_rad=tolerance_rad) for turn, t in poses]
    return poses[int(np.argmax(votes))]


def _vote(
    turned: NDArray[np.float64], rays_current: NDArray[np.float64], t: NDArray[np.float64], *, tolerance_rad: float
) -> float:
    """Parallax of the tracks whose rays `a q + t` and `b p'` meet at a, b > 0."""
    translation = np.broadcast_to(t, turned.shape)
    plane = cross(turned, rays_current)
    front_current = dot(cross(turned, translation), plane) > 0  # b (q x p') = q x t
    front_previous = dot(cross(rays_current, translation), plane) > 0  # a (p' x q) = -(p' x t)
    parallax = np.sqrt(dot(plane, plane))
    near = epipolar_sines(turned, rays_current, np.eye(3), t) < tolerance_rad
    return float(np.minimum(parallax, 10 * tolerance_rad)[front_current & front_previous & near].sum())


def _skew(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, z = np.moveaxis(vectors, -1, 0)
    nothing = np.zeros_like(x)
    rows = [[nothing, -z, y], [z, nothing, -x], [-y, x, nothing]]
    return np.moveaxis(np.array(rows), -1, 0)
