"""A rendered drive told as a bag: the commands give what they give for the drive itself."""

import json

import cv2
import numpy as np
import pandas as pd
import pytest

from bench.cameras import camera_parameters
from bench.recordings import load_card, open_dataset
from tests.support import tiny_rosbag as bags
from tests.support.cards import write_card
from tests.support.commands import call

FLOAT = "std_msgs/msg/Float64"


def rig_of(recording):
    cameras = {}
    for name, camera in recording.cameras.items():
        model = json.loads(json.dumps(camera_parameters(camera.model)))
        size_px = [model.pop("width"), model.pop("height")]
        mounting = bags.mounting(camera.vehicle_from_camera)
        cameras[name] = {"topic": f"/{name}", "model": model, "image_size": size_px, "vehicle_from_sensor": mounting}
        cameras[name]["ego_body_mask"] = f"{name}.png"
    speed = {"topic": "/speed", "field": "data"}
    return {
        "frame_interval_ns": recording.frame_interval_ns,
        "vehicle": {"outline_m": recording.vehicle_outline_m.tolist()},
        "cameras": cameras,
        "lidar": {"topic": "/lidar", "vehicle_from_sensor": bags.mounting(recording.vehicle_from_lidar)},
        "ego_motion": {"speed": speed, "yaw_rate": {"topic": "/imu", "field": "angular_velocity.z"}},
    }


def rows_of(recording):
    rows = []
    for name, images in recording.images.items():
        for ref in images:
            pixels = cv2.imread(str(ref.path), cv2.IMREAD_UNCHANGED)
            message = bags.image(ref.timestamp_ns, pixels, "bgr8" if pixels.ndim == 3 else "mono8")
            rows.append((f"/{name}", bags.IMAGE, ref.timestamp_ns, message))
    layout = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<i4")])
    for ref in recording.sweeps:
        sweep = ref.read()
        points = np.zeros(len(sweep.points_lidar), dtype=layout)
        for i, axis in enumerate("xyz"):
            points[axis] = sweep.points_lidar[:, i]
        points["t"] = sweep.time_offset_ns
        rows.append(("/lidar", bags.CLOUD, ref.timestamp_ns, bags.cloud(ref.timestamp_ns, points)))
    bus = pd.read_csv(recording.root / "egomotion.csv")
    for time_ns, speed_mps, turn_radps in zip(bus.timestamp_ns, bus.speed_mps, bus.yaw_rate_radps, strict=True):
        rows.append(("/speed", FLOAT, int(time_ns), bags.message(FLOAT, data=speed_mps)))
        rows.append(("/imu", bags.IMU, int(time_ns), bags.imu(int(time_ns), turn_radps)))
    return sorted(rows, key=lambda row: row[2])


@pytest.fixture(scope="module")
def cards(tiny_card, tmp_path_factory):
    """The card of a drive, and that of the same drive as a bag."""
    folder = tmp_path_factory.mktemp("bags")
    recording = next(h for h in open_dataset(load_card(tiny_card)) if h.name == "crossing").open()
    bags.write_rig(folder / "data", rig_of(recording))
    for name in recording.cameras:
        mask = (recording.root / "ego_body" / f"{name}.png").read_bytes()
        (folder / "data" / f"{name}.png").write_bytes(mask)
    bags.write_bag(folder / "data" / "crossing", rows_of(recording), compression="STORAGE", late_ns=0)
    (folder / "annotations").mkdir()
    (folder / "annotations" / "crossing.json").write_bytes((recording.root / "annotations.json").read_bytes())
    drive = write_card(folder, file="drive.yaml", name="bags", root=str(recording.root))
    return drive, write_card(folder, file="bags.yaml", name="bags", adapter="rosbag", annotations="annotations")


def test_run_gives_the_scores_of_the_drive_itself(monkeypatch, cards, tmp_path):
    summaries = []
    for number, card in enumerate(cards):
        words = ("--method", "frame-difference", "--protocol", "paper-v1", "--no-pictures")
        assert call(monkeypatch, "run", card, *words, "--out", tmp_path / str(number)) == 0
        summaries.append(json.loads((tmp_path / str(number) / "paper-v1" / "summary.json").read_text()))
    drive, bag = summaries
    drive = _without_ceilings(drive)  # a bag holds no exact masks
    assert drive["images"]["evaluated"] > 0
    for part in ("categories", "false_positives", "images", "breakdowns"):
        assert bag[part] == drive[part], part


def _without_ceilings(content):
    if not isinstance(content, dict):
        return content
    assert "ceiling_iou" in content or "iou_detected" not in content
    return {key: _without_ceilings(value) for key, value in content.items() if not key.startswith("ceiling_")}
