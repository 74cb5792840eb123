"""A made-up sequence in KITTI-360's layout: a car that overtakes on the right, a parked one and a person.

The ego vehicle drives at 5 m/s, the global world has z up and the ego vehicle a heading of 30 degrees in it. Lidar
returns are computed here, each at its own time by its azimuth, with plain matrices and none of the adapter's code.
"""

from functools import cache
from pathlib import Path

import cv2
import numpy as np

SEQUENCE = "2013_05_28_drive_0003_sync"
FRAMES, PERIOD_S = 12, 0.1036
START_NS = 1_369_730_762_904_219_904  # 2013-05-28 08:46:02.904219904
SCANNER_LATER_NS = 6_000_000  # what the scanner notes for the instant of a frame
HEADING_RAD = np.radians(30)
EGO_MPS, CAR_MPS = 5.0, 9.0
ORIGIN = np.array([1200.0, 3400.0, 110.0])  # of the drive in the global world
CAR_SIZE = np.array([4.4, 1.8, 1.5])
NO_POSE = {0, 5}
SIZE = 140

# Vehicle frame: x forward, y left, z up, on the road below the rear axle.
VEHICLE_FROM_IMU = np.array([[1, 0, 0, -0.04], [0, -1, 0, 0.3], [0, 0, -1, 0.9], [0, 0, 0, 1.0]])
VEHICLE_FROM_LIDAR = np.array([[1, 0, 0, 0.76], [0, 1, 0, 0], [0, 0, 1, 1.73], [0, 0, 0, 1.0]])
IMU_FROM_CAMERA = {
    "image_00": "0 0 1 1.6 1 0 0 0 0 1 0 -0.65",
    "image_02": "1 0 0 0.73 0 0 -1 -0.15 0 1 0 -1.07",
    "image_03": "-1 0 0 0.70 0 0 1 0.75 0 1 0 -1.08",
}
LIDAR_FROM_CAMERA_00 = "0 0 1 0.8 -1 0 0 0.3 0 -1 0 -0.18"
FISHEYE = """%YAML:1.0
model_type: MEI
camera_name: {name}
image_width: 140
image_height: 140
mirror_parameters:
   xi: 2.2
distortion_parameters:
   k1: 1.6e-02
   k2:1.65
   p1: 4.2e-03
   p2: -3.0e-03
projection_parameters:
   gamma1: 133.0
   gamma2: 132.0
   u0: 70.5
   v0: 69.0
"""
OPTIONS = {"body_polygons": {name: [[[60, 125], [80, 125], [80, 139], [60, 139]]] for name in ("image_02", "image_03")}}


def time_ns(frame: float) -> int:
    return START_NS + round(frame * PERIOD_S * 1e9)


def stamp(frame: int, later_ns: int = 0) -> str:
    seconds, rest = divmod(time_ns(frame) - START_NS + 2_904_219_904 + later_ns, 1_000_000_000)
    return f"2013-05-28 08:46:{seconds:02d}.{rest:09d}"


def rotation_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def global_from_vehicle(frame: float) -> np.ndarray:
    """The ego vehicle at any time, in frames."""
    pose = np.eye(4)
    pose[:3, :3] = rotation_z(HEADING_RAD)
    pose[:3, 3] = ORIGIN + pose[:3, 0] * EGO_MPS * PERIOD_S * frame
    return pose


def car_centre(frame: float) -> np.ndarray:
    """The moving car's centre, global world; beside the ego vehicle at frame 6."""
    beside = (global_from_vehicle(6) @ [0.5, -5.0, 0.85, 1.0])[:3]
    return beside + rotation_z(HEADING_RAD)[:, 0] * CAR_MPS * PERIOD_S * (frame - 6)


def surface(steps: int = 12) -> np.ndarray:
    """Points all over the car, object frame."""
    axis = np.linspace(-0.49, 0.49, steps)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[np.abs(grid).max(axis=1) > 0.48] * CAR_SIZE


def in_vehicle(frame: float, points_global: np.ndarray) -> np.ndarray:
    pose = global_from_vehicle(frame)
    return (points_global - pose[:3, 3]) @ pose[:3, :3]


def car_at(frame: float) -> np.ndarray:
    """The car's surface in the vehicle frame of the same time, (N, 3)."""
    return in_vehicle(frame, car_centre(frame) + surface() @ rotation_z(HEADING_RAD).T)


@cache
def scan(frame: int) -> np.ndarray:
    """Returns of the moving car and of the road, each measured when the clockwise beam came by."""
    offsets = surface() @ rotation_z(HEADING_RAD).T
    moments = np.full(len(offsets), float(frame))
    for _ in range(30):
        along = rotation_z(HEADING_RAD)[:, 0] * PERIOD_S * (moments - frame)[:, None]
        world = car_centre(frame) + CAR_MPS * along + offsets
        ego = global_from_vehicle(frame)[:3, 3] + EGO_MPS * along
        seen = (world - ego) @ rotation_z(HEADING_RAD) - VEHICLE_FROM_LIDAR[:3, 3]
        moments = frame - np.arctan2(seen[:, 1], seen[:, 0]) / (2 * np.pi)
    around = np.linspace(-3, 3, 50)
    road = np.column_stack([12 * np.cos(around), 12 * np.sin(around), np.full(50, -1.73)])
    return np.column_stack([np.vstack([seen, road]), np.full(len(seen) + 50, 0.5)]).astype("<f4")


