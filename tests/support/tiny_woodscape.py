"""Two made-up pairs in WoodScape's layout: two things move in front, and a mirror camera sees nothing move."""

import json
from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT = 64, 48
NAMES = ("00000_FV", "00096_MVR")
TIME_US = 1_500_000_000_123_456
WAIT_US = 33_320
OPTIONS = {"body_polygons": {"FV": [[[0, 44], [63, 44], [63, 47], [0, 47]]], "MVR": [[[0, 40], [63, 40], [63, 47]]]}}


def calibration(name: str) -> dict:
    # Front: looks forward, x right, y down; right mirror: looks to the right. Quaternions x, y, z, w.
    quaternion = [-0.5, 0.5, -0.5, 0.5] if name == "FV" else [-0.7071067811865476, 0.0, 0.0, 0.7071067811865476]
    lens = {"model": "radial_poly", "poly_order": 4, "k1": 17.0, "k2": -1.6, "k3": 2.4, "k4": -0.36}
    lens |= {"width": float(WIDTH), "height": float(HEIGHT), "cx_offset": 0.2, "cy_offset": -0.1, "aspect_ratio": 1.0}
    return {
        "name": name,
        "extrinsic": {"quaternion": quaternion, "translation": [3.7, 0.0, 0.66]},
        "intrinsic": lens,
    }


def vehicle(name: str, *, time_us: int) -> dict:
    motion = {"ego_speed": "36.0", "ego_yawRate": "9.0", "ego_distance": "0.3332", "ego_acceleration": "62"}
    motion |= {"ego_gear": "D", "ego_steering": "-1.5"}
    return {"frame_id": f"{name}.png", "timestamp": str(time_us)} | motion


def motion(name: str) -> np.ndarray:
    """Class numbers: a block of 8 x 10 that touches another of 4 x 4 by a corner, one apart, one speck."""
    mask = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    if name.endswith("FV"):
        mask[20:30, 10:18], mask[30:34, 18:22], mask[22:28, 40:50], mask[15, 30] = 5, 9, 14, 5
        mask[45:48, 0:10] = 9  # on the ego vehicle's body
    return mask


def write_data_set(root: Path) -> Path:
    """Write the data set as its loader has it."""
    masks, calibrations = root / "motion_annotations/gtLabels", root / "calibration_data/calibration"
    later, before = root / "vehicle_data/rgb_images", root / "vehicle_data/previous_images"
    for folder in (masks, calibrations, later, before, root / "rgb_images", root / "previous_images"):
        folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(5)
    for name in NAMES:
        pixels = random.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
        assert cv2.imwrite(str(root / "rgb_images" / f"{name}.png"), pixels)
        assert cv2.imwrite(str(root / "previous_images" / f"{name}_prev.png"), np.roll(pixels, 1, axis=1))
        assert cv2.imwrite(str(masks / f"{name}.png"), motion(name))
        (calibrations / f"{name}.json").write_text(json.dumps(calibration(name.split("_")[1])))
        (later / f"{name}.json").write_text(json.dumps(vehicle(name, time_us=TIME_US)))
        (before / f"{name}.json").write_text(json.dumps(vehicle(name, time_us=TIME_US - WAIT_US)))
    return root
