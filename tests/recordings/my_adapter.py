"""my_adapter.py: drives with one camera, scans as KITTI has them, and poses; boxes lie in the card's `annotations`."""

from functools import partial

from bench.cameras import camera_from_parameters
from bench.egomotion import read_tum
from bench.errors import DataError
from bench.geometry import RigidTransform, RoadPlane
from bench.lidar import read_sweep
from bench.recordings import ImageRef, MountedCamera, Recording, RecordingHandle, SweepRef, read_annotations

SIZE_PX = (64, 48)
LENS = {"focal": (20.0, 20.0), "principal_point": (31.5, 23.5), "coefficients": (0.05, -0.01, 0.0, 0.0)}
CAMERA = RigidTransform.from_quaternion((0.5, -0.5, 0.5, -0.5), (3.7, 0.0, 0.65))  # vehicle_from_camera
LIDAR = RigidTransform.from_yaw(0.0, (1.2, 0.0, 1.8))  # vehicle_from_lidar


def my_recordings(root, *, options, card, annotations):
    """<drive>/poses.txt (TUM), <drive>/front/<time in us>.png and <drive>/scans/<time in us>.bin."""
    if options:
        raise DataError(card, field="options", expected="none", got=", ".join(options))
    drives = sorted(path.parent for path in root.glob("*/poses.txt"))
    return tuple(RecordingHandle(name=drive.name, opener=partial(open_drive, drive, annotations)) for drive in drives)


def open_drive(drive, annotations):
    """Lists files and reads poses and boxes; images and scans are read when they are wanted."""
    lens = camera_from_parameters("kannala_brandt", width=SIZE_PX[0], height=SIZE_PX[1], **LENS)
    road = RoadPlane.below(CAMERA)
    front = MountedCamera(name="front", model=lens, vehicle_from_camera=CAMERA, road=road, stored_size_px=SIZE_PX)
    boxes = None if annotations is None else annotations / f"{drive.name}.json"
    images = [ImageRef(camera="front", timestamp_ns=t, path=path) for t, path in timed(drive / "front", ".png")]
    sweeps = [SweepRef(timestamp_ns=t, path=path, reader=read_sweep) for t, path in timed(drive / "scans", ".bin")]
    return Recording(
        name=drive.name,
        root=drive,
        licence="internal",
        frame_interval_ns=66_666_667,
        cameras={"front": front},
        images={"front": tuple(images)},
        trajectory=read_tum(drive / "poses.txt"),
        vehicle_from_lidar=LIDAR,
        sweeps=tuple(sweeps),
        tracks=read_annotations(boxes) if boxes is not None and boxes.is_file() else (),
    )


def timed(folder, suffix):
    """Time in nanoseconds and file, by time."""
    return sorted((int(path.stem) * 1000, path) for path in folder.glob(f"*{suffix}"))
