"""A small data set for every adapter."""

from bench.plug_ins import imported
from bench.recordings import ADAPTERS
from tests.support import log123d, tiny, tiny_aimotive, tiny_kitti360, tiny_kitti_raw, tiny_rosbag, tiny_woodscape
from tests.support.cards import write_card


def native(root):
    tiny.write_recording(root / "drive")
    return {}


def by(module, **more):
    """Write the small data set of a module, and give the options with which it is read."""

    def write(root):
        module.write_data_set(root)
        return module.OPTIONS | more

    return write


DATA_SETS = {
    "native": native,
    "aimotive": by(tiny_aimotive),
    "kitti-raw": by(tiny_kitti_raw),
    "kitti360": by(tiny_kitti360),
    "woodscape": by(tiny_woodscape, cameras=["FV"]),
    "rosbag": by(tiny_rosbag),
    "123d": by(log123d),
}


def opened(adapter, root, *, annotations=None, **options):
    """The one recording of a folder, by these options of the adapter."""
    listing = imported(ADAPTERS[adapter], expected="an adapter")
    (handle,) = listing(root, options=options, card=root / "card.yaml", annotations=annotations)
    return handle.open()


LABELLED_APART = {"rosbag"}  # annotations only beside the data


def card_of(folder, adapter, options, **content):
    """The card of a data set that lies in `data` beside it."""
    content |= {"annotations": "annotations"} if adapter in LABELLED_APART else {}
    return write_card(folder, adapter=adapter, options=options, **content)
