"""Cameras whose image radius is a function of the angle to the optical axis, or the angle one of the radius (OCam)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.polynomial import Polynomial
from typing_extensions import override

from bench.cameras.model import CameraModel, FocalCamera, checked_max_angle, finite_numbers
from bench.errors import ShapeError
from bench.geometry import Bools, Floats

NODES = 128  # a search in more costs more than the steps that they save
NODES_WITHOUT_LIMIT = 4096
NEWTON_STEPS = 2
LARGEST = 100.0  # end of the table where neither the polynomial nor its domain has one


class MonotonePolynomial:
    """`f(x) = x (c0 + c1 x^step + c2 x^(2 step) + ...)` for x in [0, limit], where f' > 0.

    Args:
        coefficients: c0, c1, ...; c0 must be positive.
        step: 1 for every power (the radial polynomial), 2 for odd powers (Kannala-Brandt, radial distortion).
        domain: the largest x of interest; may be infinite.

    Attributes:
        limit: first zero of the derivative, or `domain` where there is none before it.
        top: f(limit), the largest value that has an inverse.

    Raises:
        ShapeError: the polynomial does not rise at 0.
    """

    def __init__(self, coefficients: Sequence[float], step: int, domain: float) -> None:
        if not (np.isfinite(coefficients).all() and coefficients[0] > 0):
            raise ShapeError(
                f"camera model: expected finite coefficients with a positive linear term, got {coefficients}"
            )
        self._coefficients, self._step = coefficients, step
        self._slopes = [c * (1 + step * i) for i, c in enumerate(coefficients)]
        fold = min(positive_roots(Polynomial(self._slopes)), default=np.inf) ** (1.0 / step)
        self.limit: float = min(fold, domain)
        if self.limit > LARGEST:
            self._nodes: Floats = np.linspace(0.0, LARGEST, NODES_WITHOUT_LIMIT)
        else:  # denser towards the limit: where the polynomial folds, its inverse rises ever steeper
            self._nodes = self.limit * (1.0 - np.linspace(1.0, 0.0, NODES) ** 2)
        self._values = self(self._nodes)
        self.top = float(self._values[-1]) if np.isfinite(self.limit) else np.inf

    def __call__(self, x: Floats) -> Floats:
        """Evaluate; no check of the limit."""
        return x * _horner(self._coefficients, x if self._step == 1 else x * x)

    def inverse(self, y: Floats) -> Floats:
        """x with f(x) = y, by table and Newton's method; clamped to [0, limit].

        Beyond f(limit) the result is the limit: the caller marks it as not valid.
        """
        if len(self._coefficients) == 1:
            return np.minimum(y / self._coefficients[0], self.limit)
        x = np.interp(y, self._values, self._nodes)
        for _ in range(NEWTON_STEPS):
            slope = _horner(self._slopes, x if self._step == 1 else x * x)
            with np.errstate(divide="ignore", invalid="ignore"):
                x -= (self(x) - y) / slope
            np.clip(x, 0.0, self.limit, out=x)
        return x


def _horner(coefficients: Sequence[float], x: Floats) -> Floats:
    total = np.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        total *= x
        total += coefficient
    return total


def positive_roots(polynomial: Polynomial) -> list[float]:
    """The real roots above 0, those of multiplicity two among them, whose imaginary parts are rounding."""
    roots = np.asarray(polynomial.trim().roots(), dtype=np.complex128)
    real = roots[np.abs(roots.imag) < 1e-9 * np.maximum(1.0, np.abs(roots))].real
    return [float(root) for root in real[real > 0]]


class Radius(Protocol):
    """Image radius as a function of the angle to the optical axis.

    Attributes:
        limit: largest angle at which it rises.
        top: the radius there; may be infinite.
    """

    limit: float
    top: float

    def __call__(self, theta: Floats, /) -> Floats:
        """Evaluate; anything beyond `limit`."""
        ...

    def inverse(self, radius: Floats, /) -> Floats:
        """The angle of a radius; anything beyond `top`."""
        ...


@dataclass(frozen=True, kw_only=True)
class AngularCamera(CameraModel):
    """Base of `u = scale_u r(theta) x/chi + cu`, `v = scale_v r(theta) y/chi + cv` with chi = hypot(x, y)."""

    _radius: Radius = field(init=False, repr=False, compare=False)
    _scale: tuple[float, float] = field(init=False, repr=False, compare=False)
    _centre: tuple[float, float] = field(init=False, repr=False, compare=False)

    def _prepare(self, radius: Radius, *, scale: tuple[float, float], centre: tuple[float, float]) -> None:
        object.__setattr__(self, "_radius", radius)
        object.__setattr__(self, "_scale", scale)
        object.__setattr__(self, "_centre", centre)

    @property
    @override
    def limit_angle_rad(self) -> float:
        return self._radius.limit

    @override
    def _project(self, points: Floats) -> tuple[Floats, Floats, Bools]:
        x, y, z = points[:, 0], points[:, 1], points[:, 2]
        chi = np.hypot(x, y)
        theta = np.arctan2(chi, z)
        stretch = self._radius(theta) / chi
        stretch[chi == 0] = 0.0  # the optical axis itself
        u = x * (stretch * self._scale[0]) + self._centre[0]
        v = y * (stretch * self._scale[1]) + self._centre[1]
        valid = (theta <= self._radius.limit) & np.isfinite(u) & np.isfinite(v) & ((chi > 0) | (z > 0))
        return u, v, valid

    @override
    def _unproject(self, u: Floats, v: Floats, rays: Floats) -> Bools:
        x = (u - self._centre[0]) / self._scale[0]
        y = (v - self._centre[1]) / self._scale[1]
        radius = np.sqrt(x * x + y * y)  # a quarter of the time of `hypot`; pixels do not overflow
        theta = self._radius.inverse(radius)
        stretch = np.sin(theta) / radius
        stretch[radius == 0] = 0.0
        rays[:, 0] = x * stretch
        rays[:, 1] = y * stretch
        rays[:, 2] = np.cos(theta)
        return np.asarray(radius <= self._radius.top)


@dataclass(frozen=True, kw_only=True)
class KannalaBrandtCamera(FocalCamera, AngularCamera):
    """`r(theta) = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)`, times the focal length.

    Attributes:
        coefficients: k1 ... k4; any number of them, none for the equidistant lens.
        max_angle_rad: field limit of the lens; None for as far as the polynomial rises.

    Source:
        Kannala and Brandt 2006; OpenCV's `fisheye` module, without its restriction to z > 0.
    """

    coefficients: tuple[float, ...]
    max_angle_rad: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "coefficients", finite_numbers(self.coefficients, "coefficients"))
        radius = MonotonePolynomial((1.0, *self.coefficients), 2, checked_max_angle(self.max_angle_rad))
        self._prepare(radius, scale=self.focal, centre=self.principal_point)


@dataclass(frozen=True, kw_only=True)
class RadialPolynomialCamera(AngularCamera):
    """`r(theta) = a1 theta + a2 theta^2 + a3 theta^3 + a4 theta^4` in pixels.

    Attributes:
        coefficients: a1 ... a4, px/rad^n; any number of them.
        aspect_ratio: stretch of v against u.
        max_angle_rad: field limit of the lens; None for as far as the polynomial rises.

    Source:
        Mariotti and Eising 2020, section II-B; WoodScape's calibration readme for the aspect ratio.
    """

    coefficients: tuple[float, ...]
    aspect_ratio: float = 1.0
    max_angle_rad: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "coefficients", finite_numbers(self.coefficients, "coefficients"))
        if not (np.isfinite(self.aspect_ratio) and self.aspect_ratio > 0):
            raise ShapeError(f"aspect_ratio: expected a positive number, got {self.aspect_ratio}")
        radius = MonotonePolynomial(self.coefficients, 1, checked_max_angle(self.max_angle_rad))
        self._prepare(radius, scale=(1.0, self.aspect_ratio), centre=self.principal_point)

    @override
    def _rescaled(self, scale_u: float, scale_v: float) -> dict[str, Any]:
        return {
            "coefficients": tuple(a * scale_u for a in self.coefficients),
            "aspect_ratio": self.aspect_ratio * scale_v / scale_u,
        }


ANGLE_NODES = 1024
ANGLE_STEPS = 4
FARTHEST = 100.0  # times |a0|: the radius of an angle near that of an endless image


class PolynomialAngle:
    """The radius rho at which a ray of angle theta lands: `tan(theta) = rho / g(rho)`.

    The angle rises with rho while g - rho g' > 0.

    Args:
        depth: g, the depth of the ray whose sideways part is rho; positive at 0.
        domain: largest angle of interest.

    Attributes:
        limit: the largest angle up to which the mapping is one-to-one.
        top: the radius there.
    """

    def __init__(self, depth: Polynomial, domain: float) -> None:
        self._depth, self._slope = depth, depth.deriv()
        folds = positive_roots(depth - Polynomial([0.0, 1.0]) * self._slope)
        end = min([*folds, FARTHEST * float(depth(0.0))])
        self._nodes = end * (1.0 - np.linspace(1.0, 0.0, ANGLE_NODES) ** 2)
        self._angles = self.inverse(self._nodes)
        self.limit = min(float(self._angles[-1]), domain)
        self.top = float(self(np.array([self.limit]))[0])

    def __call__(self, theta: Floats) -> Floats:
        """rho, by table and Newton's method, clamped to where the mapping is one-to-one."""
        rho = np.interp(theta, self._angles, self._nodes)
        sine, cosine = np.sin(theta), np.cos(theta)
        for _ in range(ANGLE_STEPS):
            with np.errstate(divide="ignore", invalid="ignore"):
                step = (rho * cosine - self._depth(rho) * sine) / (cosine - self._slope(rho) * sine)
            rho = np.clip(rho - np.nan_to_num(step, posinf=0.0, neginf=0.0), 0.0, self._nodes[-1])
        return rho

    def inverse(self, rho: Floats) -> Floats:
        """The angle of a radius."""
        return np.asarray(np.arctan2(rho, self._depth(rho)))


