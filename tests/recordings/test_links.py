"""Links to other disks: followed at the top of a root that the user gave, never inside of what lies below."""

import pytest

from bench.errors import DataError
from bench.recordings import load_card, open_dataset
from tests.support import tiny_aimotive, tiny_kitti360, tiny_kitti_raw
from tests.support.data_sets import DATA_SETS, card_of

KITTI, AIMOTIVE = tiny_kitti360.SEQUENCE, tiny_aimotive.SEQUENCE
RAW = tiny_kitti_raw.DATE, f"{tiny_kitti_raw.DATE}/{tiny_kitti_raw.DRIVE}/velodyne_points/data"
PLACES = {  # folders at the top, which may lie on other disks, and one further in
    "kitti-raw": ((RAW[0],), RAW[1]),
    "kitti360": (
        ("data_2d_raw", "data_3d_raw", "data_poses", "data_3d_bboxes", "calibration"),
        f"data_3d_raw/{KITTI}/velodyne_points/data",
    ),
    "woodscape": (("rgb_images", "vehicle_data", "motion_annotations"), "vehicle_data/rgb_images"),
    "aimotive": (("data",), f"{AIMOTIVE}/dynamic/raw-revolutions"),
    "native": (("drive",), "drive/lidar"),
    "rosbag": (("drive",), None),
    "123d": (("drives_test",), "drives_test/drive"),
}


def move_away(path, disk):
    """Put a folder on another disk and a link in its place."""
    disk.mkdir(exist_ok=True)
    path.rename(disk / path.name)
    path.symlink_to(disk / path.name)


def opened(folder, adapter, options):
    return [handle.open() for handle in open_dataset(load_card(card_of(folder, adapter, options)))]


@pytest.mark.parametrize("adapter", DATA_SETS)
def test_folders_at_the_top_may_be_links_and_those_inside_may_not(tmp_path, adapter):
    tops, inner = PLACES[adapter]
    options = DATA_SETS[adapter](tmp_path / "data")
    whole = opened(tmp_path, adapter, options)
    for top in tops:
        move_away(tmp_path / "data" / top, tmp_path / "disk")
    linked = opened(tmp_path, adapter, options)
    assert [recording.sweeps[:1] and recording.sweeps[0].timestamp_ns for recording in linked] == [
        recording.sweeps[:1] and recording.sweeps[0].timestamp_ns for recording in whole
    ]
    assert [set(recording.images) for recording in linked] == [set(recording.images) for recording in whole]
    if adapter != "native":  # there, each recording is a root of its own
        with pytest.raises(DataError, match="a link that leads outside"):
            opened(tmp_path, adapter, options | {"follow_links": 0})
    if inner is not None:
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
