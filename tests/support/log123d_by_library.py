"""Write a log of 123D by the library's own writer; run by `write_log_by_library`, where nothing of ours is imported."""

import pickle
import sys
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np

# 300 MB that only parallel conversion needs.
sys.modules |= {name: MagicMock() for name in ("ray", "ray.exceptions", "ray.remote_function")}
from py123d.api.scene.arrow.arrow_log_writer import ArrowLogWriter, SyncConfig  # noqa: E402
from py123d.api.scene.arrow.utils.log_writer_config import LogWriterConfig  # noqa: E402
from py123d.datatypes import LogMetadata, Timestamp  # noqa: E402
from py123d.datatypes.detections.box_detection_label import DefaultBoxDetectionLabel  # noqa: E402
from py123d.datatypes.detections.box_detections import (  # noqa: E402
    BoxDetectionAttributes,
    BoxDetectionSE3,
    BoxDetectionsSE3,
)
from py123d.datatypes.detections.box_detections_metadata import BoxDetectionsSE3Metadata  # noqa: E402
from py123d.datatypes.sensors.base_camera import Camera, camera_metadata_from_dict  # noqa: E402
from py123d.datatypes.sensors.lidar import Lidar, LidarMetadata  # noqa: E402
from py123d.datatypes.vehicle_state.ego_state import EgoStateSE3  # noqa: E402
from py123d.datatypes.vehicle_state.ego_state_metadata import EgoStateSE3Metadata  # noqa: E402
from py123d.geometry import BoundingBoxSE3, PoseSE3, Vector3D  # noqa: E402

root = Path(sys.argv[1])
content = pickle.loads((root / "content.pickle").read_bytes())
settings = dict(word.split("=") for word in sys.argv[2:])
writer = ArrowLogWriter(
    LogWriterConfig(write_route=False, lidar_store_option="binary", **settings), root, root,
    sync_config=SyncConfig(reference_column="lidar.lidar_top.timestamp_us"),
)  # fmt: skip
writer.reset(LogMetadata(dataset="drives", split="drives_test", log_name=content["name"], location=None))
ego = EgoStateSE3Metadata.from_dict(content["ego"])
for time_us, pose in content["poses"]:
    writer.write_async(EgoStateSE3.from_imu(PoseSE3.from_list(pose), ego, Timestamp.from_us(time_us)))
camera = camera_metadata_from_dict(content["camera"])
for time_us, image in content["images"]:
    rgb = np.ascontiguousarray(image[..., ::-1])
    writer.write_async(Camera(camera, rgb, PoseSE3.identity(), Timestamp.from_us(time_us)))
lidar = LidarMetadata.from_dict(content["lidar"])
for start_us, end_us, points, features in content["sweeps"]:
    times = Timestamp.from_us(start_us), Timestamp.from_us(end_us)
    writer.write_async(Lidar(*times, lidar, points, features))
boxes = BoxDetectionsSE3Metadata(DefaultBoxDetectionLabel)
for time_us, rows in content["boxes"]:
    found = [
        BoxDetectionSE3(
            BoxDetectionAttributes(DefaultBoxDetectionLabel(label), token),
            BoundingBoxSE3.from_list(box),
            Vector3D.from_list(velocity),
        )
        for token, label, box, velocity in rows
    ]
    writer.write_async(BoxDetectionsSE3(found, Timestamp.from_us(time_us), boxes))
writer.close()
