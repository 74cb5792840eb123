"""The undistorted pinhole, for rectified images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from bench.cameras.model import CameraModel, finite_pair


@dataclass(frozen=True, kw_only=True)
class PinholeCamera(CameraModel):
    """`u = fx x/z + cu`, `v = fy y/z + cv` for z > 0.

    Attributes:
        focal: (fx, fy), px.
    """

    focal: tuple[float, float]

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "focal", finite_pair(self.focal, "focal", positive=True))

    @property
    @override
    def limit_angle_rad(self) -> float:
        return float(np.pi / 2)

    @override
    def _rescaled(self, scale_u: float, scale_v: float) -> dict[str, Any]:
        return {"focal": (self.focal[0] * scale_u, self.focal[1] * scale_v)}

    @override
    def _project(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        z = points[:, 2]
        u = self.focal[0] * (points[:, 0] / z) + self.principal_point[0]
        v = self.focal[1] * (points[:, 1] / z) + self.principal_point[1]
        return u, v, (z > 0) & np.isfinite(u) & np.isfinite(v)

    @override
    def _unproject(
        self, u: NDArray[np.float64], v: NDArray[np.float64], rays: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        x = (u - self.principal_point[0]) / self.focal[0]
        y = (v - self.principal_point[1]) / self.focal[1]
        z = 1.0 / np.sqrt(x * x + y * y + 1.0)
        rays[:, 0], rays[:, 1], rays[:, 2] = x * z, y * z, z
        return np.isfinite(u) & np.isfinite(v)
