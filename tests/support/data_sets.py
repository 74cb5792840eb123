"""A small data set for every adapter."""

from tests.support import log123d, tiny, tiny_aimotive, tiny_kitti360, tiny_kitti_raw, tiny_rosbag, tiny_woodscape
from tests.support.cards import write_card


def native(root):
    tiny.write_recording(root / "drive")
    return {}


def aimotive(root):
    tiny_aimotive.write_data_set(root)
    return tiny_aimotive.OPTIONS


def kitti360(root):
    tiny_kitti360.write_data_set(root)
    return tiny_kitti360.OPTIONS


def kitti_raw(root):
    tiny_kitti_raw.write_data_set(root)
    return tiny_kitti_raw.OPTIONS


def woodscape(root):
    tiny_woodscape.write_data_set(root)
    return tiny_woodscape.OPTIONS | {"cameras": ["FV"]}


def rosbag(root):
    tiny_rosbag.write_data_set(root)
    return tiny_rosbag.OPTIONS


def log_of_123d(root):
    log123d.write_data_set(root)
    return log123d.OPTIONS


DATA_SETS = {
    "native": native,
    "aimotive": aimotive,
    "kitti-raw": kitti_raw,
    "kitti360": kitti360,
    "woodscape": woodscape,
    "rosbag": rosbag,
    "123d": log_of_123d,
}
LABELLED_APART = {"rosbag"}  # annotations only beside the data


def card_of(folder, adapter, options, **content):
    """The card of a data set that lies in `data` beside it."""
    content |= {"annotations": "annotations"} if adapter in LABELLED_APART else {}
    return write_card(folder, adapter=adapter, options=options, **content)
