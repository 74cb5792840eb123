"""Several broken files of a data set at once: each fault is told, and what is whole is kept."""

import json

import pytest

from bench.adapters.aimotive.adapter import aimotive_recordings
from bench.adapters.kitti360.adapter import kitti360_recordings
from bench.adapters.woodscape.adapter import woodscape_recordings
from bench.errors import DataError
from tests.support import tiny_aimotive, tiny_kitti360, tiny_woodscape
from tests.support.planting import change_json


def read_leniently(adapter, root, options, number=0):
    handle = adapter(root, options=options, card=root / "card.yaml", annotations=None)[number]
    assert handle.lenient
    return handle.read_leniently()


def told(found):
    return sorted(str(fault) for fault in found.errors)


def assert_told(found, *parts, others=0):
    """Each part is in exactly one fault, and there are no more faults than these and `others`."""
    lines = told(found)
    assert [sum(part in line for line in lines) for part in parts] == [1] * len(parts), lines
    assert len(lines) == len(parts) + others


ADAPTERS = {
    "kitti360": (kitti360_recordings, tiny_kitti360),
    "aimotive": (aimotive_recordings, tiny_aimotive),
    "woodscape": (woodscape_recordings, tiny_woodscape),
}


@pytest.mark.parametrize("name", ADAPTERS)
def test_of_a_whole_recording_nothing_is_missing(tmp_path, name):
    adapter, tiny = ADAPTERS[name]
    tiny.write_data_set(tmp_path)
    handle = adapter(tmp_path, options=tiny.OPTIONS, card=tmp_path / "card.yaml", annotations=None)[0]
    found, opened = handle.read_leniently(), handle.open()
    assert (found.errors, found.missing) == ((), frozenset())
    assert found.recording.images == opened.images
    assert [sweep.path for sweep in found.recording.sweeps] == [sweep.path for sweep in opened.sweeps]
    assert [track.track_id for track in found.recording.tracks] == [track.track_id for track in opened.tracks]
    assert list(found.recording.cameras) == list(opened.cameras)


@pytest.fixture
def kitti360(tmp_path):
    return tiny_kitti360.write_data_set(tmp_path / "KITTI-360")


def edit(path, old, new, count=-1):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))


def test_kitti360_boxes_poses_times_and_a_camera(kitti360):
    sequence = tiny_kitti360.SEQUENCE
    boxes = kitti360 / "data_3d_bboxes/train" / f"{sequence}.xml"
    edit(boxes, "<timestamp>3</timestamp>", "<timestamp>soon</timestamp>")
    edit(boxes, "<end_frame>10</end_frame>", "<end_frame>-0</end_frame>", 1)
    poses = kitti360 / "data_poses" / sequence / "poses.txt"
    lines = poses.read_text().splitlines()
    lines[2], lines[5] = "4 nan 0 0 0 0 1 0 0 0 0 1 0", lines[4]
    poses.write_text("\n".join(lines))
    edit(kitti360 / "calibration/image_03.yaml", "model_type: MEI", "model_type: PINHOLE")
    edit(kitti360 / "data_2d_raw" / sequence / "image_02/timestamps.txt", "2013-05-28 08:46:03", "28.05.2013")
    found = read_leniently(kitti360_recordings, kitti360, tiny_kitti360.OPTIONS)
    times = sum("image_02/timestamps.txt: line" in line for line in told(found))
    assert times >= 2  # each line that is no time
    assert_told(
        found,
        "object3.timestamp: expected a whole number, got 'soon'",
        "object1.end_frame: expected 1 or later, got 0",
        "poses.txt: line 3: expected finite numbers, got 'nan'",
        "poses.txt: line 6: expected frames that increase, got 6 after 6",
        "image_03.yaml: model_type",
        others=times,
    )
    # The other camera's clock stands in, so images and scans can be looked at.
    assert list(found.recording.cameras) == ["image_02"]
    assert len(found.recording.images["image_02"]) == tiny_kitti360.FRAMES
    assert len(found.recording.sweeps) == tiny_kitti360.FRAMES
    assert found.missing == {"trajectory", "annotations"}


