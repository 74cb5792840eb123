"""`recording.json`, the head of a native recording, key by key."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from bench.cameras import RollingShutter
from bench.cameras.model import LONGEST_READOUT_S, ReadoutDirection
from bench.geometry import RigidTransform
from bench.recordings.annotations import Statement
from bench.recordings.images import MOST_WHITE
from bench.recordings.validation import FileModel, Measured, SidePx

SCHEMA_VERSION = 1
LONGEST_INTERVAL_NS = 3_600_000_000_000  # an hour
CONVENTIONS = (
    "Vehicle frame: x forward, y left, z up, metres, origin on the ground below the middle of the rear axle. "
    "Camera frame: x right, y down, z along the optical axis. a_from_b maps points of frame b into frame a. "
    "Pixels are (u, v), the centre of the first pixel is (0, 0). Quaternions are w, x, y, z here and x, y, z, w in "
    "annotations.json, as OpenLABEL has it. Times are nanoseconds."
)

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]
FolderName = Annotated[str, Field(pattern=r"^[^/\\\x00-\x1f.][^/\\\x00-\x1f]*$")]
WhiteLevel = Annotated[int, Field(ge=255, le=MOST_WHITE)]
Vector3 = tuple[Measured, Measured, Measured]
Quaternion = tuple[float, float, float, float]


class Mounting(FileModel):
    """A rigid transform as files state it, for example where a sensor sits on the vehicle.

    Attributes:
        quaternion_wxyz: of length 1.
        translation_m: x, y and z.
    """

    quaternion_wxyz: Quaternion
    translation_m: Vector3

    @field_validator("quaternion_wxyz")
    @classmethod
    def _unit(cls, wxyz: Quaternion) -> Quaternion:
        length = sum(part * part for part in wxyz) ** 0.5
        if abs(length - 1.0) > 1e-3:
            raise ValueError(f"a quaternion w, x, y, z of length 1 (this one has {length:.4g})")
        return wxyz

    @classmethod
    def of(cls, transform: RigidTransform) -> Mounting:
        """Return the file's form of a transform."""
        w, x, y, z = transform.quaternion_wxyz.tolist()
        along_x, along_y, along_z = transform.translation_m.tolist()
        return cls(quaternion_wxyz=(w, x, y, z), translation_m=(along_x, along_y, along_z))

    @property
    def transform(self) -> RigidTransform:
        """The transform that a file states."""
        return RigidTransform.from_quaternion(self.quaternion_wxyz, self.translation_m)


class VehicleHead(FileModel):
    """The ego vehicle.

    Attributes:
        outline_m: x and y of its outline seen from above.
        ground_height_m: height of the road in the vehicle frame.
    """

    outline_m: tuple[tuple[Measured, Measured], ...] = Field(min_length=3)
    ground_height_m: Measured = 0.0


class RollingShutterHead(FileModel):
    """A rolling shutter as files state it; keys as of `RollingShutter`."""

    readout_s: float = Field(gt=0, le=LONGEST_READOUT_S)
    direction: ReadoutDirection = "down"

    @property
    def shutter(self) -> RollingShutter:
        """The shutter that a file states."""
        return RollingShutter(readout_s=self.readout_s, direction=self.direction)


class CameraHead(FileModel):
    """A camera.

    Attributes:
        model: `model` is the name of a camera model, the rest are its parameters without the image size.
        image_size: width and height of the stored images, px.
        vehicle_from_camera: the mounting.
        ego_body_mask: image in the recording, not 0 where the camera sees its own vehicle; null for nowhere.
        rolling_shutter: null where all rows are exposed at once.
        white_level: value of files of 16 bits that is white; fixed, since flow compares images. null for 65535.
    """

    model: dict[str, Any]
    image_size: tuple[SidePx, SidePx]
    vehicle_from_camera: Mounting
    ego_body_mask: str | None = None
    rolling_shutter: RollingShutterHead | None = None
    white_level: WhiteLevel | None = None


class LidarHead(FileModel):
    """The lidar.

    Attributes:
        vehicle_from_lidar: from the frame in which the sweeps give their points.
        lidar_from_sensor: where in that frame the beams start and the axes about which they turn; null where points are
            given in the sensor's own axes.
    """

    vehicle_from_lidar: Mounting
    lidar_from_sensor: Mounting | None = None


class TrueCalibration(FileModel):
    """`truth/calibration.json` of a synthetic recording: where the sensors sit, apart from what the head says.

    Attributes:
        vehicle_from_camera: by the camera's name.
        vehicle_from_lidar: of the lidar.
    """

    vehicle_from_camera: dict[Name, Mounting]
    vehicle_from_lidar: Mounting


class RecordingHead(FileModel):
    """`recording.json`.

    Attributes:
        schema_version: of this format.
        name: of the recording, the same as its folder's.
        licence: of the data.
        frame_interval_ns: nominal time between images.
        conventions: frames and orders of numbers in words, for readers of the file.
        annotated: "complete", "none", or which times and areas are; null for complete where there are annotations.
    """

    schema_version: Literal[1]
    name: FolderName
    licence: str
    frame_interval_ns: int = Field(gt=0, le=LONGEST_INTERVAL_NS)
    conventions: str = CONVENTIONS
    annotated: Statement | None = None
    vehicle: VehicleHead
    cameras: dict[Name, CameraHead] = Field(min_length=1)
    lidar: LidarHead
