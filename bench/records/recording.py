"""Recording of a drive, the same for whatever data set it comes from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from bench.cameras.model import CameraModel, RollingShutter
from bench.egomotion.trajectory import Trajectory
from bench.errors import UsageError
from bench.geometry import RigidTransform, RoadPlane
from bench.lidar.sweep import LidarSweep
from bench.times import SECOND_NS

MotionKind = Literal["crossing", "overtaking", "preceding", "approaching", "static_ego"]
MOTION_KINDS: tuple[str, ...] = get_args(MotionKind)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MountedCamera:
    """A camera on the vehicle.

    Attributes:
        name: unique in the recording.
        model: the lens, at the size at which images are evaluated.
        vehicle_from_camera: the mounting.
        road: the road below the camera, camera frame.
        stored_size_px: (width, height) of the image files; larger or smaller than the model's where the data set's
            card asks for evaluation at another size.
        ego_body: (height, width) bool at the evaluated size, True where the camera sees its own vehicle; None for
            nowhere.
        rolling_shutter: its readout; None where all rows are exposed at once.
    """

    name: str
    model: CameraModel
    vehicle_from_camera: RigidTransform
    road: RoadPlane
    stored_size_px: tuple[int, int]
    ego_body: NDArray[np.bool_] | None = None
    rolling_shutter: RollingShutter | None = None

    @property
    def ground_m(self) -> float:
        """Height of the road below the camera, vehicle frame, m."""
        return float(self.vehicle_from_camera.translation_m[2]) - self.road.height_m


class StoredPart(Protocol):
    """Part of a file that holds several, such as a message of a log; it travels to other processes."""

    @property
    def container(self) -> Path:
        """The file that holds it."""
        ...

    def content(self) -> bytes:
        """All that decides what is read: its bytes as they are stored, and how they are decoded.

        Raises:
            DataError: they cannot be read.
        """
        ...


class StoredImage(StoredPart, Protocol):
    """An image in a file with others."""

    def pixels(self, *, colour: bool) -> NDArray[np.uint8]:
        """Decode it: (height, width) uint8 grey or (height, width, 3) uint8 BGR, at the stored size.

        Raises:
            DataError: it cannot be read or decoded.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageRef:
    """An image on disk.

    Attributes:
        camera: name of the camera.
        timestamp_ns: time of exposure (its middle; of a rolling shutter, that of the middle row).
        path: PNG or JPEG file; of an image in a container, a name for messages and predictions, which is no file: the
            container's path, the camera's name and the time.
        truth_path: 16-bit PNG of instance ids, in synthetic recordings; None elsewhere.
        moving_path: mask of what moves, where a data set has masks instead of annotated objects; None elsewhere.
        scored: False for an image that is there only as the one before another.
        stored: reads an image that lies in a container; None where `path` is a file.
    """

    camera: str
    timestamp_ns: int
    path: Path
    truth_path: Path | None = None
    moving_path: Path | None = None
    scored: bool = True
    stored: StoredImage | None = None

    @property
    def file(self) -> Path:
        """The file that holds the image, alone or with others."""
        return self.path if self.stored is None else self.stored.container


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepRef:
    """A lidar sweep on disk.

    Attributes:
        timestamp_ns: the sweep's reference time.
        path: the file; of a sweep in a container, a name for messages, which is no file.
        reader: reads it; a function of the module, so that a reference can travel to another process.
        stored: where a sweep in a container lies; None where `path` is a file.
    """

    timestamp_ns: int
    path: Path
    reader: Callable[[Path, int], LidarSweep]
    stored: StoredPart | None = None

    @property
    def file(self) -> Path:
        """The file that holds the sweep, alone or with others."""
        return self.path if self.stored is None else self.stored.container

    def read(self) -> LidarSweep:
        """Read the sweep.

        Raises:
            DataError: the file is missing or not what the format asks for.
        """
        return self.reader(self.path, self.timestamp_ns)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cuboid:
    """A box around an object.

    Attributes:
        vehicle_from_object: pose of the box's centre; object frame x forward, y left, z up.
        size_m: (3,) float64, full length (x), width (y) and height (z), m.
    """

    vehicle_from_object: RigidTransform
    size_m: NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroundPolygon:
    """An outline on the ground with a span of heights.

    Attributes:
        outline_m: (K, 2) float64, x and y in the vehicle frame, m, K >= 3, not closed.
        bottom_m: lowest height in the vehicle frame, m.
        top_m: highest height in the vehicle frame, m.
    """

    outline_m: NDArray[np.float64]
    bottom_m: float
    top_m: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointIndices:
    """The object's points, named one by one.

    Attributes:
        indices: (K,) int64, rows of the sweep's points.
        sweep_timestamp_ns: the sweep they count in.
    """

    indices: NDArray[np.int64]
    sweep_timestamp_ns: int


