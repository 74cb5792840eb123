"""Small exact worlds: points, cameras and what they see."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform, RoadPlane, normalise

# camera_from_vehicle of a camera that looks straight ahead.
FORWARD = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


def pitched_down(pitch_rad: float) -> np.ndarray:
    """camera_from_world rotation of a camera that looks ahead and down."""
    c, s = np.cos(pitch_rad), np.sin(pitch_rad)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ FORWARD


def beams(azimuths_deg: NDArray[np.float64], elevations_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit rays of a lidar whose axis points up, row by row, (N, 3)."""
    azimuth, elevation = np.meshgrid(np.radians(azimuths_deg), np.radians(elevations_deg))
    ahead, left = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)
    return np.stack([ahead, left, np.sin(elevation)], axis=-1).reshape(-1, 3)


@dataclass
class TwoViews:
    """A camera that moved from `previous_m` to `current_m` and rotated by `yaw_rad` to the left."""

    previous_m: tuple[float, float, float] = (0.0, 0.0, 0.66)
    current_m: tuple[float, float, float] = (0.4, 0.01, 0.66)
    yaw_rad: float = np.deg2rad(0.5)
    pitch_rad: float = np.deg2rad(20.0)

    def __post_init__(self) -> None:
        level = pitched_down(self.pitch_rad)
        turn = RigidTransform.from_yaw(self.yaw_rad).rotation
        self.previous_from_world = _looking(level, self.previous_m)
        self.current_from_world = _looking(level @ turn.T, self.current_m)
        self.motion = self.current_from_world @ self.previous_from_world.inverse()
        self.road = RoadPlane(self.current_from_world.rotate(np.array([0.0, 0.0, -1.0])), self.current_m[2])

    def rays(self, points, motion=(0.0, 0.0, 0.0)):
        """Unit rays of world points in both views; the points move by `motion` in between."""
        points = np.atleast_2d(np.asarray(points, dtype=float))
        previous = normalise(self.previous_from_world.apply(points))
        return previous, normalise(self.current_from_world.apply(points + np.asarray(motion)))


def _looking(camera_from_world, centre_m):
    return RigidTransform(camera_from_world, -camera_from_world @ np.asarray(centre_m, dtype=float))
