"""Convert KITTI-360 by 123D's own parser and writer, with the settings of its own conversion, but for what is stored.

Run by `tests.support.log123d.convert_kitti360`, where nothing of ours is imported.
"""

import sys
from importlib.resources import files
from pathlib import Path
from unittest.mock import MagicMock

import yaml

# 300 MB that only parallel conversion needs.
sys.modules |= {name: MagicMock() for name in ("ray", "ray.exceptions", "ray.remote_function")}
from py123d.api.scene.arrow.arrow_log_writer import ArrowLogWriter, SyncConfig  # noqa: E402
from py123d.api.scene.arrow.utils.log_writer_config import LogWriterConfig  # noqa: E402
from py123d.parser.kitti360.kitti360_parser import Kitti360Parser  # noqa: E402

root, logs = map(Path, sys.argv[1:])
config = yaml.safe_load((files("py123d") / "script/config/conversion/dataset/kitti360.yaml").read_text())
own = config["parser"]
parser = Kitti360Parser(
    **{key: own[key] for key in ("splits", "detection_radius", "train_sequences", "val_sequences", "test_sequences")},
    kitti360_data_root=root,
    detection_cache_root=logs / "preprocessed",
)
inferred = {key: config["log_writer_config"][key] for key in ("infer_ego_dynamics", "infer_box_dynamics")}
stored = {"camera_store_option": "png_binary", "lidar_store_option": "binary", "lidar_codec": "ipc_zstd"}
sync = {key: value for key, value in config["log_writer"]["sync_config"].items() if not key.startswith("_")}
writer = ArrowLogWriter(LogWriterConfig(**inferred, **stored), logs, logs, sync_config=SyncConfig(**sync))
for log in parser.get_log_parsers():
    assert writer.reset(log.get_log_metadata())
    for modalities in log.iter_modalities_sync():
        writer.write_sync(modalities)
    writer.close()