ObjectShape = Cuboid | GroundPolygon | PointIndices


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObjectState:
    """An annotated object at one time.

    Attributes:
        timestamp_ns: time of the annotation.
        shape: where it is, vehicle frame at `timestamp_ns`.
        velocity_mps: (3,) float64, velocity over the ground along the vehicle's axes at `timestamp_ns`, m/s; NaN where
            the annotation does not tell.
        yaw_rate_radps: turn of the object about its own centre, positive to the left; 0 where not told.
        category: one of `MOTION_KINDS` where the annotation names the kind of motion, else None.
        unclear: the annotator was not sure; the object is ignored.
    """

    timestamp_ns: int
    shape: ObjectShape
    velocity_mps: NDArray[np.float64]
    yaw_rate_radps: float = 0.0
    category: str | None = None
    unclear: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """One object through the recording.

    Attributes:
        track_id: unique in the recording.
        object_class: one of `OBJECT_CLASSES`; what else a data set knows is mapped by its adapter.
        states: by increasing time.
        instance_id: the object's number in truth images, in synthetic recordings; None elsewhere.
        reviewed: False for one that was proposed from the drive itself and that nobody has looked at.

    Raises:
        UsageError: an adapter gives something else than text as name or class.
    """

    track_id: str
    object_class: str
    states: tuple[ObjectState, ...]
    instance_id: int | None = None
    reviewed: bool = True

    def __post_init__(self) -> None:
        for name in ("track_id", "object_class"):
            if not isinstance(value := getattr(self, name), str):
                raise UsageError(f"track {self.track_id!r}: expected text as {name}, got {value!r}")

    def state_near(self, time_ns: int, *, within_ns: int) -> ObjectState | None:
        """The state nearest to a time; None where none is so near."""
        nearest = min(self.states, key=lambda state: abs(state.timestamp_ns - time_ns), default=None)
        return None if nearest is None or abs(nearest.timestamp_ns - time_ns) > within_ns else nearest


@dataclass(frozen=True, slots=True, kw_only=True)
class Annotated:
    """Times and areas of a recording that are annotated: every road user that moves there has an object or a mask.

    Elsewhere nobody knows what moves, so nothing is scored: images of other times, and pixels of other areas.

    Attributes:
        spans_ns: first and last time of each annotated stretch, both included; none where nothing is annotated.
        left_out_m: outlines on the ground, x and y in the vehicle frame, m, within which nothing is annotated.
    """

    spans_ns: tuple[tuple[int, int], ...]
    left_out_m: tuple[tuple[tuple[float, float], ...], ...] = ()

    def covers(self, timestamp_ns: int) -> bool:
        """Return True where an image of this time can be scored."""
        return any(first <= timestamp_ns <= last for first, last in self.spans_ns)


ALWAYS_NS = (-(2**63), 2**63 - 1)
COMPLETELY = Annotated(spans_ns=(ALWAYS_NS,))
NOT_ANNOTATED = Annotated(spans_ns=())


@dataclass(frozen=True, slots=True, kw_only=True)
class InputErrors:
    """Errors injected into the input of a method, all 0 by default; perturbed minus true.

    They reach the method only: the reference keeps the true calibration and ego-motion.

    Attributes:
        yaw_rate_bias_degps: added to the yaw rate, deg/s, positive to the left; about the vehicle's origin, as
            odometry integrates it, also while the vehicle is stationary.
        speed_scale_percent: of the vehicle's path between two images.
        pitch_deg: of the camera's mounting, positive down, about the camera itself.
        pitch_rate_degps: rotation of the camera about its own transverse axis between two images that the ego-motion
            does not know of, deg/s; the road below the current image stays right.
        principal_point_u_px: shift to the right.
        principal_point_v_px: shift down.
        focal_scale_percent: of the focal length in both directions.
        time_offset_ms: the ego-motion is read this much later than the images were exposed.
        image_noise_grey: standard deviation of normal noise of the images, grey levels; the same noise for the same
            image in every run, only its strength differs.
    """

    yaw_rate_bias_degps: float = 0.0
    speed_scale_percent: float = 0.0
    pitch_deg: float = 0.0
    pitch_rate_degps: float = 0.0
    principal_point_u_px: float = 0.0
    principal_point_v_px: float = 0.0
    focal_scale_percent: float = 0.0
    time_offset_ms: float = 0.0
    image_noise_grey: float = 0.0

    @property
    def named(self) -> dict[str, float]:
        """Those that are not 0."""
        return {name: error for name, error in asdict(self).items() if error}


NO_INPUT_ERRORS = InputErrors()


