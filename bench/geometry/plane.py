"""The road as the camera sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.errors import ShapeError
from bench.geometry.rigid import RigidTransform
from bench.geometry.sphere import dot


@dataclass(frozen=True, slots=True, eq=False)
class RoadPlane:
    """A plane below the camera, in the camera's own frame.

    Attributes:
        down: (3,) float64, unit vector from the camera to the road: the paper's h.
        height_m: height of the camera above the road: the paper's eta_C.

    Raises:
        ShapeError: `down` is not a finite vector of three, or the camera is not above the road.

    Source:
        Mariotti and Eising 2020, section III-D, equations 11 and 13.
    """

    down: NDArray[np.float64]
    height_m: float

    def __post_init__(self) -> None:
        down = np.array(self.down, dtype=np.float64)
        length = float(np.linalg.norm(down)) if down.shape == (3,) else float("nan")
        if not (np.isfinite(length) and length > 0):
            raise ShapeError(f"RoadPlane: expected `down` as three finite numbers, not all zero, got {down.tolist()}")
        if not (np.isfinite(self.height_m) and self.height_m > 0):
            raise ShapeError(f"RoadPlane: expected a camera above the road, got a height of {self.height_m} m")
        down /= length
        down.flags.writeable = False
        object.__setattr__(self, "down", down)
        object.__setattr__(self, "height_m", float(self.height_m))

    @classmethod
    def below(cls, vehicle_from_camera: RigidTransform, *, ground_height_m: float = 0.0) -> RoadPlane:
        """The road below a mounted camera.

        Args:
            vehicle_from_camera: the camera's mounting.
            ground_height_m: height of the road in the vehicle frame; 0 by the project's convention,
                other where a data set puts its origin elsewhere.

        Source:
            Mariotti and Eising 2020, equation 11: h = R [0, 0, -1].
        """
        down_camera = vehicle_from_camera.inverse().rotate(np.array([0.0, 0.0, -1.0]))
        return cls(down_camera, float(vehicle_from_camera.translation_m[2]) - ground_height_m)

    def distance_m(self, rays_camera: NDArray[np.float64]) -> NDArray[np.float64]:
        """Length along each unit ray to the road, equation 13.

        Args:
            rays_camera: (..., 3) float64, unit rays.

        Returns:
            (...) float64, m; infinite for rays at or above the horizon.
        """
        fall = dot(rays_camera, self.down)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return np.where(fall > 0, self.height_m / fall, np.inf)
