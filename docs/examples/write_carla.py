"""Write a drive of CARLA's sensors in the native format.

Copy this file, and call `write_drive` with what your client recorded. CARLA is left-handed: y points to the right, and
angles are clockwise, in degrees. Here y points to the left, and a vehicle's origin lies below its rear axle. CARLA's
camera is a pinhole, from which an equidistant fisheye of up to 59 degrees off axis is resampled.

A tick is what a synchronous client has after `world.tick()`, with the lidar's `rotation_frequency` at the tick rate:

    time_s   snapshot.timestamp.elapsed_seconds
    ego      ego_vehicle.get_transform()
    image    np.frombuffer(image.raw_data, np.uint8).reshape(image.height, image.width, 4), fov 120, square
    points   np.frombuffer(lidar.raw_data, np.float32).reshape(-1, 4)
    actors   world.get_actors() without the ego vehicle, each with its transform and velocity of this tick
"""

from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

import bench
from bench.cameras.model import ray_grid
from bench.cameras.stored import camera_from_parameters
from bench.geometry import RigidTransform, RoadPlane
from bench.lidar.sweep import LidarSweep
from bench.recordings import Cuboid, MountedCamera, ObjectState, Track

ACTOR_FROM_VEHICLE = RigidTransform.from_yaw(
    0.0, (-1.4, 0.0, 0.0)
)  # the rear axle of your vehicle, from its origin in CARLA
VEHICLE_FROM_CAMERA = RigidTransform.from_quaternion((0.5, -0.5, 0.5, -0.5), (3.7, 0.0, 1.0))  # where you spawned it
VEHICLE_FROM_LIDAR = RigidTransform.from_yaw(0.0, (1.4, 0.0, 2.0))
OUTLINE_M = np.array([[-1.0, -0.9], [3.8, -0.9], [3.8, 0.9], [-1.0, 0.9]])
LENS = camera_from_parameters(
    "equidistant", width=640, height=480, focal=(200.0, 200.0), principal_point=(319.5, 239.5), coefficients=(0.0,) * 4,
    max_angle_rad=1.03,
)  # fmt: skip


def right_handed(transform) -> RigidTransform:
    """world_from_actor of a carla.Transform."""
    turn, place = transform.rotation, transform.location
    rotation = Rotation.from_euler("xyz", [turn.roll, -turn.pitch, -turn.yaw], degrees=True)
    return RigidTransform(rotation=rotation.as_matrix(), translation_m=np.array([place.x, -place.y, place.z]))


def fisheye(image):
    """The (480, 640, 3) BGR image of `LENS` from a square BGRA image of 120 degrees."""
    rays, half = ray_grid(LENS).rays_camera, (len(image) - 1) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        places = half + len(image) / 2 / np.tan(np.radians(60)) * rays[..., :2] / rays[..., 2:]
    return cv2.remap(image[..., :3], *np.moveaxis(places.astype(np.float32), 2, 0), cv2.INTER_LINEAR)


def object_class(actor) -> str:
    """The class of an actor."""
    if actor.type_id.startswith("walker."):
        return "pedestrian"
    return "cyclist" if actor.attributes.get("number_of_wheels") == "2" else "vehicle"


def write_drive(folder: Path, ticks) -> None:
    """Write one recording."""
    writer, states, classes, poses = bench.RecordingWriter(folder), {}, {}, []
    times_ns = np.array([round(tick.time_s * 1e9) for tick in ticks])
    camera = MountedCamera(
        name="front", model=LENS, vehicle_from_camera=VEHICLE_FROM_CAMERA, road=RoadPlane.below(VEHICLE_FROM_CAMERA),
        stored_size_px=(640, 480),
    )  # fmt: skip
    writer.header(
        name=folder.name, licence="CC-BY-4.0", frame_interval_ns=int(np.diff(times_ns).min()),
        cameras={"front": camera}, vehicle_from_lidar=VEHICLE_FROM_LIDAR, vehicle_outline_m=OUTLINE_M,
    )  # fmt: skip
    for time_ns, tick in zip(times_ns.tolist(), ticks, strict=True):
        poses.append(right_handed(tick.ego) @ ACTOR_FROM_VEHICLE)
        writer.image("front", time_ns, fisheye(tick.image))
        points = tick.points[:, :3] * np.array([1, -1, 1], dtype=np.float32)
        writer.sweep(
            LidarSweep(timestamp_ns=time_ns, points_lidar=points, time_offset_ns=np.zeros(len(points), np.int64))
        )
        vehicle_from_world = poses[-1].inverse()
        for actor in (actor for actor in tick.actors if actor.type_id.startswith(("vehicle.", "walker."))):
            box, speed = actor.bounding_box, actor.velocity
            middle = RigidTransform.from_yaw(0.0, (box.location.x, -box.location.y, box.location.z))
            state = ObjectState(
                timestamp_ns=time_ns,
                shape=Cuboid(
                    vehicle_from_object=vehicle_from_world @ right_handed(actor.transform) @ middle,
                    size_m=2 * np.array([box.extent.x, box.extent.y, box.extent.z]),
                ),
                velocity_mps=vehicle_from_world.rotate(np.array([speed.x, -speed.y, speed.z])),
            )
            states.setdefault(f"{actor.id}", []).append(state)
            classes[f"{actor.id}"] = object_class(actor)
    rotations = Rotation.from_matrix([pose.rotation for pose in poses])
    writer.poses(times_ns, rotations, np.array([pose.translation_m for pose in poses]))
    tracks = [Track(track_id=name, object_class=classes[name], states=tuple(of)) for name, of in states.items()]
    writer.annotations(tracks, timestamps_ns=times_ns.tolist())
