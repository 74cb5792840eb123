"""A made-up sequence in the layout of the aiMotive data set: three frames, one sweep, one van that is passed."""

import json
from pathlib import Path

import cv2
import numpy as np

from tests.support.clouds import write_points

SEQUENCE = "data/train/daytime/20260101-000000-tiny@Car"
CAMERA = "M_FISHEYE_R"
FIRST_FRAME = 100
START_NS = 4_833_189_570_000
STEP_NS = 66_666_000
EGO_MPS, RELATIVE_MPS = 30.0, -6.0
TURN_RADPS = 0.2
WIDTH, HEIGHT = 64, 36

# Looks to the right: x of the image backwards, y down.
BODY_FROM_CAMERA = [[-1.0, 0.0, 0.0, 1.0], [0.0, 0.0, -1.0, -0.6], [0.0, -1.0, 0.0, 1.4], [0.0, 0.0, 0.0, 1.0]]
OPTIONS = {
    "cameras": [CAMERA],
    "ground_height_m": -0.1,
    "ego_motion": {
        "file": "derived/{sequence}.csv",
        "columns": {"timestamp_ns": "box_ns", "speed_mps": ["front", "rear"], "yaw_rate_radps": 0.0},
    },
    "body_polygons": {CAMERA: [[[0, 30], [63, 30], [63, 35], [0, 35]]]},
}


def numbers(name: str, axes: str, *values: float) -> dict:
    return {f"{name} {axis}": value for axis, value in zip(axes, values, strict=True)}


def box(frame: int) -> dict:
    seconds = frame * STEP_NS / 1e9
    half_rad = 0.5 * TURN_RADPS * seconds
    return (
        {"ActorName": "VAN 01", "ObjectId": 1, "ObjectType": "VAN", "Occluded": 0, "Truncated": 0}
        | numbers("BoundingBox3D Extent", "XYZ", 5.0, 2.0, 2.2)
        | numbers("BoundingBox3D Orientation Quat", "WXYZ", np.cos(half_rad), 0, 0, np.sin(half_rad))
        | numbers("BoundingBox3D Origin", "XYZ", 2.0 + RELATIVE_MPS * seconds, -4.0, 1.0)
        | numbers("Relative Velocity", "XYZ", RELATIVE_MPS, 0.25, 0.0)
    )


def calibration() -> dict:
    lens = {"model": "mei", "xi": 1.02, "focal_length_px": [28.0, 25.0], "principal_point_px": [32.0, 17.5]}
    lens |= {"distortion_coeffs": [0.027, -0.08, 0, 0, 0], "image_resolution_px": [WIDTH, HEIGHT]}
    camera = lens | {"RT_body_from_sensor": BODY_FROM_CAMERA, "label": CAMERA}
    return {"F_LRR_C": {"sensor_type": "radar"}, CAMERA: camera}


def box_file(folder: Path, frame: int) -> Path:
    return folder / f"dynamic/box/3d_body/frame_{FIRST_FRAME + frame:07d}.json"


def write_data_set(root: Path) -> Path:
    folder = root / SEQUENCE
    images = folder / "sensor/camera" / CAMERA
    for place in (f"sensor/camera/{CAMERA}", "sensor/calibration", "dynamic/raw-revolutions", "dynamic/box/3d_body"):
        (folder / place).mkdir(parents=True)
    (folder / "sensor/calibration/calibration.json").write_text(json.dumps(calibration()))
    lines = ["# made up", "frame,box_ns,front,rear"]
    for frame in range(3):
        time_ns = START_NS + frame * STEP_NS
        boxes = {"CapturedObjects": [box(frame)], "Timestamp": str(time_ns)}
        box_file(folder, frame).write_text(json.dumps(boxes))
        pixels = np.full((HEIGHT, WIDTH), 50 * frame, np.uint8)
        assert cv2.imwrite(str(images / f"{CAMERA}_{FIRST_FRAME + frame:07d}.jpg"), pixels)
        lines.append(f"{FIRST_FRAME + frame},{time_ns},{EGO_MPS - 0.5},{EGO_MPS + 0.5}")
    points = np.array([[2.0, -3.0, 1.0], [2.5, -3.0, 1.0]])
    times = START_NS + np.array([-67_894_000.0, 32_355_000.0])
    sweep = folder / f"dynamic/raw-revolutions/frame_{FIRST_FRAME:07d}.laz"
    write_points(sweep, {"points_lidar": points, "intensity": np.array([0, 255]), "gps_time": times})
    (root / "derived").mkdir()
    (root / f"derived/{folder.name}.csv").write_text("\n".join(lines) + "\n")
    return folder
