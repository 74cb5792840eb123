"""The Kannala-Brandt model with four odd terms, the one of `cv2.fisheye`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from typing_extensions import override

from bench.cameras.angular import AngularCamera
from bench.cameras.model import checked_max_angle, finite_numbers, finite_pair
from bench.cameras.monotone import MonotonePolynomial


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
