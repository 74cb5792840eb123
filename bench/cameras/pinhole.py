"""Lenses that first map a ray to a plane, then stretch the plane to pixels; the simplest is the undistorted pinhole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from bench.cameras.model import CameraModel, finite_pair

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PlanarCamera(CameraModel):
    """`u = fx x + cu`, `v = fy y + cv` for the point (x, y) of the plane to which the lens maps a ray.

    Attributes:
        focal: (fx, fy), px.
    """

    focal: tuple[float, float]

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "focal", finite_pair(self.focal, "focal", positive=True))

    @override
    def _rescaled(self, scale_u: float, scale_v: float) -> dict[str, Any]:
        return {"focal": (self.focal[0] * scale_u, self.focal[1] * scale_v)}

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
    def _project(self, points: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        z = points[:, 2]
        u, v = self._pixels(points[:, 0] / z, points[:, 1] / z)
        return u, v, (z > 0) & np.isfinite(u) & np.isfinite(v)

    @override
    def _unproject(self, u: Floats, v: Floats, rays: Floats) -> NDArray[np.bool_]:
        x, y = self._plane(u, v)
        z = 1.0 / np.sqrt(x * x + y * y + 1.0)
        rays[:, 0], rays[:, 1], rays[:, 2] = x * z, y * z, z
        return np.isfinite(u) & np.isfinite(v)
