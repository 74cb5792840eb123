"""Cameras, lidar and dimensions of the vehicle, as the heads of a log's tables state them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from bench.adapters.log123d.tables import LogTable
from bench.atomic import MOST_LINK_LEVELS
from bench.cameras import CameraModel, camera_from_parameters
from bench.errors import ShapeError
from bench.geometry import RigidTransform
from bench.recordings.mounting import EvaluatedSize, Polygon, body_mask, mounted_camera
from bench.recordings.schema import RollingShutterHead
from bench.recordings.validation import FileModel, SidePx, located, validated
from bench.records.recording import MountedCamera

FTHETA_CONSTANT_PX = 1e-3  # a lens whose image of the optical axis is further from its centre is none
SplitName = Annotated[str, Field(pattern=r"^\w[\w.-]*$")]
Pose = Annotated[tuple[float, ...], Field(min_length=7, max_length=7)]  # x, y, z, qw, qx, qy, qz


class LogOptions(FileModel):
    """The card's `options`.

    Attributes:
        logs: folder of the logs, `<split>/<log>/*.arrow`, relative to the data set's root.
        log_splits: which folders of splits are read, such as `av2-sensor_val`; null for all that are there.
        sensors: folder of the original data set, relative to the root, which logs name images in.
        cameras: those to evaluate, as their tables are called without `camera.`, such as `fmcam_l`; null for all.
        lidar: whose points are used, such as `lidar_top`; null for the one or the merged lidar that a log has.
        motion_compensated: to which time of the sweep the data set moved its points; null for points as measured, each
            at its own time, or in the middle of the sweep where the log does not say.
        time_offset_ms: per camera, added to the times of its images to get the middle of the exposure.
        evaluated_size_px: (width, height) at which images are evaluated, of all cameras or by camera; null for as
            stored.
        field_of_view_deg: per camera, full angle of the lens, beyond which the image is dark; absent for as far as the
            calibration holds.
        body_polygons: per camera, outlines of the ego vehicle's body, (u, v) in stored pixels.
        rolling_shutter: per camera, its readout; the data do not state it. Absent where all rows are exposed at once.
        ground_height_m: height of the road at the rear axle's; null for half of the vehicle's height below its centre.
        follow_links: how many levels below `root` links to folders are followed; 1 for those in `root` itself.
        licence: of the data.
    """

    logs: str = "."
    log_splits: tuple[SplitName, ...] | None = None
    sensors: str | None = None
    cameras: tuple[str, ...] | None = None
    lidar: str | None = None
    motion_compensated: Literal["start", "end"] | None = None
    time_offset_ms: dict[str, float] = Field(default_factory=dict)
    evaluated_size_px: EvaluatedSize = None
    field_of_view_deg: dict[str, float] = Field(default_factory=dict)
    body_polygons: dict[str, tuple[Polygon, ...]] = Field(default_factory=dict)
    rolling_shutter: dict[str, RollingShutterHead] = Field(default_factory=dict)
    ground_height_m: float | None = None
    follow_links: int = Field(default=1, ge=0, le=MOST_LINK_LEVELS)
    licence: str = "see the data set"


class _Head(FileModel):
    """Keys of a head that are used; heads have more."""

    model_config = ConfigDict(extra="ignore")


class LogHead(_Head):
    """The head of `sync.arrow`.

    Attributes:
        dataset: in lower case.
        log_name: of the drive.
        version: of the library that wrote the log.
    """

    dataset: str
    log_name: str
    version: str = "unknown"


class EgoHead(_Head):
    """The ego vehicle: metres, and poses in the frame of its inertial sensor."""

    width: float = Field(gt=0)
    length: float = Field(gt=0)
    height: float = Field(gt=0)
    center_to_imu_se3: Pose
    rear_axle_to_imu_se3: Pose

    def imu_from_vehicle(self, ground_height_m: float | None) -> RigidTransform:
        """The pose of our vehicle frame: below the rear axle on the road, axes as the rear axle's."""
        imu_from_axle, imu_from_centre = pose(self.rear_axle_to_imu_se3), pose(self.center_to_imu_se3)
        axle_from_centre = imu_from_axle.inverse() @ imu_from_centre
        if ground_height_m is None:
            ground_height_m = float(axle_from_centre.translation_m[2]) - self.height / 2
        return imu_from_axle @ RigidTransform(np.eye(3), np.array([0.0, 0.0, ground_height_m]))

    def outline_m(self) -> NDArray[np.float64]:
        """(4, 2) float64, the vehicle from above, vehicle frame."""
        centre = (pose(self.rear_axle_to_imu_se3).inverse() @ pose(self.center_to_imu_se3)).translation_m[:2]
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
        return centre + corners * (self.length / 2, self.width / 2)


