"""Lenses that map a ray to a plane, then stretch the plane to pixels: the pinhole; and Brown's distortion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from typing_extensions import override

from bench.cameras.angular import MonotonePolynomial, positive_roots
from bench.cameras.model import FocalCamera
from bench.errors import ShapeError
from bench.geometry import Bools, Floats


@dataclass(frozen=True, kw_only=True)
class PlanarCamera(FocalCamera):
    """`u = fx x + cu`, `v = fy y + cv` for the point (x, y) of the plane to which the lens maps a ray."""

    def _pixels(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """u and v of points of the plane."""
        return self.focal[0] * x + self.principal_point[0], self.focal[1] * y + self.principal_point[1]

    def _plane(self, u: Floats, v: Floats) -> tuple[Floats, Floats]:
        """x and y of pixels."""
        return (u - self.principal_point[0]) / self.focal[0], (v - self.principal_point[1]) / self.focal[1]


@dataclass(frozen=True, kw_only=True)
class PinholeCamera(PlanarCamera):
    """The undistorted pinhole, for rectified images: `x/z`, `y/z` for z > 0."""

    @property
    @override
    def limit_angle_rad(self) -> float:
        return float(np.pi / 2)

    @override
    def _project(self, points: Floats) -> tuple[Floats, Floats, Bools]:
        z = points[:, 2]
        u, v = self._pixels(points[:, 0] / z, points[:, 1] / z)
        return u, v, (z > 0) & np.isfinite(u) & np.isfinite(v)

    @override
    def _unproject(self, u: Floats, v: Floats, rays: Floats) -> Bools:
        x, y = self._plane(u, v)
        z = 1.0 / np.sqrt(x * x + y * y + 1.0)
        rays[:, 0], rays[:, 1], rays[:, 2] = x * z, y * z, z
        return np.isfinite(u) & np.isfinite(v)


NEWTON_STEPS = 20  # two or three suffice but at the very limit, where the slope is 0
CONVERGED = 1e-13  # change of a coordinate, in focal lengths
LARGEST = 1e9  # coefficient; products of such stay finite
SOLVED = 1e-10  # miss of a solution, in focal lengths: a ten-thousandth of a pixel for the longest lens


class BrownDistortion:
    """Radial and tangential distortion of points (x, y) of the plane at distance 1.

    With r^2 = x^2 + y^2 the point goes to x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and
    y (...) + p1 (r^2 + 2 y^2) + 2 p2 x y. This is the gradient of a function of x and y, so that the mapping is
    one-to-one on a disc wherever its symmetric matrix of derivatives is positive definite in all of it. In the
    directions along and across the radius that matrix is

        [[A + 6 R c, -2 R s], [-2 R s, B + 2 R c]],  A = 1 + 3 k1 r^2 + 5 k2 r^4 + 7 k3 r^6,  B = 1 + k1 r^2 + ...,

    with R = r |(p1, p2)|, and c, s cosine and sine of the angle to (p2, p1). Over all angles its determinant is least
    at c = -1, with zeros at A = 6 R and B = 2 R, or, where A + 3 B < 16 R, at c = -(A + 3 B) / (16 R), with a zero at
    (A - B)(A - 9 B) + 64 R^2 = 0. The first of these zeros is the limit.

    Args:
        radial: (k1, k2, k3).
        tangential: (p1, p2).
        domain: largest radius of interest; may be infinite.

    Attributes:
        limit: radius of the largest disc in `domain` on which the mapping is one-to-one.

    Raises:
        ShapeError: a coefficient beyond 1e9.

    Source:
        Brown 1966; OpenCV's `projectPoints` with five coefficients.
    """

    def __init__(self, radial: tuple[float, float, float], tangential: tuple[float, float], domain: float) -> None:
        if max(map(abs, (*radial, *tangential))) > LARGEST:
            raise ShapeError(f"distortion: expected coefficients up to {LARGEST:g}, got {radial, tangential}")
        self._radial, self._tangential = radial, tangential
        self._along = MonotonePolynomial((1.0, *radial), 2, domain)
        self.limit = min(self._along.limit, self._first_fold())

    def __call__(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Distort; no check of the limit."""
        (k1, k2, k3), (p1, p2) = self._radial, self._tangential
        xx, yy, xy = x * x, y * y, x * y
        squared = xx + yy
        stretch = 1.0 + squared * (k1 + squared * (k2 + squared * k3))
        return (
            x * stretch + 2 * p1 * xy + p2 * (squared + 2 * xx),
            y * stretch + p1 * (squared + 2 * yy) + 2 * p2 * xy,
        )

    def inverse(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Bools]:
        """Undistort: the radial part alone by its inverse, then Newton's method in the plane, within the limit.

        Returns:
            x, y: of the points that are distorted to those given.
            valid: False where there is none within the limit.
        """
        radius = np.sqrt(x * x + y * y)
        shrink = self._along.inverse(radius) / radius
        shrink[radius == 0] = 1.0
        m_x, m_y = x * shrink, y * shrink
        if not any(self._tangential):
            return m_x, m_y, radius <= self._along.top
        for _ in range(NEWTON_STEPS):
            m_x, m_y = self._within(m_x, m_y)
            step_x, step_y = self._newton_step(m_x, m_y, x, y)
            m_x, m_y = m_x - step_x, m_y - step_y
            if not (np.abs(step_x) + np.abs(step_y) > CONVERGED * (1.0 + radius)).any():
                break
        miss_x, miss_y = self(m_x, m_y)
        solved = np.hypot(miss_x - x, miss_y - y) <= SOLVED * (1.0 + radius)
        return m_x, m_y, solved & (np.hypot(m_x, m_y) <= self.limit * (1.0 + 1e-9))

    def _newton_step(self, m_x: Floats, m_y: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        (k1, k2, k3), (p1, p2) = self._radial, self._tangential
        xx, yy, xy = m_x * m_x, m_y * m_y, m_x * m_y
        squared = xx + yy
        stretch = 1.0 + squared * (k1 + squared * (k2 + squared * k3))
        slope = 2.0 * k1 + squared * (4.0 * k2 + squared * 6.0 * k3)
        at_x, at_y = self(m_x, m_y)
        miss_x, miss_y = at_x - x, at_y - y
        j_xx = stretch + slope * xx + 2 * p1 * m_y + 6 * p2 * m_x
        j_xy = slope * xy + 2 * p1 * m_x + 2 * p2 * m_y
        j_yy = stretch + slope * yy + 6 * p1 * m_y + 2 * p2 * m_x
        scale = 1.0 / (j_xx * j_yy - j_xy * j_xy)
        return scale * (j_yy * miss_x - j_xy * miss_y), scale * (j_xx * miss_y - j_xy * miss_x)

    def _within(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Bring back to the limit what a step took beyond it."""
        if not np.isfinite(self.limit):
            return x, y
        back = np.minimum(1.0, self.limit / np.hypot(x, y))
        back[~np.isfinite(back)] = 1.0
        return x * back, y * back

    def _first_fold(self) -> float:
        """The smallest radius at which the determinant is 0 in some direction; infinite without tangential terms."""
        size = float(np.hypot(*self._tangential))
        if not size:
            return np.inf
        k1, k2, k3 = self._radial
        along = Polynomial([1.0, 0.0, 3 * k1, 0.0, 5 * k2, 0.0, 7 * k3])
        across = Polynomial([1.0, 0.0, k1, 0.0, k2, 0.0, k3])
        tilt = Polynomial([0.0, size])
        ends = [*positive_roots(along - 6 * tilt), *positive_roots(across - 2 * tilt)]
        between = positive_roots((along - across) * (along - 9 * across) + 64 * tilt**2)
        within = [radius for radius in between if float((along + 3 * across - 16 * tilt)(radius)) < 0]
        return min([*ends, *within], default=np.inf)