@dataclass(frozen=True, slots=True, kw_only=True)
class Content:
    """Something in a recording's files, and what is made of it.

    Attributes:
        what: files, a topic, a table or fields, as messages name them.
        count: how many.
        read_as: what they become; empty where they are not read.
        why: reason why they are not read.
        suspect: whether they lie where something else is expected.
    """

    what: str
    count: int = 1
    read_as: str = ""
    why: str = ""
    suspect: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """One drive: cameras, images, lidar, ego-motion and annotations, opened but not yet read.

    Attributes:
        name: unique in the data set; also the unit that intervals take as independent.
        root: folder that every path of the recording stays inside.
        frame_interval_ns: nominal time between images.
        cameras: by name.
        images: by camera name, by increasing time.
        trajectory: ego-motion.
        vehicle_from_lidar: mounting of the lidar.
        sweeps: by increasing time.
        tracks: annotated objects.
        annotated: when and where there would be an object if something moved.
        vehicle_outline_m: (K, 2) float64, the ego vehicle seen from above, vehicle frame, m.
        lidar_from_sensor: where the beams start and the axes about which they turn, in the frame of the points; not the
            identity where a data set gives its points in other axes than the sensor's own, such as the vehicle's.
        contents: what its files hold, read and not read.
        input_errors: injected into the method's input; calibration and ego-motion above are the true ones.
    """

    name: str
    root: Path
    frame_interval_ns: int
    cameras: Mapping[str, MountedCamera]
    images: Mapping[str, tuple[ImageRef, ...]]
    trajectory: Trajectory
    vehicle_from_lidar: RigidTransform
    sweeps: tuple[SweepRef, ...]
    tracks: tuple[Track, ...]
    annotated: Annotated
    vehicle_outline_m: NDArray[np.float64] = field(
        default_factory=lambda: np.array([[-1.0, -0.9], [3.8, -0.9], [3.8, 0.9], [-1.0, 0.9]])
    )
    lidar_from_sensor: RigidTransform = field(default_factory=RigidTransform.identity)
    contents: tuple[Content, ...] = ()
    input_errors: InputErrors = NO_INPUT_ERRORS

    @property
    def ground_m(self) -> float:
        """Height of the road, vehicle frame, m: the median over the cameras; 0 without cameras."""
        return float(np.median([camera.ground_m for camera in self.cameras.values()] or [0.0]))


GAP_INTERVALS = 1.5  # a pair further apart than this many nominal intervals has an image missing between


def frame_gaps(recording: Recording, camera: str) -> dict[int, int]:
    """Gaps between neighbouring images of a camera of more than 1.5 nominal intervals: index of the later one -> ns."""
    times_ns = [image.timestamp_ns for image in recording.images[camera]]
    gaps_ns = {i: after - before for i, (before, after) in enumerate(pairwise(times_ns), start=1)}
    return {i: gap_ns for i, gap_ns in gaps_ns.items() if gap_ns > GAP_INTERVALS * recording.frame_interval_ns}


TURN_SPAN_NS = 500_000_000  # headings are compared over about this time, since single ones jitter


def world_yaw_rates(timestamps_ns: NDArray[np.int64], world_from_object: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn of an object over the ground, from its headings a quarter of a second before and after.

    Args:
        timestamps_ns: (N,) int64, increasing.
        world_from_object: (N, 3, 3) float64, rotation of the box at each time, in a world with z up.

    Returns:
        (N,) float64, rad/s, positive to the left; 0 for an object seen once.
    """
    forward_world = world_from_object[:, :, 0]
    heading_rad = np.unwrap(np.arctan2(forward_world[:, 1], forward_world[:, 0]))
    first = np.searchsorted(timestamps_ns, timestamps_ns - TURN_SPAN_NS // 2)
    last = np.searchsorted(timestamps_ns, timestamps_ns + TURN_SPAN_NS // 2, side="right") - 1
    span_s = (timestamps_ns[last] - timestamps_ns[first]) / SECOND_NS
    turn_rad = heading_rad[last] - heading_rad[first]
    return np.asarray(np.where(span_s > 0, turn_rad / np.where(span_s > 0, span_s, 1.0), 0.0))


def world_velocities(timestamps_ns: NDArray[np.int64], positions_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Velocity at each time, from the positions before and after.

    Args:
        timestamps_ns: (N,) int64, increasing.
        positions_m: (N, 3) float64, world frame, m.

    Returns:
        (N, 3) float64, m/s; NaN for an object seen once.
    """
    if len(timestamps_ns) < 2:
        return np.full_like(positions_m, np.nan)
    seconds = (timestamps_ns - timestamps_ns[0]) / SECOND_NS
    return np.asarray(np.gradient(positions_m, seconds, axis=0))
