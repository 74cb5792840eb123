"""`view`: single frames, spans, a time, videos and logs for the viewer."""

import shutil
import subprocess
import sys

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.commands.view import chosen_frames, parsed_span
from bench.errors import UsageError
from bench.recordings import ImageRef
from tests.support import drive, planting
from tests.support.cards import write_card
from tests.support.commands import call, error_line, output_of


def turn_camera(head, degrees):
    mounting = head["cameras"]["front"]["vehicle_from_camera"]
    turned = Rotation.from_euler("z", degrees, degrees=True) * Rotation.from_quat(
        mounting["quaternion_wxyz"], scalar_first=True
    )
    mounting["quaternion_wxyz"] = turned.as_quat(scalar_first=True).tolist()


@pytest.fixture(scope="module")
def card(tmp_path_factory):
    folder = tmp_path_factory.mktemp("street")
    drive.write_drive(folder / "data" / "drive")
    return write_card(folder, file="street.yaml", name="street")


def pictures_of(path):
    film = cv2.VideoCapture(str(path))
    pictures = []
    while True:
        well, picture = film.read()
        if not well:
            return pictures
        pictures.append(picture)


@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_a_video_of_some_frames(card, tmp_path, suffix):
    out = tmp_path / "films" / f"v{suffix}"
    assert output_of("view", card, "--video", out, "--frame", "4:10:2").split() == [str(out)]
    pictures = pictures_of(out)
    assert len(pictures) == 4
    assert pictures[0].shape[1] == 656  # the image and its margins
    assert len({picture.tobytes() for picture in pictures}) == 4
    assert [path.name for path in out.parent.iterdir()] == [out.name]


def test_pictures_of_several_frames_lie_in_folders_named_by_their_image(monkeypatch, card, tmp_path):
    assert call(monkeypatch, "view", card, "--method", "spherical", "--frame", "5:6", "--out", tmp_path / "p") == 0
    stems = [file.stem for file in sorted((card.parent / "data/drive").rglob("front/*.png"))]
    names = [f"{index:06d}-{stems[index]}" for index in (5, 6)]
    assert sorted(path.name for path in (tmp_path / "p").iterdir()) == names
    for name in names:
        made = {path.name for path in (tmp_path / "p" / name).iterdir()}
        assert made >= {"areas.png", "panels.png"}
        assert (tmp_path / "p" / name / "areas.png").read_bytes().startswith(b"\x89PNG")
    monkeypatch.chdir(tmp_path)
    assert call(monkeypatch, "view", card, "--frame", 5) == 0
    shown = {path.name for path in (tmp_path / "reports/runs/view/street/drive-front" / names[0]).iterdir()}
    assert "reference.png" in shown
    assert not shown & {"panels.png", "areas.png"}, "no method was asked for"


def test_a_frame_by_its_time(monkeypatch, capsys, card, tmp_path):
    time_ns = drive.START_NS + 7 * drive.IMAGE_NS + 1_000_000
    assert call(monkeypatch, "view", card, "--time-ns", time_ns, "--out", tmp_path / "a") == 0
    told = capsys.readouterr().out.splitlines()
    assert told[:2] == ["vehicle 'parked': does not move", "pedestrian 'walker': ignored, polygon too small"]
    assert call(monkeypatch, "view", card, "--frame", 7, "--out", tmp_path / "b") == 0
    assert (tmp_path / "a" / "reference.png").read_bytes() == (tmp_path / "b" / "reference.png").read_bytes()


def test_a_log_for_the_viewer(monkeypatch, card, tmp_path):
    pytest.importorskip("rerun")
    out = tmp_path / "v.rrd"
    assert call(monkeypatch, "view", card, "--rrd", out, "--frame", "4:6") == 0
    verified = subprocess.run([sys.executable, "-m", "rerun", "rrd", "verify", out], capture_output=True, check=False)
    assert verified.returncode == 0, verified.stderr
    content = out.read_bytes()
    for name in (b"/world/lidar", b"/world/objects", b"/world/vehicle", b"/world/path", b"/images/front"):
        assert name in content
    assert [path.name for path in tmp_path.iterdir()] == ["v.rrd"]


