"""A recording of three images, two sweeps and two objects, small enough to check by hand."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from bench.cameras.angular import RadialPolynomialCamera
from bench.cameras.model import CameraModel
from bench.geometry import RigidTransform, RoadPlane
from bench.lidar.sweep import LidarSweep
from bench.recordings import Cuboid, GroundPolygon, MountedCamera, ObjectState, PointIndices, RecordingWriter, Track

STEP_NS = 66_666_667
TIMES_NS = tuple(1_700_000_000_000_000_000 + i * STEP_NS for i in range(3))
WIDTH, HEIGHT = 64, 48
FRONT = RigidTransform(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([3.7, 0.0, 0.65]))
OUTLINE_M = np.array([[-1.0, -0.9], [3.8, -0.9], [3.8, 0.9], [-1.0, 0.9]])
VEHICLE_FROM_LIDAR = RigidTransform.from_yaw(0.1, (1.2, 0.0, 1.8))


def lens() -> CameraModel:
    coefficients = (20.0, 0.5, -0.25, 0.0)
    return RadialPolynomialCamera(width=WIDTH, height=HEIGHT, coefficients=coefficients, principal_point=(31.5, 23.5))


def front_camera(model: CameraModel | None = None, *, ground_height_m: float = 0.0) -> MountedCamera:
    model = model or lens()
    ego_body = np.zeros((model.height, model.width), dtype=bool)
    ego_body[40:, 10:50] = True
    return MountedCamera(
        name="front",
        model=model,
        vehicle_from_camera=FRONT,
        road=RoadPlane.below(FRONT, ground_height_m=ground_height_m),
        stored_size_px=(model.width, model.height),
        ego_body=ego_body,
    )


def pixels(index: int) -> np.ndarray:
    return np.random.default_rng(index).integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8)


def truth(index: int) -> np.ndarray:
    ids = np.zeros((HEIGHT, WIDTH), dtype=np.uint16)
    ids[10:20, 10 + index : 20 + index] = 40_000
    return ids


def sweep(index: int) -> LidarSweep:
    rng = np.random.default_rng(100 + index)
    return LidarSweep(
        timestamp_ns=TIMES_NS[index],
        points_lidar=rng.normal(size=(30, 3)).astype(np.float32),
        time_offset_ns=np.arange(30, dtype=np.int64) * 1000,
        intensity=rng.random(30, dtype=np.float32),
        ring=np.arange(30, dtype=np.uint8),
    )


def tracks() -> tuple[Track, ...]:
    pose = RigidTransform.from_yaw(0.3, (8.0, -3.5, 1.0))
    van = tuple(
        ObjectState(
            timestamp_ns=time_ns,
            shape=Cuboid(vehicle_from_object=pose, size_m=np.array([5.2, 2.0, 2.1])),
            velocity_mps=np.array([6.0, 0.25, 0.0]),
            yaw_rate_radps=0.125,
            category="preceding",
        )
        for time_ns in TIMES_NS
    )
    outline_m = np.array([[4.0, 1.0], [5.0, 1.0], [5.0, 2.0]])
    walker = (
        ObjectState(
            timestamp_ns=TIMES_NS[1],
            shape=GroundPolygon(outline_m=outline_m, bottom_m=0.125, top_m=1.75),
            velocity_mps=np.full(3, np.nan),
            unclear=True,
        ),
        ObjectState(
            timestamp_ns=TIMES_NS[2],
            shape=PointIndices(indices=np.array([3, 1, 4], dtype=np.int64), sweep_timestamp_ns=TIMES_NS[1]),
            velocity_mps=np.array([0.0, 1.5, 0.0]),
        ),
    )
    return (
        Track(track_id="van", object_class="vehicle", states=van, instance_id=40_000),
        Track(track_id="walker", object_class="pedestrian", states=walker),
    )


def write_head(root: Path, **changes: object) -> None:
    usual = {"name": root.name, "licence": "Apache-2.0", "frame_interval_ns": STEP_NS}
    usual |= {"cameras": {"front": front_camera()}}
    usual |= {"vehicle_from_lidar": VEHICLE_FROM_LIDAR, "vehicle_outline_m": OUTLINE_M}
    RecordingWriter(root).header(**(usual | changes))


def write_recording(root: Path, *, model: CameraModel | None = None, ground_height_m: float = 0.0) -> Path:
    writer = RecordingWriter(root)
    camera = front_camera(model, ground_height_m=ground_height_m)
    write_head(root, cameras={"front": camera}, ground_height_m=ground_height_m)
    for i, time_ns in enumerate(TIMES_NS):
        writer.image("front", time_ns, pixels(i))
        writer.truth("front", time_ns, truth(i))
    for i in range(2):
        writer.sweep(sweep(i))
    writer.bus_signals(
        timestamps_ns=np.array(TIMES_NS, dtype=np.int64),
        speed_mps=np.array([3.0, 3.0, 3.0]),
        yaw_rate_radps=np.zeros(3),
        gear=["D", "D", "D"],
    )
    positions_m = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.4, 0.0, 0.0]])
    writer.poses(np.array(TIMES_NS), Rotation.identity(3), positions_m, truth=True)
    writer.annotations(tracks())
    return root
