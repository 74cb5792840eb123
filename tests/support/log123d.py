"""A recording as a log of 123D: what its tables hold, written by pyarrow, or by the library's own writer."""

import io
import json
import pickle
import subprocess
import sys
from pathlib import Path

import cv2
import msgpack
import numpy as np
import pyarrow as pa

from bench.cameras.angular import RadialPolynomialCamera
from bench.geometry import RigidTransform
from bench.recordings import open_native, read_image
from bench.records.recording import Cuboid, Recording
from tests.support import tiny

CLASSES = {"vehicle": 1, "cyclist": 3, "pedestrian": 4, "animal": 5}  # DefaultBoxDetectionLabel
LABELS = "py123d.datatypes.detections.box_detection_label.DefaultBoxDetectionLabel"
VEHICLE_FROM_IMU = RigidTransform.from_yaw(0.05, (1.2, 0.1, 0.5))
VEHICLE_FROM_AXLE = RigidTransform(np.eye(3), np.array([0.0, 0.0, 0.3]))
VEHICLE_FROM_CENTRE = RigidTransform(np.eye(3), np.array([1.4, 0.0, 0.8]))
LENGTH_M, WIDTH_M, HEIGHT_M = 4.8, 1.8, 1.6
OPTIONS = {"body_polygons": {"ftcam_f0": [[[10, 40], [49, 40], [49, 47], [10, 47]]]}}
# What its writer and its parser of KITTI-360 import beside our libraries.
DISTRIBUTIONS = ("py123d==0.7.0", "pyquaternion", "trimesh", "cachetools", "DracoPy", "networkx", "tqdm")


def se3(pose):
    return [*pose.translation_m.tolist(), *pose.quaternion_wxyz.tolist()]


def micro(time_ns):
    return (int(time_ns) + 500) // 1000


