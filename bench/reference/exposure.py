"""Properties that all objects of an image share: when it was taken, from where, and which of its pixels count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.cameras import ray_grid
from bench.egomotion import Trajectory
from bench.geometry import RigidTransform
from bench.geometry.raster import Raster
from bench.records.recording import MountedCamera, Recording
from bench.records.reference import ReferenceFrame, ReferenceObject


def visible_region(camera: MountedCamera) -> NDArray[np.bool_]:
    """V: pixels inside the lens's field and off the ego vehicle's own body, (H, W) bool."""
    valid = ray_grid(camera.model).valid
    return valid.copy() if camera.ego_body is None else valid & ~camera.ego_body


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exposure:
    """One image of a camera.

    Attributes:
        recording: name.
        camera: that took it.
        valid: (H, W) bool, the region V.
        timestamp_ns: when.
        trajectory: of the ego vehicle.
        vehicle_from_world: pose of the vehicle.
        camera_from_world: pose of the camera.
        position_m: (3,) float64, m, of the camera, world frame.
        ego_velocity_mps: (3,) float64, over the ground, vehicle axes.
    """

    recording: str
    camera: MountedCamera
    valid: NDArray[np.bool_]
    timestamp_ns: int
    trajectory: Trajectory
    vehicle_from_world: RigidTransform
    camera_from_world: RigidTransform
    position_m: NDArray[np.float64]
    ego_velocity_mps: NDArray[np.float64]

    @classmethod
    def at(
        cls, timestamp_ns: int, *, recording: Recording, camera: MountedCamera, valid: NDArray[np.bool_]
    ) -> Exposure:
        """The exposure of a time.

        Raises:
            DataError: no ego-motion there.
        """
        trajectory = recording.trajectory
        world_from_vehicle = trajectory.world_from_vehicle(timestamp_ns)
        world_from_camera = world_from_vehicle @ camera.vehicle_from_camera
        return cls(
            recording=recording.name,
            camera=camera,
            valid=valid,
            timestamp_ns=timestamp_ns,
            trajectory=trajectory,
            vehicle_from_world=world_from_vehicle.inverse(),
            camera_from_world=world_from_camera.inverse(),
            position_m=world_from_camera.translation_m,
            ego_velocity_mps=trajectory.velocity_vehicle_mps(timestamp_ns),
        )

    def project(self, points_world: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 2) float64, px, (u, v), of points, (N, 3), world frame; NaN where the lens cannot see one."""
        pixels, _ = self.camera.model.project(self.camera_from_world.apply(points_world))
        return pixels

    def frame(
        self,
        objects: tuple[ReferenceObject, ...],
        labels: NDArray[np.int32],
        ignored: NDArray[np.bool_],
        *,
        annotated: bool = True,
    ) -> ReferenceFrame:
        """The reference of this image; arguments as its attributes."""
        return ReferenceFrame(
            recording=self.recording,
            camera=self.camera.name,
            timestamp_ns=self.timestamp_ns,
            ego_speed_mps=float(np.hypot(*self.ego_velocity_mps[:2])),
            objects=objects,
            labels=labels,
            ignored=ignored,
            valid=self.valid,
            annotated=annotated,
        )

    def in_valid(self, raster: Raster) -> Raster:
        """The pixels that lie in V, of a window that lies in the image."""
        return Raster(raster.window, raster.covered & self.valid[raster.window])

    def crop(self, covered: NDArray[np.bool_], corner: NDArray[np.int64]) -> Raster:
        """The pixels that lie in V, of a window that may reach beyond the image.

        Args:
            covered: (rows, columns) bool, of the window.
            corner: (2,) int64, (u, v) of the window's first pixel.
        """
        height, width = self.valid.shape
        (u, v), (rows, columns) = corner.tolist(), covered.shape
        top, bottom = (min(max(row, 0), height) for row in (v, v + rows))
        left, right = (min(max(column, 0), width) for column in (u, u + columns))
        window = slice(top, bottom), slice(left, right)
        return self.in_valid(Raster(window, covered[top - v : bottom - v, left - u : right - u]))
