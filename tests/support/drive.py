"""A clean recording of a street with boxes for houses and posts, ray cast, small enough to corrupt in a second."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from bench.egomotion.trajectory import planar_trajectory
from bench.geometry import RigidTransform
from bench.lidar.sweep import LidarSweep
from bench.recordings import Cuboid, ObjectState, RecordingWriter, Track
from tests.support.tiny import VEHICLE_FROM_LIDAR, pixels, write_head
from tests.support.worlds import beams

START_NS = 1_700_000_000_000_000_000
IMAGE_NS, SWEEP_NS, BUS_NS = 66_666_667, 100_000_000, 10_000_000
IMAGES, SWEEPS = 24, 16
SPEED_MPS, TURN_RADPS = 8.0, 0.2


def trajectory():
    times_ns = START_NS + np.arange(-20, 190, dtype=np.int64) * BUS_NS
    speed, turn = np.full(len(times_ns), SPEED_MPS), np.full(len(times_ns), TURN_RADPS)
    return planar_trajectory(source="drive", timestamps_ns=times_ns, speed_mps=speed, yaw_rate_radps=turn)


def winding_signals():
    """Times, speeds and yaw rates of a drive that brakes and turns in and out: its clock shows."""
    seconds = np.arange(-0.2, 1.9, 0.01)
    times_ns = START_NS + np.round(seconds * 1e9).astype(np.int64)
    return {"timestamps_ns": times_ns, "speed_mps": 7.0 - 2.0 * seconds, "yaw_rate_radps": 0.3 * np.sin(4.0 * seconds)}


def winding_path():
    return planar_trajectory(source="drive", **winding_signals())


# name: class, first place and heading in the world, velocity along the heading, length, width, height
OBJECTS = {
    "walker": ("pedestrian", (16.0, 4.0, 0.9), -np.pi / 2, 1.4, (0.5, 0.6, 1.8)),
    "leader": ("vehicle", (13.0, 0.5, 0.75), 0.25, 6.0, (4.4, 1.8, 1.5)),
    "parked": ("vehicle", (9.0, -6.0, 0.75), 0.0, 0.0, (4.2, 1.7, 1.5)),
    "rider": ("cyclist", (8.0, 7.0, 0.85), 0.3, 4.0, (1.8, 0.6, 1.7)),
}


def pose_at(name, seconds):
    _, place, heading, speed, _ = OBJECTS[name]
    way = speed * seconds * np.array([np.cos(heading), np.sin(heading), 0.0])
    return RigidTransform.from_yaw(heading, np.array(place) + way)


def scenery():
    rng = np.random.default_rng(5)
    boxes = []
    for _ in range(60):
        centre = np.array([rng.uniform(-25, 45), rng.choice([-1, 1]) * rng.uniform(11, 22), 1.5])
        boxes.append((RigidTransform.from_yaw(rng.uniform(0, 3), centre), rng.uniform([0.3, 0.3, 3], [4, 2, 3])))
    return boxes


def cast(origin, rays, boxes):
    """Range of each ray to the ground or the nearest box; infinite where it meets nothing."""
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(rays[:, 2] < -1e-3, -origin[2] / rays[:, 2], np.inf)
        for pose, size_m in boxes:
            inside = pose.inverse()
            start, along = inside.apply(origin), inside.rotate(rays)
            one, other = (-size_m / 2 - start) / along, (size_m / 2 - start) / along
            enter, leave = np.fmin(one, other).max(axis=1), np.fmax(one, other).min(axis=1)
            reach = np.where((enter > 0) & (enter < leave), np.minimum(reach, enter), reach)
    return reach


def sweep(index, path):
    time_ns = START_NS + index * SWEEP_NS
    world_from_lidar = path.world_from_vehicle(time_ns) @ VEHICLE_FROM_LIDAR
    rays = beams(np.arange(0, 360, 1.0), np.arange(-24, 6, 1.5))
    seconds = index * SWEEP_NS / 1e9
    boxes = scenery() + [(pose_at(name, seconds), np.array(entry[4])) for name, entry in OBJECTS.items()]
    reach = cast(world_from_lidar.translation_m, world_from_lidar.rotate(rays), boxes)
    seen = reach < 60
    noise = np.random.default_rng(index).normal(scale=0.01, size=seen.sum())
    points = rays[seen] * (reach[seen] + noise)[:, None]
    return as_at_once(time_ns, points.astype(np.float32))


def tracks(path, margin_m):
    made = []
    for name, (kind, _, heading, speed, size_m) in OBJECTS.items():
        velocity_world_mps, states = speed * np.array([np.cos(heading), np.sin(heading), 0.0]), []
        for i in range(SWEEPS):
            time_ns = START_NS + i * SWEEP_NS
            vehicle_from_world = path.world_from_vehicle(time_ns).inverse()
            pose = vehicle_from_world @ pose_at(name, i * SWEEP_NS / 1e9)
            shape = Cuboid(vehicle_from_object=pose, size_m=np.array(size_m) + 2 * margin_m)
            velocity_mps = vehicle_from_world.rotate(velocity_world_mps)
            states.append(ObjectState(timestamp_ns=time_ns, shape=shape, velocity_mps=velocity_mps))
        made.append(Track(track_id=name, object_class=kind, states=tuple(states)))
    return tuple(made)


MARGIN_M = 0.03  # around objects whose returns scatter by 1 cm


def write_drive(root: Path, margin_m: float = 0.0) -> Path:
    """Boxes end where the objects do, but for a margin on every side."""
    path, writer = trajectory(), RecordingWriter(root)
    write_head(root, frame_interval_ns=IMAGE_NS)
    for i in range(IMAGES):
        writer.image("front", START_NS + i * IMAGE_NS, pixels(i))
    for i in range(SWEEPS):
        writer.sweep(sweep(i, path))
    count = len(path.timestamps_ns)
    writer.bus_signals(
        timestamps_ns=path.timestamps_ns,
        speed_mps=np.full(count, SPEED_MPS),
        yaw_rate_radps=np.full(count, TURN_RADPS),
        gear=["D"] * count,
    )
    writer.annotations(tracks(path, margin_m))
    return root


def quaternion_wxyz(transform: RigidTransform, turn: Rotation) -> list[float]:
    """The mounting turned further, as the head writes it."""
    return (Rotation.from_matrix(transform.rotation) * turn).as_quat(canonical=True, scalar_first=True).tolist()


def with_points(points):
    return lambda sweep: as_at_once(sweep.timestamp_ns, points(sweep.points_lidar))


def as_at_once(time_ns, points):
    """A sweep whose points are known to be of one time."""
    return LidarSweep(timestamp_ns=time_ns, points_lidar=points, time_offset_ns=np.zeros(len(points), dtype=np.int64))
