"""What the lenses share whose image radius is a polynomial of the angle to the optical axis."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from bench.cameras.model import CameraModel
from bench.cameras.monotone import MonotonePolynomial


@dataclass(frozen=True, kw_only=True)
class AngularCamera(CameraModel):
    """Base of `u = scale_u r(theta) x/chi + cu`, `v = scale_v r(theta) y/chi + cv` with chi = hypot(x, y)."""

    _radius: MonotonePolynomial = field(init=False, repr=False, compare=False)
    _scale: tuple[float, float] = field(init=False, repr=False, compare=False)
    _centre: tuple[float, float] = field(init=False, repr=False, compare=False)

    def _prepare(self, radius: MonotonePolynomial, *, scale: tuple[float, float], centre: tuple[float, float]) -> None:
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
