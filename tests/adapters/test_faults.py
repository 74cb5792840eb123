"""Text files of data sets with a fault, or made to hurt: one line that names the file, the field and what is wrong."""

import shutil
from functools import cache

import pytest

from bench.errors import DataError
from bench.plug_ins import imported
from bench.recordings import ADAPTERS
from tests.hostile import files
from tests.support import tiny_aimotive, tiny_kitti360, tiny_kitti_raw
from tests.support.data_sets import DATA_SETS
from tests.support.limits import at_most

AIMOTIVE, K360, RAW = tiny_aimotive.SEQUENCE, tiny_kitti360.SEQUENCE, f"{tiny_kitti_raw.DATE}/{tiny_kitti_raw.DRIVE}"
SENSORS, BOX = f"{AIMOTIVE}/sensor/calibration/calibration.json", f"{AIMOTIVE}/dynamic/box/3d_body/frame_0000101.json"
SPEED = f"derived/{AIMOTIVE.split('/')[-1]}.csv"
LENS, STATE = "calibration_data/calibration/00000_FV.json", "vehicle_data/rgb_images/00000_FV.json"
BEFORE = "vehicle_data/previous_images/00000_FV.json"
BOXES, POSES = f"data_3d_bboxes/train/{K360}.xml", f"data_poses/{K360}/poses.txt"
TIMES, FISHEYE = f"data_2d_raw/{K360}/image_02/timestamps.txt", "calibration/image_02.yaml"
MOUNTS, VELODYNE = "calibration/calib_cam_to_pose.txt", "calibration/calib_cam_to_velo.txt"
LENSES, MOTION = (f"{tiny_kitti_raw.DATE}/calib_{name}.txt" for name in ("cam_to_cam", "imu_to_velo"))
TRACKLETS, OXTS = f"{RAW}/tracklet_labels.xml", f"{RAW}/oxts/data/0000000003.txt"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A data set of an adapter, written once, and its options."""

    @cache
    def write(adapter):
        root = tmp_path_factory.mktemp(adapter) / "data"
        return root, DATA_SETS[adapter](root)

    return write


@pytest.fixture
def refused(whole, tmp_path):
    """Puts another content, or something that is no file, in the place of a file, and gives the error of opening it."""

    def refuse(adapter, file, content):
        root, options = whole(adapter)
        shutil.copytree(root, tmp_path / "data")
        path = tmp_path / "data" / file
        if callable(content):
            path.unlink()
            content(path)
        else:
            path.write_bytes(content)
        listing = imported(ADAPTERS[adapter], expected="an adapter")
        with at_most(60), pytest.raises(DataError) as caught:
            listing(tmp_path / "data", options=options, card=tmp_path / "x.yaml", annotations=None)[0].open()
        told = str(caught.value)
        assert str(path) in told or (str(path.parent) in told and path.name in told)  # or: expected one of these files
        assert "\n" not in told
        return told

    return refuse


# adapter, file, what stands there, what stands there instead, what the error says
FAULTS = [
    ("aimotive", BOX, '"VAN"', '"SPACESHIP"', "CapturedObjects.0.ObjectType: expected one of CAR"),
    ("aimotive", BOX, 'Extent X": 5.0', 'Extent X": 0', "BoundingBox3D Extent X: expected greater than 0, got 0"),
    ("aimotive", BOX, '"ObjectId": 1', '"Object": 1', "ObjectId: expected a value, got nothing"),
    ("aimotive", BOX, '"Timestamp": "4', '"Timestamp": "1', "expected times that increase"),
    ("aimotive", SENSORS, '"mei"', '"pinhole"', "M_FISHEYE_R.model: expected 'mei', got 'pinhole'"),
    ("aimotive", SENSORS, "M_FISHEYE_R", "B_CAM", "M_FISHEYE_R: expected a calibration of this camera, got none"),
    ("woodscape", STATE, '"36.0"', '"fast"', "ego_speed: expected a valid number, got 'fast'"),
    ("woodscape", STATE, '"36.0"', '"3600"', "ego_speed: expected at most 360 km/h"),
    ("woodscape", STATE, "15000000001", "1" * 30, "timestamp: expected less than or equal to 9000000000000000"),
    ("woodscape", STATE, "1500000000", "1500000010", "expected a time up to 500000 microseconds after"),
    ("woodscape", LENS, '"FV"', '"RV"', "name: expected 'FV', got 'RV'"),
    ("woodscape", LENS, "[-0.5, 0.5, -0.5, 0.5]", "[0, 0, 0, 0]", "quaternion_wxyz: expected four"),
    ("kitti-raw", TRACKLETS, "<objectType>Van", "<objectType>Boat", "1.objectType: expected one of"),
    ("kitti-raw", LENSES, "P_rect_02", "P_rect_00", "P_rect_02: expected a line"),
    ("kitti-raw", LENSES, "17.25 0.0 0.0 0.0 1.0", "17.25 0.0 0.0 0.0 0.0", "P_rect_02: expected a camera, its focal"),
    ("kitti-raw", MOTION, "R: 1.0", "R: 2.0", "R: "),
    ("kitti-raw", OXTS, " 4 10 4 4 0", "", "expected 30 numbers"),
    ("kitti-raw", f"{RAW}/oxts/timestamps.txt", "2011-09-26", "26.09.2011", "line 1: expected a time"),
    ("kitti360", BOXES, "<instanceId>3<", "<instanceId>x<", "object1.instanceId: expected a whole"),
    ("kitti360", BOXES, "<rows>4</rows>", "<rows>5</rows>", "transform.data: expected 20 numbers, got 16"),
    ("kitti360", BOXES, "<rows>8</rows>", "<rows>99999999</rows>", "vertices.data: expected 299999997 numbers"),
    ("kitti360", BOXES, "<rows>8</rows>", "<rows>-8</rows>", "vertices: expected rows and cols"),
    ("kitti360", BOXES, "</opencv_storage>", "", "expected well-formed XML"),
    ("kitti360", BOXES, "-0.5", "0.5", "transform: expected a box with length, width and height"),
    ("kitti360", BOXES, "<end_frame>10", "<end_frame>0", "end_frame: expected 1 or later, got 0"),
    ("kitti360", BOXES, "<timestamp>1<", "<timestamp>-7<", "timestamp: expected a frame number"),
    ("kitti360", POSES, " ", " 1 ", "line 1: expected 13 numbers, got"),
    ("kitti360", POSES, "0.866025404", "nan", "line 1: expected finite numbers, got 'nan'"),
    ("kitti360", POSES, "0.866025404", "1.866025404", "expected a rotation without scale"),
    ("kitti360", POSES, "\n10 ", "\n1 ", "expected times that increase, got"),
    ("kitti360", POSES, "\n11 ", "\n999 ", "expected a line for frame 999 in"),
    ("kitti360", POSES, "\n11 ", "\n10.5 ", "expected a line for frame 10.5 in"),
    ("kitti360", TIMES, "2013-05-28 08:46:03", "2013-13-28 08:46:03", "expected a time YYYY-MM-DD"),
    ("kitti360", TIMES, "08:46:02.904219904", "08:46:59.904219904", "line 2: expected times that increase"),
    ("kitti360", FISHEYE, "MEI", "PINHOLE", "model_type: expected 'MEI', got 'PINHOLE'"),
    ("kitti360", FISHEYE, "image_02", "image_03", "camera_name: expected 'image_02', got 'image_03'"),
    ("kitti360", MOUNTS, "image_02: 1 0", "image_02: 1", "image_02: expected 12 numbers, got 11"),
    ("kitti360", VELODYNE, "0 ", "1 ", "calib_cam_to_velo: expected a rotation without scale"),
    ("kitti360", MOUNTS, "image_02", "image_09", "image_02: expected a line with 12 numbers, got none"),
]


@pytest.mark.parametrize(("adapter", "file", "old", "new", "message"), FAULTS, ids=[f"{f[0]} {f[4]}" for f in FAULTS])
def test_a_fault_is_told_with_its_place(whole, refused, adapter, file, old, new, message):
    content = (whole(adapter)[0] / file).read_bytes()
    assert old.encode() in content
    assert message in refused(adapter, file, content.replace(old.encode(), new.encode()))


TEXT_FILES = {
    "native": ("drive/egomotion.csv", "drive/recording.json", "drive/annotations.json"),
    "aimotive": (SPEED, SENSORS, BOX),
    "kitti-raw": (OXTS, TRACKLETS),
    "kitti360": (BOXES, POSES, TIMES, FISHEYE, MOUNTS, VELODYNE),
    "woodscape": (LENS, STATE, BEFORE),
}
BOMB = b'<!DOCTYPE x [<!ENTITY a "ha">%s]><x>&a11;</x>' % b"".join(
    b'<!ENTITY a%d "%s">' % (n, b"&a%d;" % (n - 1) * 10 if n > 1 else b"&a;" * 10) for n in range(1, 12)
)
HOSTILE = {
    "empty": b"",
    "no UTF-8": b"\xff\xfe\x00",
    "NUL": b"\0" * 100,
    "one endless line": b"1 " * 500_000,
    "one endless number": b'{"a": ' + b"9" * 1_000_000 + b"}",
    "JSON nested deeply": b"[" * 200_000,
    "elements nested deeply": b"<x>" * 100_000,
    "a bomb of entities": BOMB,
    "an entity from outside": b'<!DOCTYPE x [<!ENTITY f SYSTEM "file:///etc/passwd">]><opencv_storage>&f;</opencv_storage>',
    "YAML laughs": files.LAUGHS.encode(),
    "times beyond 64 bits": b"timestamp_ns,speed_mps,yaw_rate_radps\n" + b"1" * 30 + b",1,1\n" + b"2" * 30 + b",1,1\n",
}


@pytest.mark.parametrize("what", HOSTILE)
@pytest.mark.parametrize(("adapter", "file"), [(name, file) for name, those in TEXT_FILES.items() for file in those])
def test_what_is_no_such_file_at_all_is_told(refused, adapter, file, what):
    refused(adapter, file, HOSTILE[what])


REGULAR = [(name, file) for name in ("native", "aimotive", "woodscape") for file in TEXT_FILES[name]]


@pytest.mark.parametrize("what", files.NO_FILES)
@pytest.mark.parametrize(("adapter", "file"), [*REGULAR, ("native", "drive/ego_body/front.png")])
def test_nothing_waits_for_what_is_no_regular_file(refused, adapter, file, what):
    refused(adapter, file, files.NO_FILES[what])
