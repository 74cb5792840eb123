"""Bags of ROS 2 with three images, two sweeps and a drive straight on, small enough to check by hand.

The scene is that of `tiny`: the same camera, pixels, points and objects, told in messages.
"""

from pathlib import Path

import cv2
import numpy as np
import yaml
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from bench.recordings import write_annotations
from tests.support import tiny

STORE = get_typestore(Stores.ROS2_HUMBLE)
IMAGE, COMPRESSED, CLOUD = (f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "PointCloud2"))
ODOMETRY, IMU, TWIST = "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu", "geometry_msgs/msg/TwistStamped"
FRAMES = "tf2_msgs/msg/TFMessage"
FRONT, LIDAR, ODOM, SPEED, YAW = "/camera/front", "/lidar", "/odom", "/wheels", "/imu"
LATE_NS = 4_000_000  # messages are recorded this long after their stamp
SPEED_MPS, TURN_RADPS = 3.0, 0.1
POINT = np.dtype([*((name, "<f4") for name in ("x", "y", "z", "intensity")), ("ring", "<u2"), ("t", "<u4")], align=True)
KINDS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


def mounting(vehicle_from_sensor) -> dict:
    translation_m = vehicle_from_sensor.translation_m.tolist()
    return {"quaternion_wxyz": vehicle_from_sensor.quaternion_wxyz.tolist(), "translation_m": translation_m}


LENS = {"model": "radial_polynomial", "coefficients": [20.0, 0.5, -0.25, 0.0], "principal_point": [31.5, 23.5]}
CAMERA = {
    "topic": FRONT,
    "model": LENS,
    "image_size": [tiny.WIDTH, tiny.HEIGHT],
    "vehicle_from_sensor": mounting(tiny.FRONT),
    "body_polygons": [[[10, 40], [49, 40], [49, 47], [10, 47]]],
}
CLOUDS = {"topic": LIDAR, "time_unit": "ns"}
RIG = {
    "vehicle": {"outline_m": tiny.OUTLINE_M.tolist()},
    "cameras": {"front": CAMERA},
    "lidar": CLOUDS | {"vehicle_from_sensor": mounting(tiny.VEHICLE_FROM_LIDAR)},
    "ego_motion": {"odometry": {"topic": ODOM}},
}
OPTIONS = {"rig": "rig.yaml"}


def message(kind: str, **values):
    return STORE.types[kind](**values)


