"""A made-up drive in the layout of KITTI's raw data: a car ahead that drives away, and a parked one.

The ego vehicle drives at 5 m/s with a heading of 30 degrees from east to the left. Returns are computed here, each at
its own time by its azimuth, with plain matrices and none of the adapter's code.
"""

from pathlib import Path

import cv2
import numpy as np

from tests.support.tiny_kitti360 import CAR_SIZE as CAR_SIZE_M
from tests.support.tiny_kitti360 import rotation_z, surface

DATE, DRIVE = "2011_09_26", "2011_09_26_drive_0001_sync"
FRAMES, PERIOD_NS, SCAN_LATER_NS = 8, 103_600_000, 2_000_000
START_NS = 1_317_042_165_500_000_000  # 2011-09-26 13:02:45.5
LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M = 49.01, 8.43, 116.0
HEADING_RAD = np.radians(30)
EGO_MPS, CAR_MPS = 5.0, 9.0
WIDTH, HEIGHT = 124, 37

LIDAR_M, IMU_IN_LIDAR_M = np.array([0.76, 0.0, 1.73]), np.array([-0.81, 0.32, -0.8])
CAMERA_0_FROM_LIDAR = np.array([[0, -1, 0, 0.0], [0, 0, -1, -0.08], [1, 0, 0, -0.27]])
FOCAL_PX, CENTRE_PX, RIGHT_M = 72.0, (60.5, 17.25), 0.06  # of image_02, which sits so far right of image_00
CAMERA_M = LIDAR_M + np.array([0.27, -RIGHT_M, -0.08])
OPTIONS = {"body_polygons": {"image_02": [[[50, 34], [70, 34], [70, 36], [50, 36]]]}}


def time_ns(frame: float, later_ns: int = 0) -> int:
    return START_NS + round(frame * PERIOD_NS) + later_ns


def stamps(later_ns: int = 0) -> str:
    times = (np.datetime64(time_ns(n, later_ns), "ns") for n in range(FRAMES))
    return "".join(f"{str(time).replace('T', ' ')}\n" for time in times)


def ego_m(time: int) -> np.ndarray:
    """The vehicle's origin in a world with x to the east."""
    return rotation_z(HEADING_RAD)[:, 0] * EGO_MPS * (time - START_NS) / 1e9


def car_in_vehicle_m(time: int) -> np.ndarray:
    """The moving car's centre, vehicle frame of the same time."""
    return np.array([8.0 + (CAR_MPS - EGO_MPS) * (time - START_NS) / 1e9, -3.0, 0.85])


PARKED_M = np.array([9.0, 4.0, 0.8])  # in the vehicle frame at the start


def scan(frame: int) -> np.ndarray:
    """Returns of the moving car and of the road, each measured when the beam, which turns to the left, came by."""
    at_ns = time_ns(frame, SCAN_LATER_NS)
    later_s = np.zeros(len(surface()))
    for _ in range(30):
        seen = car_in_vehicle_m(at_ns) + surface() - LIDAR_M
        seen[:, 0] += (CAR_MPS - EGO_MPS) * later_s
        later_s = np.arctan2(seen[:, 1], seen[:, 0]) / (2 * np.pi) * PERIOD_NS / 1e9
    around = np.linspace(-3, 3, 50)
    road = np.column_stack([12 * np.cos(around), 12 * np.sin(around), np.full(50, -1.73)])
    return np.column_stack([np.vstack([seen, road]), np.full(len(seen) + 50, 0.5)]).astype("<f4")


def oxts(frame: int) -> str:
    world_from_vehicle = rotation_z(HEADING_RAD)
    imu_m = ego_m(time_ns(frame)) + world_from_vehicle @ (LIDAR_M + IMU_IN_LIDAR_M)
    per_radian_m = np.cos(np.radians(LATITUDE_DEG)) * 6_378_137.0
    longitude = LONGITUDE_DEG + np.degrees(imu_m[0] / per_radian_m)
    north = np.log(np.tan(np.pi / 4 + np.radians(LATITUDE_DEG) / 2)) + imu_m[1] / per_radian_m
    latitude = np.degrees(2 * np.arctan(np.exp(north)) - np.pi / 2)
    fields = [latitude, longitude, ALTITUDE_M + imu_m[2], 0.0, 0.0, HEADING_RAD, *[0.0] * 19, 4, 10, 4, 4, 0]
    return " ".join(f"{value:.15g}" for value in fields)


