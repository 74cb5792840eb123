"""The fourth-order radial polynomial of the paper and of WoodScape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from typing_extensions import override

from bench.cameras.angular import AngularCamera
from bench.cameras.model import checked_max_angle, finite_numbers
from bench.cameras.monotone import MonotonePolynomial
from bench.errors import ShapeError


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