def test_without_the_viewer_the_message_says_what_to_install(monkeypatch, capsys, card, tmp_path):
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert call(monkeypatch, "view", card, "--rrd", tmp_path / "v.rrd") == 2
    assert "install it: pip install 'fisheye-bench[viewer]'" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_calibration_of_each_camera_without_annotations_and_without_lidar(monkeypatch, tmp_path):
    """Where the lidar's wall meets the image's moves with a camera that is turned in the head alone."""
    root = drive.write_drive(tmp_path / "data" / "drive")
    (root / "annotations.json").unlink()
    card, pictures = write_card(tmp_path), []
    for name, turn_deg in (("as-it-is", 0.0), ("turned", 10.0)):
        planting.change_head(root, lambda head, turn_deg=turn_deg: turn_camera(head, turn_deg))
        assert call(monkeypatch, "view", card, "--calibration", "--out", tmp_path / name) == 0
        (file,) = (tmp_path / name).rglob("*.png")
        assert file.parent.parent.name == "drive-front"
        assert file.name == "calibration.png"
        pictures.append(cv2.imread(str(file)).astype(int))
    differs = np.abs(pictures[0] - pictures[1]).max(axis=2) > 40
    height, width = differs.shape
    assert differs[: height // 2].mean() > 0.01  # lidar
    assert differs[height // 2 :, width // 2 :].mean() > 0.002  # horizon and road
    shutil.rmtree(root / "lidar")
    assert call(monkeypatch, "view", card, "--calibration", "--out", tmp_path / "p") == 0
    assert len(list((tmp_path / "p").rglob("calibration.png"))) == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--calibration", "--video", "OUT.mp4"), "--video, --rrd: expected none with --calibration"),
        (("--video", "OUT.gif"), "expected a file *.mp4, *.webm, got"),
        (("--rrd", "OUT.txt"), "expected a file *.rrd"),
        (("--frame", "5:6", "--time-ns", "5"), "expected one of --frame and --time-ns"),
        (("--frame", "5-6"), "expected N, FIRST:LAST or FIRST:LAST:STEP"),
        (("--frame", "9:5"), "expected indices from"),
        (("--frame", "5:24"), "expected indices from 0 to 23, rising, got 5:24:1"),
        (("--frame", "24"), "expected indices from 0 to 23"),
        (("--method", "spherical", "--frame", "0"), "expected indices from 1 to 23"),
        (("--time-ns", "5"), "--time-ns: expected a time from"),
        (("--time-ns", str(10**30)), "--time-ns: expected a time from"),
        (("--set", "threshold=1"), "--set: expected --method"),
    ],
)
def test_mistakes_are_one_clear_line_and_leave_nothing(monkeypatch, capsys, card, tmp_path, words, message):
    if words[0] == "--rrd":
        pytest.importorskip("rerun")
    named = [word.replace("OUT", str(tmp_path / "out")) for word in words]
    assert message in error_line(monkeypatch, capsys, "view", card, *named)
    assert not list(tmp_path.iterdir())


def test_a_codec_that_is_missing_is_told(monkeypatch, capsys, card, tmp_path):
    monkeypatch.setattr(cv2.VideoWriter, "isOpened", lambda _: False)
    shown = error_line(monkeypatch, capsys, "view", card, "--video", tmp_path / "v.mp4", "--frame", "4:5")
    assert "expected a codec for .mp4 in this OpenCV, got none (mp4v); try another of .mp4, .webm" in shown
    assert not list(tmp_path.iterdir())


def test_choices_of_frames(tmp_path):
    images = tuple(ImageRef(camera="c", timestamp_ns=100 * i, path=tmp_path) for i in range(10))

    def chosen(frame=None, *, all_else=False):
        span = None if frame is None else parsed_span(frame)
        return list(chosen_frames(images, history=1, span=span, time_ns=None, all_else=all_else))

    assert chosen() == [5]
    assert chosen(all_else=True) == list(range(1, 10))
    assert chosen("9", all_else=True) == [9]
    assert chosen(":3") == [1, 2, 3]
    assert chosen("7:") == [7, 8, 9]
    with pytest.raises(UsageError, match="expected more than 12 images"):
        chosen_frames(images, history=12, span=None, time_ns=None)
