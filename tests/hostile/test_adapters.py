"""Every text file that an adapter opens, spoiled in every way we know: `validate` and `view` tell it in one line."""

import json
import shutil

import pytest

from tests.hostile import files
from tests.support import tiny, tiny_aimotive, tiny_kitti360, tiny_woodscape
from tests.support.commands import call, error_line
from tests.support.data_sets import DATA_SETS, card_of
from tests.support.planting import change_head

pytestmark = pytest.mark.slow

AIMOTIVE = tiny_aimotive.SEQUENCE
KITTI = tiny_kitti360.SEQUENCE
PAIR = tiny_woodscape.NAMES[0]
ADAPTERS = ("native", "aimotive", "kitti360", "woodscape")
HEAD, ANNOTATIONS = "drive/recording.json", "drive/annotations.json"
SENSORS, BOX = f"{AIMOTIVE}/sensor/calibration/calibration.json", f"{AIMOTIVE}/dynamic/box/3d_body/frame_0000101.json"
LENS, STATE = f"calibration_data/calibration/{PAIR}.json", f"vehicle_data/rgb_images/{PAIR}.json"
JSON_FILES = [
    *(("native", file) for file in (HEAD, ANNOTATIONS)),
    *(("aimotive", file) for file in (SENSORS, BOX)),
    *(("woodscape", file) for file in (LENS, STATE, f"vehicle_data/previous_images/{PAIR}.json")),
]
TEXT_FILES = [
    ("native", "drive/egomotion.csv"),
    ("aimotive", f"derived/{AIMOTIVE.split('/')[-1]}.csv"),
    ("kitti360", "calibration/calib_cam_to_pose.txt"),
    ("kitti360", "calibration/calib_cam_to_velo.txt"),
    ("kitti360", "calibration/image_02.yaml"),
    ("kitti360", f"data_2d_raw/{KITTI}/image_02/timestamps.txt"),
    ("kitti360", f"data_poses/{KITTI}/poses.txt"),
    ("kitti360", f"data_3d_bboxes/train/{KITTI}.xml"),
]
TEXTS = {
    "empty": b"",
    "no UTF-8": b"\xff\xfe\x00",
    "NUL": b"\0" * 100,
    "one endless line": b"1 " * 500_000,
    "one endless number": b"9" * 1_000_000,
    "an open quote": b'timestamp_ns,speed_mps,yaw_rate_radps\n"1,2,3\n4,5,6\n',
    "NaN and infinity": b"timestamp_ns,speed_mps,yaw_rate_radps\n1,nan,inf\n2,-inf,1e999\n",
    "times beyond 64 bits": b"timestamp_ns,speed_mps,yaw_rate_radps\n" + b"1" * 30 + b",1,1\n" + b"2" * 30 + b",1,1\n",
    "speeds beyond sense": b"timestamp_ns,speed_mps,yaw_rate_radps\n1,1e308,1e308\n99999999999,1e308,1e308\n",
    "a bomb of entities": b'<!DOCTYPE x [<!ENTITY a "ha">'
    + b"".join(b'<!ENTITY a%d "%s">' % (n, b"&a%d;" % (n - 1) * 10 if n > 1 else b"&a;" * 10) for n in range(1, 12))
    + b"]><x>&a11;</x>",
    "an entity from outside": b'<!DOCTYPE x [<!ENTITY f SYSTEM "file:///etc/passwd">]><opencv_storage>&f;</opencv_storage>',
    "elements nested deeply": b"<x>" * 100_000,
    "YAML laughs": files.LAUGHS.encode(),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder with every data set, and the options of each."""
    folder = tmp_path_factory.mktemp("whole")
    for name in ADAPTERS:
        (folder / name).mkdir()
    return folder, {name: DATA_SETS[name](folder / name / "data") for name in ADAPTERS}


class Place:
    """A copy of a data set with its card, and what the commands say of it."""

    def __init__(self, monkeypatch, capsys, whole, adapter, tmp_path):
        self.monkeypatch, self.capsys = monkeypatch, capsys
        folder, options = whole
        self.root = shutil.copytree(folder / adapter / "data", tmp_path / "data")
        self.out = tmp_path / "out"
        self.folder = tmp_path
        self.card = card_of(tmp_path, adapter, options[adapter])
        monkeypatch.chdir(tmp_path)

    def listing(self):
        return sorted(str(path.relative_to(self.folder)) for path in self.folder.rglob("*"))

    def refused(self, file, *, viewed=True):
        """Both commands tell the file in one line each, and write nothing but what they were asked for."""
        before = self.listing()
        if viewed:
            words = ("view", self.card, "--out", self.out, "--method", "nothing")
            assert str(self.root / file) in error_line(self.monkeypatch, self.capsys, *words)
            assert self.listing() == before
        told = self.folder / "told.json"
        assert call(self.monkeypatch, "validate", self.card, "--json", told) == 1
        assert self.capsys.readouterr().err == ""
        recordings = json.loads(told.read_text())["recordings"]
        found = [f for recording in recordings for f in recording["findings"] if f["severity"] == "error"]
        assert str(self.root / file) in {finding["file"] for finding in found}
        assert self.listing() == sorted([*before, "told.json"])
        return found


@pytest.fixture
def place(monkeypatch, capsys, whole, tmp_path):
    return lambda adapter: Place(monkeypatch, capsys, whole, adapter, tmp_path)


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_the_whole_ones_are_not_refused(place, adapter):
    here = place(adapter)
    protocol = ["--protocol", "masks-v1"] if adapter == "woodscape" else []
    assert call(here.monkeypatch, "view", here.card, "--out", here.out, "--method", "nothing", *protocol) == 0
    written = {path.split("/")[0] for path in here.listing()}
    assert written == {"data", "out", "x.yaml"}


@pytest.mark.parametrize("what", files.JSON_FILES)
@pytest.mark.parametrize(("adapter", "file"), JSON_FILES)
def test_json(place, adapter, file, what):
    here = place(adapter)
    (here.root / file).write_bytes(files.JSON_FILES[what])
    here.refused(file)


@pytest.mark.parametrize("what", TEXTS)
@pytest.mark.parametrize(("adapter", "file"), TEXT_FILES)
def test_text_files(place, adapter, file, what):
    here = place(adapter)
    (here.root / file).write_bytes(TEXTS[what])
    here.refused(file)


LINKS = [
    ("native", HEAD),
    ("native", ANNOTATIONS),
    ("native", "drive/egomotion.csv"),
    ("native", f"drive/images/front/{tiny.TIMES_NS[1]}.png"),
    ("native", f"drive/lidar/{tiny.TIMES_NS[1]}.npz"),
    ("native", "drive/ego_body/front.png"),
    ("native", "drive/images/front"),
    ("native", "drive/lidar"),
    ("aimotive", SENSORS),
    ("aimotive", BOX),
    ("aimotive", f"{AIMOTIVE}/sensor/camera/{tiny_aimotive.CAMERA}/{tiny_aimotive.CAMERA}_0000101.jpg"),
    ("aimotive", f"{AIMOTIVE}/dynamic/raw-revolutions/frame_0000100.laz"),
    ("aimotive", f"{AIMOTIVE}/dynamic/raw-revolutions"),
    ("kitti360", "calibration/image_02.yaml"),
    ("kitti360", f"data_poses/{KITTI}/poses.txt"),
    ("kitti360", f"data_3d_bboxes/train/{KITTI}.xml"),
    ("kitti360", f"data_2d_raw/{KITTI}/image_02/data_rgb/0000000004.png"),
    ("kitti360", f"data_3d_raw/{KITTI}/velodyne_points/data/0000000004.bin"),
    ("woodscape", f"rgb_images/{PAIR}.png"),
    ("woodscape", f"motion_annotations/gtLabels/{PAIR}.png"),
    ("woodscape", STATE),
    ("woodscape", "calibration_data/calibration"),
]


@pytest.mark.parametrize(("adapter", "file"), LINKS)
def test_links_that_lead_outside(place, tmp_path, adapter, file):
    here = place(adapter)
    (here.root / file).rename(tmp_path / "outside")
    (here.root / file).symlink_to(tmp_path / "outside")
    told = here.folder / "told.json"
    assert call(here.monkeypatch, "view", here.card, "--out", here.out, "--method", "nothing") == 2
    assert "a link that leads outside" in here.capsys.readouterr().err
    assert call(here.monkeypatch, "validate", here.card, "--json", told) == 1
    assert "a link that leads outside" in told.read_text()


@pytest.mark.parametrize("path", ["../../x.png", "/etc/passwd", "a\\..\\b", "C:/x", "", "a\0b"])
def test_paths_that_lead_outside(place, path):
    here = place("native")
    change_head(here.root / "drive", lambda head: head["cameras"]["front"].update(ego_body_mask=path))
    found = here.refused("drive/recording.json")
    assert [finding["field"] for finding in found][:1] == ["cameras.front.ego_body_mask"]
