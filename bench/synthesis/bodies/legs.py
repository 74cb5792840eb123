"""Two-link legs and arms: the angles that bring their end to a place.

Angles of links are measured in the plane of x and z from straight down, positive when the lower end swings forward (to
x); a joint about the y axis turns the other way round, hence the minus where tables are made.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

LONGEST = 0.9995  # of the stretched length: the angle of a stretched knee changes without bound


def two_links(
    reach_xz_m: ArrayLike, upper_m: float, lower_m: float, *, bends_forward: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angles of two links from their root to a place.

    Args:
        reach_xz_m: (N, 2), m, from the root to the lower end; what lies too far away is pointed at, stretched.
        upper_m: length of the upper link.
        lower_m: length of the lower link.
        bends_forward: a human knee; an elbow bends backward.

    Returns:
        upper_rad: (N,) angle of the upper link.
        lower_rad: (N,) angle of the lower link.

    Source:
        The law of cosines.
    """
    reach = np.atleast_2d(np.asarray(reach_xz_m, dtype=np.float64))
    length = np.linalg.norm(reach, axis=1)
    shortest = abs(upper_m - lower_m) / LONGEST
    reach = reach * (np.clip(length, shortest, LONGEST * (upper_m + lower_m)) / length)[:, None]
    length = np.linalg.norm(reach, axis=1)
    opening = np.arccos((upper_m**2 + length**2 - lower_m**2) / (2 * upper_m * length))
    upper = np.arctan2(reach[:, 0], -reach[:, 1]) + (opening if bends_forward else -opening)
    knee = upper_m * np.stack([np.sin(upper), -np.cos(upper)], axis=1)
    rest = reach - knee
    return upper, np.arctan2(rest[:, 0], -rest[:, 1])


def turned_xz(vector_xz: ArrayLike, angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """A vector turned by (N,) angles, positive from down to forward and from forward to up: (N, 2)."""
    x, z = np.asarray(vector_xz, dtype=np.float64)
    cosine, sine = np.cos(angles_rad), np.sin(angles_rad)
    return np.stack([x * cosine - z * sine, x * sine + z * cosine], axis=-1)
