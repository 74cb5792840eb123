"""Cameras whose image radius is a function of the angle to the optical axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from bench.cameras.model import CameraModel, checked_max_angle, finite_numbers, finite_pair
from bench.errors import ShapeError

NODES = 128  # a search in more costs more than the steps that they save
NODES_WITHOUT_LIMIT = 4096
NEWTON_STEPS = 2
LARGEST = 100.0  # end of the table where neither the polynomial nor its domain has one


@dataclass(frozen=True, slots=True, eq=False)
class MonotonePolynomial:
    """`f(x) = x (c0 + c1 x^step + c2 x^(2 step) + ...)` for x in [0, limit], where f' > 0.

    Attributes:
        coefficients: c0, c1, ...; c0 must be positive.
        step: 1 for every power (the radial polynomial), 2 for odd powers (Kannala-Brandt, radial distortion).
        domain: the largest x of interest; may be infinite.
        limit: first zero of the derivative, or `domain` where there is none before it.
        top: f(limit), the largest value that has an inverse.

    Raises:
        ShapeError: the polynomial does not rise at 0.
    """

    coefficients: tuple[float, ...]
    step: int
    domain: float
    limit: float = field(init=False)
    top: float = field(init=False)
    _nodes: NDArray[np.float64] = field(init=False, repr=False)
    _values: NDArray[np.float64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.coefficients).all() and self.coefficients[0] > 0):
            raise ShapeError(
                f"camera model: expected finite coefficients with a positive linear term, got {self.coefficients}"
            )
        object.__setattr__(self, "limit", min(self._first_fold(), self.domain))
        nodes = self._table_nodes()
        object.__setattr__(self, "_nodes", nodes)
        object.__setattr__(self, "_values", self(nodes))
        object.__setattr__(self, "top", float(self._values[-1]) if np.isfinite(self.limit) else np.inf)

    def __call__(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Evaluate; no check of the limit."""
        power = x if self.step == 1 else x * x
        return x * _horner(self.coefficients, power)

    def derivative(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Slope at `x`."""
        power = x if self.step == 1 else x * x
        return _horner([c * (1 + self.step * i) for i, c in enumerate(self.coefficients)], power)

    def inverse(self, y: NDArray[np.float64]) -> NDArray[np.float64]:
        """x with f(x) = y, by table and Newton's method; clamped to [0, limit].

        Beyond f(limit) the result is the limit: the caller marks it as not valid.
        """
        if len(self.coefficients) == 1:
            return np.minimum(y / self.coefficients[0], self.limit)
        x = np.interp(y, self._values, self._nodes)
        for _ in range(NEWTON_STEPS):
            with np.errstate(divide="ignore", invalid="ignore"):
                x -= (self(x) - y) / self.derivative(x)
            np.clip(x, 0.0, self.limit, out=x)
        return x

    def _table_nodes(self) -> NDArray[np.float64]:
        """Nodes of the table, denser towards the limit: where the polynomial folds, its inverse rises ever steeper."""
        if self.limit > LARGEST:
            return np.linspace(0.0, LARGEST, NODES_WITHOUT_LIMIT)
        return self.limit * (1.0 - np.linspace(1.0, 0.0, NODES) ** 2)

    def _first_fold(self) -> float:
        slope = [c * (1 + self.step * i) for i, c in enumerate(self.coefficients)]
        roots = np.polynomial.Polynomial(slope).roots()
        real = roots[np.abs(roots.imag) < 1e-9 * np.maximum(1.0, np.abs(roots.real))].real
        positive = real[real > 0]
        return float(positive.min()) ** (1.0 / self.step) if positive.size else float("inf")


def _horner(coefficients: tuple[float, ...] | list[float], x: NDArray[np.float64]) -> NDArray[np.float64]:
    total = np.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        total *= x
        total += coefficient
    return total


class Radius(Protocol):
    """Image radius as a function of the angle to the optical axis."""

    @property
    def limit(self) -> float:
        """Largest angle at which it rises."""
        ...

    @property
    def top(self) -> float:
        """The radius there; may be infinite."""
        ...

    def __call__(self, theta: NDArray[np.float64], /) -> NDArray[np.float64]:
        """Evaluate; anything beyond `limit`."""
        ...

    def inverse(self, radius: NDArray[np.float64], /) -> NDArray[np.float64]:
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
    def _project(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
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
    def _unproject(
        self, u: NDArray[np.float64], v: NDArray[np.float64], rays: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
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
class KannalaBrandtCamera(AngularCamera):
    """`r(theta) = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)`, times the focal length.

    Attributes:
        focal: (fx, fy), px.
        coefficients: k1 ... k4; any number of them, none for the equidistant lens.
        max_angle_rad: field limit of the lens; None for as far as the polynomial rises.

    Source:
        Kannala and Brandt 2006; OpenCV's `fisheye` module, without its restriction to z > 0.
    """

    focal: tuple[float, float]
    coefficients: tuple[float, ...]
    max_angle_rad: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "focal", finite_pair(self.focal, "focal", positive=True))
        object.__setattr__(self, "coefficients", finite_numbers(self.coefficients, "coefficients"))
        radius = MonotonePolynomial((1.0, *self.coefficients), 2, checked_max_angle(self.max_angle_rad))
        self._prepare(radius, scale=self.focal, centre=self.principal_point)

    @override
    def _rescaled(self, scale_u: float, scale_v: float) -> dict[str, Any]:
        return {"focal": (self.focal[0] * scale_u, self.focal[1] * scale_v)}


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

    @classmethod
    def from_woodscape(cls, intrinsic: Mapping[str, Any]) -> Self:
        """From the `intrinsic` part of a WoodScape calibration, whose centre is an offset from the image's middle."""
        width, height = float(intrinsic["width"]), float(intrinsic["height"])
        centre = float(intrinsic["cx_offset"]) + width / 2 - 0.5, float(intrinsic["cy_offset"]) + height / 2 - 0.5
        return cls(
            width=int(width),
            height=int(height),
            coefficients=tuple(float(intrinsic[f"k{i}"]) for i in range(1, int(intrinsic["poly_order"]) + 1)),
            principal_point=centre,
            aspect_ratio=float(intrinsic["aspect_ratio"]),
        )

    @override
    def _rescaled(self, scale_u: float, scale_v: float) -> dict[str, Any]:
        return {
            "coefficients": tuple(a * scale_u for a in self.coefficients),
            "aspect_ratio": self.aspect_ratio * scale_v / scale_u,
        }