def described(recording: Recording) -> dict:
    """The recording's content in the terms of a log, in plain Python and arrays."""
    imu_from_vehicle = VEHICLE_FROM_IMU.inverse()
    (camera,) = recording.cameras.values()
    lens = camera.model
    assert isinstance(lens, RadialPolynomialCamera)
    assert lens.aspect_ratio == 1
    forward = [0.0, *lens.coefficients, *[0.0] * (5 - len(lens.coefficients))]
    sweeps = []
    for ref in recording.sweeps:
        sweep = ref.read()
        points = (imu_from_vehicle @ recording.vehicle_from_lidar).apply(sweep.points_lidar.astype(np.float64))
        features = {"timestamps": (sweep.times_ns + 500) // 1000}
        features["intensity"] = np.zeros(len(points), dtype=np.uint8)
        sweeps.append((micro(sweep.times_ns.min()), micro(sweep.times_ns.max()), points.astype(np.float32), features))
    boxes: dict[int, list] = {}
    for track in recording.tracks:
        for state in track.states:
            if not isinstance(state.shape, Cuboid):
                continue
            world_from_vehicle = recording.trajectory.world_from_vehicle(state.timestamp_ns)
            box = [*se3(world_from_vehicle @ state.shape.vehicle_from_object), *state.shape.size_m.tolist()]
            velocity = world_from_vehicle.rotate(state.velocity_mps).tolist()
            row = (track.track_id, CLASSES[track.object_class], box, velocity)
            boxes.setdefault(micro(state.timestamp_ns), []).append(row)
    ego_times_ns = recording.trajectory.timestamps_ns.tolist()
    return {
        "name": recording.name,
        "ego": {
            "vehicle_name": "van", "width": WIDTH_M, "length": LENGTH_M, "height": HEIGHT_M, "wheel_base": 2.8,
            "center_to_imu_se3": se3(imu_from_vehicle @ VEHICLE_FROM_CENTRE),
            "rear_axle_to_imu_se3": se3(imu_from_vehicle @ VEHICLE_FROM_AXLE),
        },
        "poses": [
            (micro(t), se3(recording.trajectory.world_from_vehicle(t) @ VEHICLE_FROM_IMU)) for t in ego_times_ns
        ],
        "camera": {
            "camera_model": "ftheta", "camera_name": camera.name, "camera_id": 12,
            "intrinsics": [*lens.principal_point, *forward, *[0.0] * 6],
            "width": lens.width, "height": lens.height,
            "camera_to_imu_se3": se3(imu_from_vehicle @ camera.vehicle_from_camera),
        },
        "images": [(micro(r.timestamp_ns), read_image(r, camera, colour=True)) for r in recording.images[camera.name]],
        "lidar": {
            "lidar_name": "top", "lidar_id": 2,
            "lidar_to_imu_se3": se3(imu_from_vehicle @ recording.vehicle_from_lidar @ recording.lidar_from_sensor),
            "segmentation_label_class": None,
        },
        "sweeps": sweeps,
        "boxes": sorted(boxes.items()),
    }  # fmt: skip


def write_log(recording: Recording, root: Path, *, compression: str | None = "lz4") -> Path:
    """By pyarrow alone, with images as PNG and points as Arrow; the folder of the log."""
    content = described(recording)
    folder = root / "drives_test" / content["name"]
    folder.mkdir(parents=True)

    def table(key, head, columns):
        named = {f"{key}.{name}": pa.array(values, kind) for name, (values, kind) in columns.items()}
        write_table(folder / f"{key}.arrow", pa.table(named), head, compression=compression)

    se3s, times = pa.list_(pa.float64(), 7), pa.int64()
    head = {"dataset": "drives", "split": "drives_test", "log_name": content["name"], "version": "0.7.0"}
    table("sync", head, {"timestamp_us": ([], times)})
    poses_us, poses = zip(*content["poses"], strict=True)
    table("ego_state_se3", content["ego"], {"timestamp_us": (poses_us, times), "imu_se3": (poses, se3s)})
    images_us, images = zip(*content["images"], strict=True)
    data = [cv2.imencode(".png", image)[1].tobytes() for image in images]
    columns = {"timestamp_us": (images_us, times), "data": (data, pa.binary())}
    table("camera.ftcam_f0", content["camera"], columns)
    starts_us, ends_us, points, features = zip(*content["sweeps"], strict=True)
    clouds = [cloud(*one) for one in zip(points, features, strict=True)]
    columns = {"timestamp_us": (starts_us, times), "end_timestamp_us": (ends_us, times), "data": (clouds, pa.binary())}
    table("lidar.lidar_top", content["lidar"], columns)
    boxes_us, rows = zip(*content["boxes"], strict=True)
    tokens, labels, boxes, velocities = ([[row[i] for row in own] for own in rows] for i in range(4))
    columns = {
        "timestamp_us": (boxes_us, times),
        "bounding_box_se3": (boxes, pa.list_(pa.list_(pa.float64(), 10))),
        "track_token": (tokens, pa.list_(pa.string())),
        "label": (labels, pa.list_(pa.uint16())),
        "velocity_3d": (velocities, pa.list_(pa.list_(pa.float64(), 3))),
    }
    table("box_detections_se3", {"box_detection_label_class": LABELS}, columns)
    return folder


def write_table(path: Path, table: pa.Table, head: dict, *, compression: str | None = None) -> None:
    whole = table.replace_schema_metadata({"metadata": msgpack.packb(head)})
    options = pa.ipc.IpcWriteOptions(compression=compression)
    with pa.ipc.new_file(str(path), whole.schema, options=options) as file:
        for batch in whole.to_batches(max_chunksize=2):
            file.write_batch(batch)


def head_of(path: Path) -> dict:
    return msgpack.unpackb(pa.ipc.open_file(path).schema.metadata[b"metadata"])


def cloud(points, features):
    columns = dict(zip("xyz", points.T, strict=True)) | features
    batch = pa.RecordBatch.from_pydict({name: np.ascontiguousarray(values) for name, values in columns.items()})
    sink = io.BytesIO()
    with pa.ipc.new_stream(sink, batch.schema) as stream:
        stream.write_batch(batch)
    return sink.getvalue()


def write_log_by_library(recording: Recording, root: Path, library: Path, **settings: str) -> Path:
    """By the library's own writer, in a process that finds it in the folder `library`; the folder of the log."""
    (root / "content.pickle").write_bytes(pickle.dumps(described(recording)))
    _run_with(library, "log123d_by_library.py", root, *map("=".join, settings.items()))
    return root / "drives_test" / recording.name


def names_in_123d(library: Path) -> dict[str, dict]:
    """Names that parsers of the library write: `cards` -> splits and tables of cameras, `labels` -> number -> names."""
    return json.loads(_run_with(library, "names_by_123d.py"))


def _run_with(library: Path, program: str, *words: str | Path) -> str:
    command = [sys.executable, Path(__file__).with_name(program), *words]
    return subprocess.run(
        command, check=True, env={"PYTHONPATH": str(library)}, stdout=subprocess.PIPE, text=True
    ).stdout


def install_library(folder: Path) -> Path:
    """Install 123D where only `_run_with` finds it: beside our libraries it brings a second OpenCV."""
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", folder, *DISTRIBUTIONS]
    subprocess.run(pip, check=True)
    return folder


def tiny_recording(folder: Path) -> Recording:
    return open_native(tiny.write_recording(folder / "drive"))


def write_data_set(root: Path) -> None:
    write_log(tiny_recording(root.with_name("native")), root)
