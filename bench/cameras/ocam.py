"""Scaramuzza's model: the ray of a pixel by a polynomial, as OCamCalib and MATLAB calibrate it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from typing_extensions import override

from bench.cameras.angular import AngularCamera
from bench.cameras.model import checked_max_angle, finite_numbers
from bench.errors import ShapeError

NODES = 1024
NEWTON_STEPS = 4
FARTHEST = 100.0  # times |a0|: the radius of an angle near that of an endless image


@dataclass(frozen=True, slots=True, eq=False)
class PolynomialAngle:
    """The radius rho at which a ray of angle theta lands: `tan(theta) = rho / g(rho)`.

    The angle rises with rho while g - rho g' > 0.

    Attributes:
        depth: g, the depth of the ray whose sideways part is rho; positive at 0.
        domain: largest angle of interest.
        limit: the largest angle up to which the mapping is one-to-one.
        top: the radius there.
    """

    depth: Polynomial
    domain: float
    limit: float = field(init=False)
    top: float = field(init=False)
    _nodes: NDArray[np.float64] = field(init=False, repr=False)
    _angles: NDArray[np.float64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        roots = np.asarray((self.depth - Polynomial([0.0, 1.0]) * self.depth.deriv()).trim().roots(), dtype=complex)
        folds = roots[(np.abs(roots.imag) < 1e-9 * np.maximum(1.0, np.abs(roots))) & (roots.real > 0)].real
        end = min([*folds, FARTHEST * float(self.depth(0.0))])
        nodes = end * (1.0 - np.linspace(1.0, 0.0, NODES) ** 2)
        object.__setattr__(self, "_nodes", nodes)
        object.__setattr__(self, "_angles", self.inverse(nodes))
        object.__setattr__(self, "limit", min(float(self._angles[-1]), self.domain))
        object.__setattr__(self, "top", float(self(np.array([self.limit]))[0]))

    def __call__(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        """rho, by table and Newton's method, clamped to where the mapping is one-to-one."""
        rho, slope = np.interp(theta, self._angles, self._nodes), self.depth.deriv()
        sine, cosine = np.sin(theta), np.cos(theta)
        for _ in range(NEWTON_STEPS):
            with np.errstate(divide="ignore", invalid="ignore"):
                step = (rho * cosine - self.depth(rho) * sine) / (cosine - slope(rho) * sine)
            rho = np.clip(rho - np.nan_to_num(step, posinf=0.0, neginf=0.0), 0.0, self._nodes[-1])
        return rho

    def inverse(self, rho: NDArray[np.float64]) -> NDArray[np.float64]:
        """The angle of a radius."""
        return np.asarray(np.arctan2(rho, self.depth(rho)))


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
    def _project(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        x, y, valid = super()._project(points)
        a, b, c, d = self.stretch
        return a * x + b * y + self.principal_point[0], c * x + d * y + self.principal_point[1], valid

    @override
    def _unproject(
        self, u: NDArray[np.float64], v: NDArray[np.float64], rays: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        x, y = u - self.principal_point[0], v - self.principal_point[1]
        a, b, c, d = self._inverse
        return super()._unproject(a * x + b * y, c * x + d * y, rays)

    @override
    def _rescaled(self, scale_u: float, scale_v: float) -> dict[str, Any]:
        a, b, c, d = self.stretch
        return {"stretch": (a * scale_u, b * scale_u, c * scale_v, d * scale_v)}
