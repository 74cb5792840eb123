"""The lidar sweep of an exposure, seen by the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.recordings import ImageRef, MountedCamera, Recording
from bench.reference.sweeps import PlacedSweep, place_sweep

FARTHEST_SWEEP_NS = 100_000_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenSweep:
    """A sweep freed of the host's motion, at an exposure.

    Attributes:
        points_world: (N, 3) float64, m.
        points_vehicle: (N, 3) float64, m, vehicle frame at exposure.
        pixels: (K, 2) float64, px, of the points in the image.
        range_m: (K,) float64, m, of these points from the camera.
    """

    points_world: NDArray[np.float64]
    points_vehicle: NDArray[np.float64]
    pixels: NDArray[np.float64]
    range_m: NDArray[np.float64]


class SweepViewer:
    """Projects the sweep nearest to an exposure; holds the last one.

    Args:
        recording: the drive.
        camera: that looks.
    """

    def __init__(self, recording: Recording, camera: MountedCamera) -> None:
        self._recording, self._camera = recording, camera
        self._times_ns = np.array([sweep.timestamp_ns for sweep in recording.sweeps], dtype=np.int64)
        self._held: tuple[int, PlacedSweep | None] | None = None

    def see(self, image: ImageRef) -> SeenSweep | None:
        """The sweep at an exposure; None where there is none within 100 ms, or no ego-motion.

        Raises:
            DataError: the sweep's file cannot be read.
        """
        away_ns = np.abs(self._times_ns - image.timestamp_ns)
        if not away_ns.size or away_ns.min() > FARTHEST_SWEEP_NS:
            return None
        nearest = int(np.argmin(away_ns))
        if self._held is None or self._held[0] != nearest:
            sweep = self._recording.sweeps[nearest].read()
            self._held = nearest, place_sweep(sweep, self._recording.trajectory, self._recording.vehicle_from_lidar)
        placed = self._held[1]
        if placed is None:
            return None
        points_world = placed.points_world()
        vehicle_from_world = self._recording.trajectory.world_from_vehicle(image.timestamp_ns).inverse()
        points_vehicle = vehicle_from_world.apply(points_world)
        points_camera = self._camera.vehicle_from_camera.inverse().apply(points_vehicle)
        pixels, valid = self._camera.model.project(points_camera)
        seen = valid & self._camera.model.contains(pixels)
        return SeenSweep(
            points_world=points_world,
            points_vehicle=points_vehicle,
            pixels=pixels[seen],
            range_m=np.linalg.norm(points_camera[seen], axis=1),
        )