def matrix_xml(name: str, values: np.ndarray) -> str:
    data = "\n ".join(" ".join(f"{v:.9g}" for v in row) for row in values)
    rows, cols = values.shape
    head = f"<rows>{rows}</rows><cols>{cols}</cols><dt>f</dt>"
    return f'<{name} type_id="opencv-matrix">{head}<data>\n {data}</data></{name}>'


# x ahead, in the order of the data set (kitti360Scripts #135)
CORNERS = 0.5 * np.array(
    [[1, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1], [-1, 1, -1], [-1, 1, 1], [-1, -1, -1], [-1, -1, 1]]
)
FACES = np.array([[0, 2, 1], [2, 3, 1], [4, 6, 5], [6, 7, 5]])


def object_xml(
    number: int, *, label: str, semantic: int, instance: int, centre, size, frame=-1, heading=HEADING_RAD, axes=None
):
    """A box whose local axes are length, width, height, or the columns of `axes` in those."""
    axes = np.eye(3) if axes is None else np.array(axes)
    transform = np.eye(4)
    transform[:3, :3] = rotation_z(heading) @ axes @ np.diag(np.abs(axes).T @ size)
    transform[:3, 3] = centre
    fields = {"index": number, "label": label, "semanticId": semantic, "instanceId": instance, "timestamp": frame}
    fields |= {"dynamic": int(frame >= 0), "dynamicSeq": 0 if frame >= 0 else -1, "start_frame": 1, "end_frame": 10}
    told = "".join(f"<{name}>{value}</{name}>" for name, value in fields.items())
    boxed = matrix_xml("transform", transform) + matrix_xml("vertices", CORNERS) + matrix_xml("faces", FACES)
    return f"<object{number}>{told}{boxed}</object{number}>\n"


def boxes_xml(*, axes=None, more: str = "") -> str:
    """Those of the data set, the moving car's drawn along `axes`, and more objects."""
    car = {"label": "car", "semantic": 13, "instance": 3, "size": CAR_SIZE, "axes": axes}
    moving = [object_xml(n, **car, centre=car_centre(n), frame=n) for n in range(1, 11)]
    beside = global_from_vehicle(6) @ np.array([[8, 4, 0.8, 1], [3, -9, 0.9, 1], [0, 40, 5, 1.0], [600, 4, 1, 1]]).T
    parked, person, house, far = beside.T[:, :3]
    return (
        '<?xml version="1.0"?>\n<opencv_storage>\n'
        + "".join(moving)
        + object_xml(50, label="car", semantic=13, instance=4, centre=parked, size=(4.0, 1.7, 1.4))
        + object_xml(51, label="person", semantic=19, instance=1, centre=person, size=(0.6, 0.5, 1.8))
        + object_xml(52, label="building", semantic=11, instance=0, centre=house, size=(20.0, 10.0, 10.0))
        + object_xml(53, label="car", semantic=13, instance=5, centre=far, size=(4.0, 1.7, 1.4))
        + f"<object54><label>sky</label><timestamp>-1</timestamp></object54>\n{more}</opencv_storage>\n"
    )


def write_data_set(root: Path) -> Path:
    calibration = root / "calibration"
    calibration.mkdir(parents=True)
    lines = [f"{name}: {numbers} \n" for name, numbers in IMU_FROM_CAMERA.items()]
    (calibration / "calib_cam_to_pose.txt").write_text("".join(lines))
    (calibration / "calib_cam_to_velo.txt").write_text(LIDAR_FROM_CAMERA_00)
    stamps, scanner_stamps = ("".join(f"{stamp(n, later)}\n" for n in range(FRAMES)) for later in (0, SCANNER_LATER_NS))
    random = np.random.default_rng(3)
    for name in ("image_02", "image_03"):
        (calibration / f"{name}.yaml").write_text(FISHEYE.format(name=name))
        folder = root / "data_2d_raw" / SEQUENCE / name
        (folder / "data_rgb").mkdir(parents=True)
        (folder / "timestamps.txt").write_text(stamps)
        for n in range(FRAMES):
            pixels = random.integers(0, 90, (SIZE, SIZE, 3), dtype=np.uint8)
            assert cv2.imwrite(str(folder / "data_rgb" / f"{n:010d}.png"), pixels)
    scans = root / "data_3d_raw" / SEQUENCE / "velodyne_points"
    (scans / "data").mkdir(parents=True)
    (scans / "timestamps.txt").write_text(scanner_stamps)
    for n in range(FRAMES):
        scan(n).tofile(scans / "data" / f"{n:010d}.bin")
    poses = root / "data_poses" / SEQUENCE
    poses.mkdir(parents=True)
    rows = [[n, *(global_from_vehicle(n) @ VEHICLE_FROM_IMU)[:3].ravel()] for n in range(FRAMES) if n not in NO_POSE]
    np.savetxt(poses / "poses.txt", rows, fmt=["%d", *["%.9f"] * 12])
    boxes = root / "data_3d_bboxes" / "train"
    boxes.mkdir(parents=True)
    (boxes / f"{SEQUENCE}.xml").write_text(boxes_xml())
    return root