def test_kitti360_bad_boxes_do_not_cost_the_good_ones(kitti360):
    boxes = kitti360 / "data_3d_bboxes/train" / f"{tiny_kitti360.SEQUENCE}.xml"
    edit(boxes, "<semanticId>13</semanticId><instanceId>4</instanceId>", "<semanticId>x</semanticId>")
    found = read_leniently(kitti360_recordings, kitti360, tiny_kitti360.OPTIONS)
    assert ["object50.semanticId" in line for line in told(found)] == [True]
    assert not found.missing
    assert {track.object_class for track in found.recording.tracks} == {"vehicle", "pedestrian"}


def test_kitti360_without_the_place_of_the_scanner_every_other_file_is_still_read(kitti360):
    (kitti360 / "calibration/calib_cam_to_velo.txt").write_text("0 0 1")
    edit(kitti360 / "calibration/calib_cam_to_pose.txt", "image_03: -1", "image_03: one")
    poses = kitti360 / "data_poses" / tiny_kitti360.SEQUENCE / "poses.txt"
    poses.write_text("1 2 3\n" + poses.read_text())
    boxes = kitti360 / "data_3d_bboxes/train" / f"{tiny_kitti360.SEQUENCE}.xml"
    boxes.write_text(boxes.read_text()[:-200])
    found = read_leniently(kitti360_recordings, kitti360, tiny_kitti360.OPTIONS)
    assert_told(
        found,
        "calib_cam_to_velo.txt: calib_cam_to_velo: expected 12 numbers, got 3",
        "calib_cam_to_pose.txt: image_03: expected finite numbers, got 'one'",
        "poses.txt: line 1: expected 13 numbers, got 3",
        "expected well-formed XML",
    )
    assert found.recording is None


@pytest.fixture
def aimotive(tmp_path):
    tiny_aimotive.write_data_set(tmp_path / "aimotive")
    return tmp_path / "aimotive"


def test_aimotive_boxes_calibration_and_ego_motion(aimotive):
    folder = aimotive / tiny_aimotive.SEQUENCE
    second, third = (tiny_aimotive.box_file(folder, n) for n in (1, 2))
    change_json(second, lambda boxes: boxes["CapturedObjects"].append(tiny_aimotive.box(1) | {"ObjectType": "TRAM"}))
    wrong = {"BoundingBox3D Extent X": -1.0, "Relative Velocity Y": "fast"}
    change_json(third, lambda boxes: boxes["CapturedObjects"][0].update(wrong))
    thin = tiny_aimotive.calibration()[tiny_aimotive.CAMERA] | {"model": "thin"}
    change_json(folder / "sensor/calibration/calibration.json", lambda head: head.update(M_FISHEYE_L=thin))
    motion = next((aimotive / "derived").iterdir())
    edit(motion, ",29.5,", ",quick,", 1)
    options = tiny_aimotive.OPTIONS | {"cameras": ["M_FISHEYE_L", tiny_aimotive.CAMERA]}
    found = read_leniently(aimotive_recordings, aimotive, options)
    assert_told(
        found,
        "CapturedObjects.1.ObjectType: expected one of",
        "CapturedObjects.1.ObjectId: expected each object once, got 1 twice",
        "CapturedObjects.0.BoundingBox3D Extent X: expected greater than 0, got -1.0",
        "CapturedObjects.0.Relative Velocity Y: expected a valid number, got 'fast'",
        "M_FISHEYE_L.model: expected 'mei' or 'opencv_pinhole', got 'thin'",
        "front, row 1: expected a finite number, got 'quick'",
    )
    assert list(found.recording.cameras) == [tiny_aimotive.CAMERA]
    assert len(found.recording.images[tiny_aimotive.CAMERA]) == 1  # of the frames whose time is known
    assert len(found.recording.sweeps) == 1
    assert found.missing == {"trajectory", "annotations"}