@dataclass(frozen=True, kw_only=True)
class OcamCamera(AngularCamera):
    """The pixel (u, v) = stretch (u', v') + centre sees the ray (u', v', a0 + a1 rho + ...), rho = |(u', v')|.

    The depth counts as positive on the axis: OCamCalib's cameras look along -z, so that its a0 is negative.

    Attributes:
        coefficients: a0, a1, ..., px^(1 - n); MATLAB's mapping coefficients have no a1, which is 0.
        stretch: a, b, c, d of u = a u' + b v' + cu, v = c u' + d v' + cv: (1, e, d, c) of OCamCalib, whose x is our v,
            and (c, d, e, 1) of MATLAB.
        max_angle_rad: field limit of the lens; None for as far as the mapping is one-to-one.

    Source:
        Scaramuzza, Martinelli and Siegwart 2006; the toolbox's `cam2world` and `world2cam`.
    """

    coefficients: tuple[float, ...]
    stretch: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 1.0)
    max_angle_rad: float | None = None
    _inverse: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        numbers = finite_numbers(self.coefficients, "coefficients")
        object.__setattr__(self, "coefficients", numbers)
        if not numbers or not numbers[0]:
            raise ShapeError(f"coefficients: expected a0 other than 0 first, got {numbers}")
        stretch = finite_numbers(self.stretch, "stretch")
        matrix = np.array(stretch).reshape(2, 2) if len(stretch) == 4 else np.zeros((2, 2))
        if not np.linalg.det(matrix) > 0:
            raise ShapeError(f"stretch: expected four numbers of a matrix that mirrors nothing, got {stretch}")
        object.__setattr__(self, "stretch", stretch)
        object.__setattr__(self, "_inverse", tuple(np.linalg.inv(matrix).ravel().tolist()))
        angle = PolynomialAngle(Polynomial(numbers) * np.sign(numbers[0]), checked_max_angle(self.max_angle_rad))
        self._prepare(angle, scale=(1.0, 1.0), centre=(0.0, 0.0))

    @override
    def _project(self, points: Floats) -> tuple[Floats, Floats, Bools]:
        x, y, valid = super()._project(points)
        a, b, c, d = self.stretch
        return a * x + b * y + self.principal_point[0], c * x + d * y + self.principal_point[1], valid

    @override
    def _unproject(self, u: Floats, v: Floats, rays: Floats) -> Bools:
        x, y = u - self.principal_point[0], v - self.principal_point[1]
        a, b, c, d = self._inverse
        return super()._unproject(a * x + b * y, c * x + d * y, rays)

    @override
    def _rescaled(self, scale_u: float, scale_v: float) -> dict[str, Any]:
        a, b, c, d = self.stretch
        return {"stretch": (a * scale_u, b * scale_u, c * scale_v, d * scale_v)}
