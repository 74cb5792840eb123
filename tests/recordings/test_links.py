"""Links to other disks: followed at the top of a root that the user gave, never inside of what lies below."""

import pytest

from bench.errors import DataError
from bench.recordings import load_card, open_dataset
from tests.support import tiny, tiny_aimotive, tiny_kitti360, tiny_kitti_raw, tiny_woodscape
from tests.support.data_sets import DATA_SETS, card_of

KITTI, AIMOTIVE, PAIR = tiny_kitti360.SEQUENCE, tiny_aimotive.SEQUENCE, tiny_woodscape.NAMES[0]
RAW = f"{tiny_kitti_raw.DATE}/{tiny_kitti_raw.DRIVE}"
INNER = [
    ("kitti-raw", f"{RAW}/velodyne_points/data"),
    ("kitti-raw", f"{RAW}/tracklet_labels.xml"),
    ("kitti360", f"data_3d_raw/{KITTI}/velodyne_points/data"),
    ("kitti360", f"data_2d_raw/{KITTI}/image_02/data_rgb/0000000004.png"),
    ("kitti360", f"data_poses/{KITTI}/poses.txt"),
    ("kitti360", f"data_3d_bboxes/train/{KITTI}.xml"),
    ("kitti360", "calibration/image_02.yaml"),
    ("woodscape", "vehicle_data/rgb_images"),
    ("woodscape", f"rgb_images/{PAIR}.png"),
    ("woodscape", f"motion_annotations/gtLabels/{PAIR}.png"),
    ("aimotive", f"{AIMOTIVE}/dynamic/raw-revolutions"),
    ("aimotive", f"{AIMOTIVE}/sensor/calibration/calibration.json"),
    ("aimotive", f"{AIMOTIVE}/dynamic/box/3d_body/frame_0000101.json"),
    ("rosbag", "drive/drive.mcap"),
    ("123d", "drives_test/drive"),
    ("123d", "drives_test/drive/camera.ftcam_f0.arrow"),
    *(("native", f"drive/{name}") for name in ("lidar", "images/front", "annotations.json", "egomotion.csv")),
    *(("native", f"drive/{name}") for name in ("recording.json", "ego_body/front.png")),
    ("native", f"drive/images/front/{tiny.TIMES_NS[1]}.png"),
]


def move_away(path, disk):
    """Put a file or folder on another disk and a link in its place."""
    disk.mkdir(exist_ok=True)
    path.rename(disk / path.name)
    path.symlink_to(disk / path.name)


def opened(folder, adapter, options):
    return [handle.open() for handle in open_dataset(load_card(card_of(folder, adapter, options)))]


@pytest.mark.parametrize("adapter", DATA_SETS)
def test_folders_at_the_top_may_be_links(tmp_path, adapter):
    options = DATA_SETS[adapter](tmp_path / "data")
    (whole,) = opened(tmp_path, adapter, options)
    for top in [path for path in (tmp_path / "data").iterdir() if path.is_dir()]:
        if top.name != "derived":  # of a file that an option names
            move_away(top, tmp_path / "disk")
    (linked,) = opened(tmp_path, adapter, options)
    assert [ref.timestamp_ns for ref in linked.sweeps] == [ref.timestamp_ns for ref in whole.sweeps]
    assert linked.images.keys() == whole.images.keys()
    if adapter != "native":  # there, each recording is a root of its own
        with pytest.raises(DataError, match="a link that leads outside"):
            opened(tmp_path, adapter, options | {"follow_links": 0})


@pytest.mark.parametrize(("adapter", "inner"), INNER)
def test_what_lies_below_may_not(tmp_path, adapter, inner):
    options = DATA_SETS[adapter](tmp_path / "data")
    move_away(tmp_path / "data" / inner, tmp_path / "elsewhere")
    with pytest.raises(DataError, match="a link that leads outside"):
        opened(tmp_path, adapter, options)


def test_an_option_says_how_far_links_are_followed(tmp_path):
    tiny_kitti360.write_data_set(tmp_path / "data")
    move_away(tmp_path / "data" / "data_3d_raw" / KITTI, tmp_path / "disk")
    with pytest.raises(DataError, match="a link that leads outside"):
        opened(tmp_path, "kitti360", tiny_kitti360.OPTIONS)
    (recording,) = opened(tmp_path, "kitti360", tiny_kitti360.OPTIONS | {"follow_links": 2})
    assert recording.sweeps
    with pytest.raises(DataError, match=r"options\.follow_links: expected .*less than or equal to 4"):
        opened(tmp_path, "kitti360", tiny_kitti360.OPTIONS | {"follow_links": 5})
