"""The unified (MEI) model with radial and tangential terms."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from bench.cameras.brown import BrownDistortion
from bench.cameras.model import checked_max_angle, finite_pair
from bench.cameras.pinhole import PlanarCamera
from bench.errors import ShapeError


@dataclass(frozen=True, kw_only=True)
class UnifiedCamera(PlanarCamera):
    """Projection on the unit sphere, then from a centre `xi` behind it, then distortion.

    The unit vector (x, y, z) goes to m = (x, y)/(z + xi), is distorted as in OpenCV's Brown model, scaled by the
    focal length and shifted to the principal point. The mapping holds while the radius of m rises with the
    angle (cos theta > -1/xi for xi > 1, > -xi otherwise) and while the distortion is one-to-one in the disc of that
    radius; never a test of z > 0.

    Attributes:
        xi: mirror parameter, >= 0; 0 is the pinhole. `focal` is also called gamma.
        radial: (k1, k2).
        tangential: (p1, p2), which the KITTI-360 tools leave out.
        max_angle_rad: field limit of the lens; None for as far as the mapping is one-to-one.

    Source:
        Mei and Rives 2007; KITTI-360 and aiMotive calibrations.
    """

    xi: float
    radial: tuple[float, float] = (0.0, 0.0)
    tangential: tuple[float, float] = (0.0, 0.0)
    max_angle_rad: float | None = None
    _distortion: BrownDistortion = field(init=False, repr=False, compare=False)
    _limit_rad: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (np.isfinite(self.xi) and self.xi >= 0):
            raise ShapeError(f"xi: expected a number >= 0, got {self.xi}")
        object.__setattr__(self, "radial", finite_pair(self.radial, "radial"))
        object.__setattr__(self, "tangential", finite_pair(self.tangential, "tangential"))
        sphere_rad = np.arccos(-1.0 / self.xi) if self.xi > 1 else np.arccos(-self.xi)
        wanted_rad = min(checked_max_angle(self.max_angle_rad), float(sphere_rad))
        distortion = BrownDistortion((*self.radial, 0.0), self.tangential, self._radius_at(wanted_rad))
        object.__setattr__(self, "_distortion", distortion)
        object.__setattr__(self, "_limit_rad", min(wanted_rad, self._angle_at(distortion.limit)))

    @property
    @override
    def limit_angle_rad(self) -> float:
        return self._limit_rad

    @override
    def _project(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        x, y, z = points[:, 0], points[:, 1], points[:, 2]
        length = np.sqrt(x * x + y * y + z * z)
        depth = z + self.xi * length
        m_x, m_y = x / depth, y / depth
        u, v = self._pixels(*self._distortion(m_x, m_y))
        valid = (z >= np.cos(self._limit_rad) * length) & (length > 0) & (depth > 0) & np.isfinite(u) & np.isfinite(v)
        return u, v, valid

    @override
    def _unproject(
        self, u: NDArray[np.float64], v: NDArray[np.float64], rays: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
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