def header(time_ns: int, frame: str = ""):
    stamp = message("builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)
    return message("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def image(time_ns: int, pixels: np.ndarray, encoding: str = "mono8", *, padding: int = 0, big: bool = False):
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)
    size = {"height": pixels.shape[0], "width": pixels.shape[1], "encoding": encoding, "is_bigendian": int(big)}
    return message(IMAGE, header=header(time_ns), **size, step=rows.shape[1], data=rows.ravel())


def compressed(time_ns: int, pixels: np.ndarray, suffix: str = ".png", kind: str | None = None):
    data = cv2.imencode(suffix, pixels)[1]
    return message(COMPRESSED, header=header(time_ns), format=kind or suffix[1:], data=data)


def cloud(
    time_ns: int, points: np.ndarray, *, frame: str = "", big: bool = False, height: int = 1, row_padding: int = 0
):
    fields = []
    for name, (kind, offset) in points.dtype.fields.items():
        values = {"name": name, "offset": offset, "datatype": KINDS[kind.str[1:]], "count": 1}
        fields.append(message("sensor_msgs/msg/PointField", **values))
    rows = np.pad(points.view(np.uint8).reshape(height, -1), ((0, 0), (0, row_padding)))
    size = {"height": height, "width": len(points) // height, "is_bigendian": big, "is_dense": False}
    size |= {"point_step": points.dtype.itemsize, "row_step": rows.shape[1]}
    return message(CLOUD, header=header(time_ns, frame), fields=fields, data=rows.ravel(), **size)


def sweep_points(index: int) -> np.ndarray:
    sweep = tiny.sweep(index)
    points = np.zeros(len(sweep.points_lidar), dtype=POINT)
    for i, axis in enumerate("xyz"):
        points[axis] = sweep.points_lidar[:, i]
    points["intensity"], points["ring"], points["t"] = sweep.intensity, sweep.ring, sweep.time_offset_ns
    return points


def vector(x: float, y: float, z: float):
    return message("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def quaternion(wxyz):
    w, x, y, z = (float(part) for part in wxyz)
    return message("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def odometry(time_ns: int, position_m, wxyz=(1.0, 0.0, 0.0, 0.0)):
    point = message("geometry_msgs/msg/Point", **dict(zip("xyz", position_m, strict=True)))
    pose = message("geometry_msgs/msg/Pose", position=point, orientation=quaternion(wxyz))
    content = {
        "pose": message("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
        "twist": message("geometry_msgs/msg/TwistWithCovariance", twist=twist(), covariance=np.zeros(36)),
    }
    return message(ODOMETRY, header=header(time_ns, "odom"), child_frame_id="base_link", **content)


def twist():
    return message("geometry_msgs/msg/Twist", linear=vector(SPEED_MPS, 0.0, 0.0), angular=vector(0.0, 0.0, 0.0))


def imu(time_ns: int):
    values = {"orientation": quaternion((1, 0, 0, 0)), "angular_velocity": vector(0.0, 0.0, TURN_RADPS)}
    values["linear_acceleration"] = vector(0.0, 0.0, 9.81)
    covariances = {f"{name}_covariance": np.zeros(9) for name in values}
    return message(IMU, header=header(time_ns), **values, **covariances)


def frames(*entries):
    """Entries of parent, child and parent_from_child."""
    transforms = []
    for parent, child, parent_from_child in entries:
        translation = vector(*parent_from_child.translation_m.tolist())
        rotation = quaternion(parent_from_child.quaternion_wxyz)
        transform = message("geometry_msgs/msg/Transform", translation=translation, rotation=rotation)
        kind = "geometry_msgs/msg/TransformStamped"
        transforms.append(message(kind, header=header(1, parent), child_frame_id=child, transform=transform))
    return message(FRAMES, transforms=transforms)


def drive() -> list[tuple[str, str, int, object]]:
    """Topic, type, stamp and message of the whole drive, by time."""
    rows = []
    for i, time_ns in enumerate(tiny.TIMES_NS):
        rows.append((FRONT, IMAGE, time_ns, image(time_ns, tiny.pixels(i), padding=3)))
        rows.append((ODOM, ODOMETRY, time_ns, odometry(time_ns, (0.2 * i, 0.0, 0.0))))
        if i < 2:
            rows.append((LIDAR, CLOUD, time_ns, cloud(time_ns, sweep_points(i))))
    return sorted(rows, key=lambda row: row[2])


def signals() -> list[tuple[str, str, int, object]]:
    """Speed and yaw rate at their own times, 20 ms apart and 10 ms apart, from before the drive to after it."""
    start, end = tiny.TIMES_NS[0] - 100_000_000, tiny.TIMES_NS[-1] + 100_000_000
    times_ns = range(start, end + 1, 20_000_000)
    rows = [(SPEED, TWIST, t, message(TWIST, header=header(t), twist=twist())) for t in times_ns]
    rows += [(YAW, IMU, t, imu(t)) for t in range(start - 5_000_000, end + 5_000_001, 10_000_000)]
    return rows


def write_bag(
    place: Path, rows, *, storage: str = "mcap", compression: str | None = None, late_ns: int = LATE_NS, store=STORE
) -> Path:
    """Write messages as a bag, and give its file of messages."""
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    writer = Writer(place, version=9, storage_plugin=plugin)
    if compression is not None:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    writer.open()
    connections: dict[tuple[str, str], Connection] = {}
    for topic, kind, time_ns, content in rows:
        if (topic, kind) not in connections:
            connections[topic, kind] = writer.add_connection(topic, kind, typestore=store)
        data = content if isinstance(content, bytes | memoryview) else store.serialize_cdr(content, kind)
        writer.write(connections[topic, kind], time_ns + late_ns, data)
    writer.close()
    return place / f"{place.name}.{'mcap' if storage == 'mcap' else 'db3'}"


def write_rig(root: Path, rig=RIG) -> Path:
    root.mkdir(parents=True, exist_ok=True)
    (root / "rig.yaml").write_text(yaml.safe_dump(rig))
    return root


def write_data_set(root: Path, *, storage: str = "mcap") -> Path:
    """A data set of one recording called "drive"; gives the folder of its annotations."""
    write_rig(root)
    write_bag(root / "drive", drive(), storage=storage)
    folder = root.parent / "annotations"
    folder.mkdir(exist_ok=True)
    write_annotations(folder / "drive.json", tiny.tracks())
    return folder


def data_set(tmp_path, rows, rig=RIG, **options):
    """A data set with one bag of these messages, written with options of `write_bag`."""
    root = write_rig(tmp_path / "data", rig)
    write_bag(root / "drive", rows, **options)
    return root
