"""Lenses by way of a sphere, to the image from behind it: Brown's, unified (MEI), double sphere, extended unified."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field

import numpy as np
from typing_extensions import override

from bench.cameras.angular import AngularCamera
from bench.cameras.model import FocalCamera, checked_max_angle, finite_numbers, finite_pair
from bench.cameras.pinhole import BrownDistortion, PlanarCamera
from bench.errors import ShapeError
from bench.geometry import Bools, Floats


@dataclass(frozen=True, kw_only=True)
class DistortedCamera(PlanarCamera):
    """Projection on the unit sphere, then from a centre `xi` behind it, then distortion.

    The unit vector (x, y, z) goes to m = (x, y)/(z + xi), is distorted as in OpenCV's Brown model, scaled by the
    focal length and shifted to the principal point. The mapping holds while the radius of m rises with the
    angle (cos theta > -1/xi for xi > 1, > -xi otherwise) and while the distortion is one-to-one in the disc of that
    radius; never a test of z > 0.

    Attributes:
        xi: mirror parameter, >= 0; 0 is the pinhole.
        radial: (k1, k2, k3); fewer count as followed by 0.
        tangential: (p1, p2).
        max_angle_rad: field limit of the lens; None for as far as the mapping is one-to-one.
    """

    xi: float = field(init=False, default=0.0)
    radial: tuple[float, ...] = ()
    tangential: tuple[float, float] = (0.0, 0.0)
    max_angle_rad: float | None = None
    _distortion: BrownDistortion = field(init=False, repr=False, compare=False)
    _limit_rad: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (np.isfinite(self.xi) and self.xi >= 0):
            raise ShapeError(f"xi: expected a number >= 0, got {self.xi}")
        object.__setattr__(self, "radial", finite_numbers(self.radial, "radial"))
        object.__setattr__(self, "tangential", finite_pair(self.tangential, "tangential"))
        if len(self.radial) > 3:
            raise ShapeError(f"radial: expected at most three numbers k1, k2, k3, got {self.radial}")
        k1, k2, k3 = (*self.radial, 0.0, 0.0, 0.0)[:3]
        sphere_rad = np.arccos(-1.0 / self.xi) if self.xi > 1 else np.arccos(-self.xi)
        wanted_rad = min(checked_max_angle(self.max_angle_rad), float(sphere_rad))
        distortion = BrownDistortion((k1, k2, k3), self.tangential, self._radius_at(wanted_rad))
        object.__setattr__(self, "_distortion", distortion)
        object.__setattr__(self, "_limit_rad", min(wanted_rad, self._angle_at(distortion.limit)))

    @property
    @override
    def limit_angle_rad(self) -> float:
        return self._limit_rad

    @override
    def _project(self, points: Floats) -> tuple[Floats, Floats, Bools]:
        x, y, z = points[:, 0], points[:, 1], points[:, 2]
        length = np.sqrt(x * x + y * y + z * z)
        depth = z + self.xi * length
        m_x, m_y = x / depth, y / depth
        u, v = self._pixels(*self._distortion(m_x, m_y))
        valid = (z >= np.cos(self._limit_rad) * length) & (length > 0) & (depth > 0) & np.isfinite(u) & np.isfinite(v)
        return u, v, valid

    @override
    def _unproject(self, u: Floats, v: Floats, rays: Floats) -> Bools:
        m_x, m_y, valid = self._distortion.inverse(*self._plane(u, v))
        squared = m_x * m_x + m_y * m_y
        lift = (self.xi + np.sqrt(1.0 + (1.0 - self.xi**2) * squared)) / (1.0 + squared)
        rays[:, 0], rays[:, 1], rays[:, 2] = lift * m_x, lift * m_y, lift - self.xi
        return np.asarray(valid & np.isfinite(lift) & (rays[:, 2] >= np.cos(self._limit_rad) - 1e-12))

    def _radius_at(self, angle_rad: float) -> float:
        depth = np.cos(angle_rad) + self.xi
        return float(np.sin(angle_rad) / depth) if depth > 1e-9 else float("inf")

    def _angle_at(self, radius: float) -> float:
        """Angle to the optical axis of the sphere point that lands at `radius`."""
        if not np.isfinite(radius):
            return float(np.pi)
        inside = 1.0 + (1.0 - self.xi**2) * radius**2
        lift = (self.xi + np.sqrt(max(inside, 0.0))) / (1.0 + radius**2)
        return float(np.arctan2(lift * radius, lift - self.xi))


@dataclass(frozen=True, kw_only=True)
class BrownConradyCamera(DistortedCamera):
    """The pinhole with Brown's distortion: OpenCV's `plumb_bob` of four or five coefficients.

    The mapping holds for z > 0 within the cone in which the distortion is one-to-one. OpenCV's order of all five
    coefficients is k1, k2, p1, p2, k3.
    """


@dataclass(frozen=True, kw_only=True)
class UnifiedCamera(DistortedCamera):
    """The unified model (MEI); `focal` is also called gamma. The KITTI-360 tools leave out `tangential`.

    Source:
        Mei and Rives 2007; KITTI-360 and aiMotive calibrations.
    """

    xi: float = field()
    radial: tuple[float, ...] = (0.0, 0.0)


class SphereRadius:
    """`r(theta) = sin(phi) / (sqrt(beta) (alpha + (1 - alpha) cos(phi)))`, phi the angle on the last sphere.

    That sphere is moved by `xi` along the optical axis, so that tan(phi) = sin(theta) / (xi + cos(theta)), or stretched
    to an ellipsoid, tan(phi) = sqrt(beta) tan(theta). The radius rises up to cos(phi) = -(1 - alpha)/alpha for
    alpha > 1/2 and without end towards cos(phi) = -alpha/(1 - alpha) else; and phi with theta up to
    cos(theta) = -1/xi for xi > 1.

    Args:
        alpha: in [0, 1].
        xi: above -1.
        beta: above 0.
        domain: largest angle of interest.

    Attributes:
        limit: largest angle up to which the radius rises.
        top: the radius there.
    """

    def __init__(self, alpha: float, xi: float, beta: float, domain: float) -> None:
        if not 0.0 <= alpha <= 1.0:
            raise ShapeError(f"alpha: expected a number from 0 to 1, got {alpha}")
        self.alpha, self.xi, self.beta = alpha, xi, beta
        weights = alpha, 1.0 - alpha
        last = np.arccos(-min(weights) / max(weights))
        if xi > 1.0:  # phi has its largest value before
            last = np.arcsin(1.0 / xi)
        self.limit = min(float(self._angle(np.asarray(last))), domain)
        with np.errstate(divide="ignore"):
            self.top = float(self(np.asarray(self.limit))) if self.limit == domain else self._largest()

    def __call__(self, theta: Floats) -> Floats:
        """Evaluate; no check of the limit."""
        across, along = np.sqrt(self.beta) * np.sin(theta), self.xi + np.cos(theta)
        depth = self.alpha * np.hypot(across, along) + (1.0 - self.alpha) * along
        return np.asarray(across / (np.sqrt(self.beta) * depth))

    def inverse(self, radius: Floats) -> Floats:
        """theta with r(theta) = radius; beyond `top` any number."""
        squared = self.beta * radius * radius
        root = np.sqrt(np.maximum(1.0 - (2.0 * self.alpha - 1.0) * squared, 0.0))
        depth = (1.0 - self.alpha**2 * squared) / (self.alpha * root + 1.0 - self.alpha)
        return self._angle(np.arctan2(np.sqrt(squared), depth))

    def _angle(self, phi: Floats) -> Floats:
        """theta of phi: by the law of sines, or on the ellipsoid."""
        if self.xi:
            return phi + np.arcsin(np.clip(self.xi * np.sin(phi), -1.0, 1.0))
        return np.asarray(np.arctan2(np.sin(phi) / np.sqrt(self.beta), np.cos(phi)))

    def _largest(self) -> float:
        """The radius at the end of the sphere."""
        if self.xi > 1.0 and np.cos(self.limit) <= -1.0 / self.xi + 1e-12:
            return float(self(np.asarray(self.limit)))
        return 1.0 / np.sqrt(self.beta * (2.0 * self.alpha - 1.0)) if self.alpha > 0.5 else np.inf


@dataclass(frozen=True, kw_only=True)
class SphereCamera(FocalCamera, AngularCamera):
    """Base of both.

    Attributes:
        alpha: how far behind the sphere the image is taken from, 0 to 1.
        max_angle_rad: field limit of the lens; None for as far as the mapping is one-to-one.
    """

    alpha: float
    max_angle_rad: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        xi, beta = self._shape()
        radius = SphereRadius(float(self.alpha), xi, beta, checked_max_angle(self.max_angle_rad))
        self._prepare(radius, scale=self.focal, centre=self.principal_point)

    @abstractmethod
    def _shape(self) -> tuple[float, float]:
        """Shift and stretch of the sphere, checked."""


@dataclass(frozen=True, kw_only=True)
class DoubleSphereCamera(SphereCamera):
    """`u = fx x / (alpha d2 + (1 - alpha)(xi d1 + z)) + cu` with d1 = |(x, y, z)| and d2 = |(x, y, xi d1 + z)|.

    Attributes:
        xi: distance of the two spheres, above -1; 0 is the unified model.

    The limit is where the mapping stops being one-to-one, a little beyond the paper's w2.

    Source:
        Usenko, Demmel and Cremers 2018; Kalibr's `ds`, intrinsics xi, alpha, fu, fv, pu, pv.
    """

    xi: float

    @override
    def _shape(self) -> tuple[float, float]:
        if not (np.isfinite(self.xi) and self.xi > -1.0):
            raise ShapeError(f"xi: expected a number above -1, got {self.xi}")
        return float(self.xi), 1.0


@dataclass(frozen=True, kw_only=True)
class ExtendedUnifiedCamera(SphereCamera):
    """`u = fx x / (alpha d + (1 - alpha) z) + cu` with d^2 = beta (x^2 + y^2) + z^2.

    Attributes:
        beta: stretch of the sphere, above 0; 1 is the unified model.

    Source:
        Khomutenko, Garcia and Martinet 2016; Kalibr's `eucm`, intrinsics alpha, beta, fu, fv, pu, pv.
    """

    beta: float

    @override
    def _shape(self) -> tuple[float, float]:
        if not (np.isfinite(self.beta) and self.beta > 0.0):
            raise ShapeError(f"beta: expected a positive number, got {self.beta}")
        return 0.0, float(self.beta)