class CameraHead(_Head):
    """A camera.

    Attributes:
        camera_model: which of the three.
        camera_to_imu_se3: its pose.
        intrinsics: of a pinhole camera fx, fy, cx, cy, skew; of an f-theta lens cx, cy and two polynomials of six
            coefficients: from the angle to the optical axis to pixels, and back.
        distortion: k1, k2, p1, p2 and, of a pinhole camera, k3.
        projection: of MEI's model gamma1, gamma2, u0, v0.
        mirror_parameter: xi of MEI's model.
        is_undistorted: whether a pinhole camera's images were rectified, so that its distortion no longer applies.
    """

    camera_model: Literal["pinhole", "fisheye_mei", "ftheta"]
    width: SidePx
    height: SidePx
    camera_to_imu_se3: Pose
    intrinsics: tuple[float, ...] | None = None
    distortion: tuple[float, ...] | None = None
    projection: tuple[float, ...] | None = None
    mirror_parameter: float | None = None
    is_undistorted: bool = False

    def model(self, max_angle_rad: float | None) -> CameraModel:
        """The lens.

        Raises:
            ShapeError: numbers that make none.
        """
        size: dict[str, Any] = {"width": self.width, "height": self.height, "max_angle_rad": max_angle_rad}
        if self.camera_model == "fisheye_mei":
            gamma1, gamma2, u0, v0 = _numbers(self.projection, "projection", 4)
            k1, k2, p1, p2 = _numbers(self.distortion or (0.0,) * 4, "distortion", 4)
            (xi,) = _numbers(None if self.mirror_parameter is None else (self.mirror_parameter,), "mirror_parameter", 1)
            lens: dict[str, Any] = {"focal": (gamma1, gamma2), "principal_point": (u0, v0)}
            return camera_from_parameters("unified", **size, **lens, xi=xi, radial=(k1, k2), tangential=(p1, p2))
        if self.camera_model == "ftheta":
            u0, v0, constant, *coefficients = _numbers(self.intrinsics, "intrinsics", 14)[:8]
            if abs(constant) > FTHETA_CONSTANT_PX:
                raise ShapeError(f"intrinsics: expected a polynomial that is 0 at the optical axis, got {constant} px")
            # The inverse is found from this polynomial, since the stored one back is a fit of its own.
            lens = {"principal_point": (u0, v0), "coefficients": tuple(coefficients)}
            return camera_from_parameters("radial_polynomial", **size, **lens)
        fx, fy, u0, v0, skew = _numbers(self.intrinsics, "intrinsics", 5)
        if skew:
            raise ShapeError(f"intrinsics: expected no skew, got {skew}")
        distortion = (0.0,) * 5 if self.is_undistorted else self.distortion or (0.0,) * 5
        k1, k2, p1, p2, k3 = _numbers(distortion, "distortion", 5)
        lens = {"focal": (fx, fy), "principal_point": (u0, v0)}
        return camera_from_parameters("brown_conrady", **size, **lens, radial=(k1, k2, k3), tangential=(p1, p2))


class LidarHead(_Head):
    """A lidar; points are stored in the frame of the inertial sensor, whatever its pose."""

    lidar_name: str
    lidar_id: int
    lidar_to_imu_se3: Pose


class BoxesHead(_Head):
    """The boxes: the class that numbers their labels."""

    box_detection_label_class: str


def pose(values: tuple[float, ...] | NDArray[np.float64]) -> RigidTransform:
    """A pose from x, y, z, qw, qx, qy, qz."""
    return RigidTransform.from_quaternion(values[3:], values[:3])


def mounted(name: str, table: LogTable, *, vehicle_from_imu: RigidTransform, options: LogOptions) -> MountedCamera:
    """A camera of a log, at the size at which it is evaluated.

    Raises:
        DataError: a head that makes no camera.
    """
    head = table.head(CameraHead)
    field_deg = options.field_of_view_deg.get(name)
    with located(table.path, "metadata"):
        model = head.model(None if field_deg is None else float(np.deg2rad(field_deg / 2)))
        vehicle_from_camera = vehicle_from_imu @ pose(head.camera_to_imu_se3)
    return mounted_camera(
        name,
        model,
        vehicle_from_camera,
        ego_body=body_mask((head.width, head.height), options.body_polygons.get(name, ())),
        evaluated_size_px=options.evaluated_size_px,
        rolling_shutter=options.rolling_shutter.get(name),
        file=table.path,
        field="metadata",
    )


def lidar_heads(table: LogTable) -> Mapping[int, LidarHead]:
    """The lidars of a table by their numbers: one, or those of a merged table.

    Raises:
        DataError: no such head.
    """
    content = table.head_content()
    heads = content.values() if table.key.endswith("lidar_merged") else (content,)
    lidars = [validated(LidarHead, head, file=table.path, field="metadata") for head in heads]
    return {head.lidar_id: head for head in lidars}


def _numbers(values: tuple[float, ...] | None, name: str, count: int) -> tuple[float, ...]:
    if values is None or len(values) != count:
        got = "none" if values is None else str(len(values))
        raise ShapeError(f"{name}: expected {count} numbers, got {got}")
    return values
