"""Properties that all objects of an image share: when it was taken, from where, and which of its pixels count."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.cameras.model import CameraModel, RollingShutter, ray_grid
from bench.egomotion.trajectory import Trajectory
from bench.geometry import Floats, RigidTransform, advance_twist, twist_between
from bench.records.recording import MountedCamera, Recording
from bench.records.reference import ReferenceFrame, ReferenceObject
from bench.reference.raster import Raster
from bench.times import SECOND_NS


def visible_region(camera: MountedCamera) -> NDArray[np.bool_]:
    """V: pixels inside the lens's field and off the ego vehicle's own body, (H, W) bool."""
    valid = ray_grid(camera.model).valid
    return valid.copy() if camera.ego_body is None else valid & ~camera.ego_body


# Steps to the row that sees a point; each leaves as much of the error as the point moves, in rows, from row to row.
ROW_STEPS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Readout:
    """Motion of a camera with a rolling shutter, and of what it sees, while the rows of an image are exposed.

    Attributes:
        shutter: of the camera.
        turn_rad: (3,) float64, rotation vector of the camera from the first row to the last, its own axes.
        path_m: (3,) float64, m, its path in its own axes in that time.
        velocity_camera_mps: (3,) float64, of what is seen, over the ground, along the camera's axes at the middle row.
    """

    shutter: RollingShutter
    turn_rad: Floats
    path_m: Floats
    velocity_camera_mps: Floats

    @classmethod
    def at(cls, timestamp_ns: int, *, trajectory: Trajectory, camera: MountedCamera) -> Readout | None:
        """The readout of an image, of what is static; None where all rows are exposed at once.

        Raises:
            DataError: no ego-motion there.
        """
        shutter = camera.rolling_shutter
        if shutter is None:
            return None
        half_ns = round(shutter.readout_s * SECOND_NS / 2)
        first, last = (
            trajectory.world_from_vehicle(timestamp_ns + offset_ns) @ camera.vehicle_from_camera
            for offset_ns in (-half_ns, half_ns)
        )
        (turn_rad,), (path_m,) = twist_between(*_row(first), *_row(last))
        return cls(shutter=shutter, turn_rad=turn_rad, path_m=path_m, velocity_camera_mps=np.zeros(3))

    def seen(self, points_camera: Floats, model: CameraModel) -> Floats:
        """Points, (N, 3), from the camera frame at the middle row to that at the row which sees each one."""
        seen = points_camera
        for _ in range(ROW_STEPS):
            seconds = self.shutter.row_time_offset_s(model.project(seen)[0], model)
            rotations, advances_m = advance_twist(self.turn_rad, self.path_m, seconds / self.shutter.readout_s)
            moved = points_camera + self.velocity_camera_mps * seconds[:, None]
            seen = rotations.inv().apply(moved - advances_m)
        return seen


def _row(transform: RigidTransform) -> tuple[Rotation, Floats]:
    return Rotation.from_matrix(transform.rotation[None]), transform.translation_m[None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exposure:
    """One image of a camera.

    Attributes:
        recording: the drive.
        camera: that took it.
        valid: (H, W) bool, the region V.
        timestamp_ns: when.
        vehicle_from_world: pose of the vehicle.
        camera_from_world: pose of the camera.
        position_m: (3,) float64, m, of the camera, world frame.
        ego_velocity_mps: (3,) float64, over the ground, vehicle axes.
        readout: motion from row to row; None where all rows are exposed at once.
    """

    recording: Recording
    camera: MountedCamera
    valid: NDArray[np.bool_]
    timestamp_ns: int
    vehicle_from_world: RigidTransform
    camera_from_world: RigidTransform
    position_m: Floats
    ego_velocity_mps: Floats
    readout: Readout | None = None

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
            recording=recording,
            camera=camera,
            valid=valid,
            timestamp_ns=timestamp_ns,
            vehicle_from_world=world_from_vehicle.inverse(),
            camera_from_world=world_from_camera.inverse(),
            position_m=world_from_camera.translation_m,
            ego_velocity_mps=trajectory.velocity_vehicle_mps(timestamp_ns),
            readout=Readout.at(timestamp_ns, trajectory=trajectory, camera=camera),
        )

    def of_object(self, velocity_world_mps: Floats) -> Exposure:
        """The same for what moves with a velocity, (3,), over the ground."""
        if self.readout is None:
            return self
        velocity_camera_mps = self.camera_from_world.rotate(velocity_world_mps)
        return replace(self, readout=replace(self.readout, velocity_camera_mps=velocity_camera_mps))

    def seen(self, points_camera: Floats) -> Floats:
        """Points, (..., 3), camera frame at the time of the image, moved to the time of the row that sees each one.

        All that the camera's model makes of them, be it pixels or silhouettes, then holds. Without a rolling shutter
        they stay as they are. A row is known where the lens sees the point; else the time is that of the image.
        """
        if self.readout is None:
            return points_camera
        return self.readout.seen(points_camera.reshape(-1, 3), self.camera.model).reshape(points_camera.shape)

    def project(self, points_world: Floats) -> Floats:
        """(N, 2) float64, px, (u, v), of points, (N, 3), world frame; NaN where the lens cannot see one."""
        pixels, _ = self.camera.model.project(self.seen(self.camera_from_world.apply(points_world)))
        return pixels

    def frame(
        self,
        objects: tuple[ReferenceObject, ...],
        labels: NDArray[np.int32],
        ignored: NDArray[np.bool_],
        unknown: NDArray[np.bool_] | None = None,
        *,
        annotated: bool = True,
    ) -> ReferenceFrame:
        """The reference of this image; arguments as its attributes, `unknown` None for nowhere."""
        return ReferenceFrame(
            recording=self.recording.name,
            camera=self.camera.name,
            timestamp_ns=self.timestamp_ns,
            ego_speed_mps=float(np.hypot(*self.ego_velocity_mps[:2])),
            objects=objects,
            labels=labels,
            ignored=ignored,
            unknown=np.zeros_like(ignored) if unknown is None else unknown,
            left_out=np.zeros_like(ignored) if annotated else ignored,
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
