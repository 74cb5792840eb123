"""Print, as JSON, what 123D's parsers write: splits and tables of cameras by our card, and numbers of labels.

Run by `tests.support.log123d.names_in_123d`, where nothing of ours is imported.
"""

import json
import sys
from importlib import import_module

from py123d.datatypes import CameraID
from py123d.datatypes.detections import BOX_DETECTION_LABEL_REGISTRY as LABELS
from py123d.parser.av2.utils import av2_constants as av2
from py123d.parser.kitti360.utils import kitti360_constants as kitti360
from py123d.parser.nuplan.utils import nuplan_constants as nuplan
from py123d.parser.nuscenes.utils import nuscenes_constants as nuscenes
from py123d.parser.pandaset.utils import pandaset_constants as pandaset
from py123d.parser.physical_ai_av.utils import physical_ai_av_constants as physical_ai_av
from py123d.parser.wod.utils import wod_constants as wod

import_module("py123d.parser.truckdrive.truckdrive_labels")  # adds its own to the labels
NAMES = {
    "argoverse-2-123d": (av2.AV2_SENSOR_SPLITS, av2.AV2_CAMERA_ID_MAPPING.values()),
    "kitti-360-123d": (kitti360.KITTI360_SPLITS, kitti360.KITTI360_FISHEYE_MEI_CAMERA_IDS),
    # Its cameras are named in a module that needs nuPlan's own tools.
    "nuplan-123d": (nuplan.NUPLAN_DATA_SPLITS, CameraID),
    "nuscenes-123d": (nuscenes.NUSCENES_INTERPOLATED_DATA_SPLITS, nuscenes.NUSCENES_CAMERA_IDS),
    "pandaset-123d": (pandaset.PANDASET_SPLITS, pandaset.PANDASET_CAMERA_MAPPING.values()),
    "physical-ai-av-123d": (
        physical_ai_av.PHYSICAL_AI_AV_SPLITS,
        physical_ai_av.PHYSICAL_AI_AV_CAMERA_ID_MAPPING.values(),
    ),
    "waymo-perception-123d": (wod.WOD_PERCEPTION_AVAILABLE_SPLITS, wod.WOD_PERCEPTION_CAMERA_IDS.values()),
}
cards = {card: [sorted(splits), sorted(c.serialize() for c in ids)] for card, (splits, ids) in NAMES.items()}
labels = {kind.__name__: {int(m): [m.name, m.to_default().name] for m in kind} for kind in LABELS.values()}
json.dump({"cards": cards, "labels": labels}, sys.stdout)
