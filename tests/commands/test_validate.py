"""`validate`: exit status, text and JSON."""

import json
import shutil

import pytest

from tests.support import drive
from tests.support.cards import write_card
from tests.support.commands import call, error_line, output_of


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    folder = tmp_path_factory.mktemp("street")
    drive.write_drive(folder / "data" / "drive", drive.MARGIN_M)
    write_card(folder, file="street.yaml", name="street")
    return folder


@pytest.fixture
def folder(clean, tmp_path):
    return shutil.copytree(clean, tmp_path / "street")


def test_a_clean_data_set_exits_with_0(clean):
    shown = output_of("validate", clean / "street.yaml", "--deep")
    assert "0 errors and 0 warnings in 1 recording; read 24 of 24 images and 16 of 16 sweeps" in shown
    assert "read as" not in shown, "that stands in the JSON"


def test_faults_exit_with_1_and_stand_in_text_and_json(folder):
    images = sorted((folder / "data" / "drive" / "images" / "front").iterdir())
    images[3].write_bytes(images[3].read_bytes()[:100])
    images[7].write_bytes(b"[red]not a picture[/]")
    for image in images[15:21]:
        image.write_bytes(images[3].read_bytes())
    out = folder / "found" / "faults.json"
    shown = output_of("validate", folder / "street.yaml", "--json", out, status=1)
    lines = shown.splitlines()
    names = [f"images/front/{image.name}" for image in images]
    alike = f"{names[3]}, {names[15]}, {names[16]} and 4 more (7 times, first at {images[3].stem})"
    assert lines[:2] == ["drive", f"  error    image: {alike}"]
    assert f"  error    image: {names[7]} (at {images[7].stem})" in lines
    assert "8 errors and 0 warnings" in shown
    assert str(out) in shown
    content = json.loads(out.read_text())
    assert (content["dataset"], content["errors"], content["warnings"]) == ("street", 8, 0)
    (recording,) = content["recordings"]
    findings = recording.pop("findings")
    read = {content["what"]: content["count"] for content in recording.pop("contents") if content["read_as"]}
    assert (read["images/front/*.png"], read["lidar/*.npz"]) == (24, 16)
    assert recording == {
        "name": "drive",
        "images": {"read": 24, "all": 24},
        "sweeps": {"read": 16, "all": 16},
        "undecided": [
            {
                "about": "clock of lidar sweeps against ego-motion",
                "why": "it has too little braking, acceleration or turning, or too few pairs of sweeps match (15)",
            },
            {
                "about": "calibration and clock of camera front",
                "why": "no flow is seen: too dark, too little texture, or the vehicle stands",
            },
        ],
    }
    assert [finding["file"] for finding in findings] == [str(images[i]) for i in (3, 7, *range(15, 21))]
    assert {finding["check"] for finding in findings} == {"image"}
    assert findings[0]["timestamp_ns"] == int(images[3].stem)


@pytest.mark.slow
def test_warnings_alone_exit_with_1_unless_only_errors_count(monkeypatch, folder):
    images = sorted((folder / "data" / "drive" / "images" / "front").iterdir())
    for path in images[10:13]:
        path.unlink()
    shown = output_of("validate", folder / "street.yaml", status=1)
    assert "0 errors and 1 warning" in shown
    assert "image-gaps" in shown
    assert call(monkeypatch, "validate", folder / "street.yaml", "--errors-only") == 0
    (folder / "data" / "drive" / "recording.json").write_text("{}")
    assert call(monkeypatch, "validate", folder / "street.yaml", "--errors-only") == 1


@pytest.mark.slow
def test_one_bad_recording_does_not_stop_the_others(monkeypatch, folder):
    (folder / "data" / "broken").mkdir()
    (folder / "data" / "broken" / "recording.json").write_text('{"schema_version": 1}')
    out = folder / "faults.json"
    assert call(monkeypatch, "validate", folder / "street.yaml", "--json", out) == 1
    content = json.loads(out.read_text())
    assert [entry["name"] for entry in content["recordings"]] == ["broken", "drive"]
    findings = [finding for entry in content["recordings"] for finding in entry["findings"]]
    assert {finding["recording"] for finding in findings} == {"broken"}
    fields = {finding["field"] for finding in findings}
    assert {"name", "licence", "frame_interval_ns", "vehicle", "cameras", "lidar"} <= fields


def test_mistakes_are_one_clear_line_and_status_2(monkeypatch, capsys, clean):
    assert "nowhere.yaml" in error_line(monkeypatch, capsys, "validate", "nowhere.yaml")
    told = error_line(monkeypatch, capsys, "validate", clean / "street.yaml", "--split", "test")
    assert "unknown split or recording 'test'" in told