def test_aimotive_without_calibration(aimotive):
    folder = aimotive / tiny_aimotive.SEQUENCE
    (folder / "sensor/calibration/calibration.json").write_text("[")
    tiny_aimotive.box_file(folder, 0).write_text("{}")
    found = read_leniently(aimotive_recordings, aimotive, tiny_aimotive.OPTIONS)
    assert_told(found, "calibration.json: expected JSON", "Timestamp: expected a value", "CapturedObjects: expected a")
    assert found.recording is None


def with_its_own_odometry(aimotive):
    """Options without another source of ego-motion, and poses for every frame."""
    file = aimotive / tiny_aimotive.SEQUENCE / "sensor/gnssins/egomotion.json"
    file.parent.mkdir(parents=True)
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    frames = range(tiny_aimotive.FIRST_FRAME, tiny_aimotive.FIRST_FRAME + 3)
    file.write_text(json.dumps({str(frame): {"RT_ECEF_body": pose} for frame in frames}))
    return {key: value for key, value in tiny_aimotive.OPTIONS.items() if key != "ego_motion"}


def test_aimotive_a_frame_out_of_order_is_told_of_its_own_file(aimotive):
    options = with_its_own_odometry(aimotive)
    file = tiny_aimotive.box_file(aimotive / tiny_aimotive.SEQUENCE, 1)
    change_json(file, lambda boxes: boxes.update(Timestamp="1"))
    found = read_leniently(aimotive_recordings, aimotive, options)
    (line,) = told(found)
    assert f"{file.name}: Timestamp: expected times that increase, got 1 after" in line
    assert not found.missing
    handle = aimotive_recordings(aimotive, options=options, card=aimotive / "card.yaml", annotations=None)[0]
    with pytest.raises(DataError) as caught:
        handle.open()
    assert str(caught.value) == line


def test_aimotive_without_boxes_there_are_no_times(aimotive):
    options = with_its_own_odometry(aimotive)
    for file in (aimotive / tiny_aimotive.SEQUENCE / "dynamic/box/3d_body").iterdir():
        file.unlink()
    found = read_leniently(aimotive_recordings, aimotive, options)
    assert any("expected files frame_<number>.json, which hold the times of frames" in line for line in told(found))
    assert found.recording is None


@pytest.fixture
def woodscape(tmp_path):
    return tiny_woodscape.write_data_set(tmp_path / "WoodScape")


def test_woodscape_every_file_of_a_pair(woodscape):
    name = tiny_woodscape.NAMES[0]
    (woodscape / "previous_images" / f"{name}_prev.png").unlink()
    (woodscape / "motion_annotations/gtLabels" / f"{name}.png").unlink()
    later = woodscape / "vehicle_data/rgb_images" / f"{name}.json"
    change_json(later, lambda state: state.update(ego_speed="fast", timestamp="-1"))
    (woodscape / "vehicle_data/previous_images" / f"{name}.json").write_text("{")
    found = read_leniently(woodscape_recordings, woodscape, tiny_woodscape.OPTIONS)
    assert_told(
        found,
        "_prev.png: expected a file in previous_images",
        f"gtLabels/{name}.png: expected a file in motion_annotations",
        "ego_speed: expected a valid number, got 'fast'",
        f"rgb_images/{name}.json: timestamp",
        f"previous_images/{name}.json: expected JSON",
    )
    (image,) = found.recording.images["FV"]
    assert image.moving_path is None
    assert found.missing == {"trajectory"}


def test_woodscape_without_calibration(woodscape):
    name = tiny_woodscape.NAMES[0]
    calibration = woodscape / "calibration_data/calibration" / f"{name}.json"
    change_json(calibration, lambda content: content["intrinsic"].update(k1="big", model="mei"))
    (woodscape / "vehicle_data/rgb_images" / f"{name}.json").unlink()
    found = read_leniently(woodscape_recordings, woodscape, tiny_woodscape.OPTIONS)
    assert_told(found, "intrinsic.k1", "intrinsic.model", f"rgb_images/{name}.json: expected a file in")
    assert found.recording is None