def tracklet(label: str, size_m: np.ndarray, centres_m: list[np.ndarray]) -> str:
    length, width, height = size_m
    poses = "".join(
        f"<item><tx>{x}</tx><ty>{y}</ty><tz>{z - height / 2}</tz><rx>0</rx><ry>0</ry><rz>0</rz><state>2</state>"
        "<occlusion>0</occlusion><occlusion_kf>0</occlusion_kf><truncation>0</truncation></item>\n"
        for x, y, z in (centre - LIDAR_M for centre in centres_m)
    )
    return (
        f"<item><objectType>{label}</objectType><h>{height}</h><w>{width}</w><l>{length}</l><first_frame>1</first_frame>"
        f"<poses><count>{len(centres_m)}</count><item_version>2</item_version>{poses}</poses><finished>1</finished></item>"
    )


def tracklets() -> str:
    times = [time_ns(n, SCAN_LATER_NS) for n in range(1, FRAMES)]
    parked = [PARKED_M - [EGO_MPS * (time - START_NS) / 1e9, 0, 0] for time in times]
    items = tracklet("Car", CAR_SIZE_M, [car_in_vehicle_m(time) for time in times])
    items += tracklet("Van", np.array([5.0, 2.0, 1.6]), parked)
    return (
        '<?xml version="1.0" encoding="UTF-8" standalone="yes" ?>\n<!DOCTYPE boost_serialization>\n'
        '<boost_serialization signature="serialization::archive" version="9"><tracklets class_id="0">'
        f"<count>2</count><item_version>1</item_version>{items}</tracklets></boost_serialization>\n"
    )


def row(name: str, *values: object) -> str:
    return f"{name}: {' '.join(str(value) for part in values for value in np.ravel(part))}\n"


def write_data_set(root: Path) -> Path:
    date = root / DATE
    date.mkdir(parents=True)
    (u, v), eye = CENTRE_PX, np.eye(3)
    projection = [[FOCAL_PX, 0, u, -RIGHT_M * FOCAL_PX], [0, FOCAL_PX, v, 0], [0, 0, 1, 0]]
    rows = row("R_rect_00", eye) + row("S_rect_02", [WIDTH, HEIGHT]) + row("P_rect_02", projection)
    (date / "calib_cam_to_cam.txt").write_text(f"calib_time: 09-Jan-2012 13:57:47\n{rows}")
    (date / "calib_velo_to_cam.txt").write_text(
        row("R", CAMERA_0_FROM_LIDAR[:, :3]) + row("T", CAMERA_0_FROM_LIDAR[:, 3]) + row("delta_f", [0, 0])
    )
    (date / "calib_imu_to_velo.txt").write_text(row("R", eye) + row("T", IMU_IN_LIDAR_M))
    drive = date / DRIVE
    for name, later_ns in (("image_02", 0), ("velodyne_points", SCAN_LATER_NS), ("oxts", 0)):
        (drive / name / "data").mkdir(parents=True)
        (drive / name / "timestamps.txt").write_text(stamps(later_ns))
    random = np.random.default_rng(3)
    for n in range(FRAMES):
        pixels = random.integers(0, 90, (HEIGHT, WIDTH, 3), dtype=np.uint8)
        assert cv2.imwrite(str(drive / "image_02/data" / f"{n:010d}.png"), pixels)
        scan(n).tofile(drive / "velodyne_points/data" / f"{n:010d}.bin")
        (drive / "oxts/data" / f"{n:010d}.txt").write_text(oxts(n))
    (drive / "tracklet_labels.xml").write_text(tracklets())
    return root
