"""The commands of labels: exit status, what they print, which files they leave."""

import json
import shutil

import numpy as np
import pytest

from bench.labels import known_formats, label_format
from bench.recordings import read_annotations
from tests.support import tiny
from tests.support.commands import call, error_line

CARD = """
name: mine
title: one drive
adapter: native
root: data
licence: CC0-1.0
{more}
"""


@pytest.fixture
def card(tmp_path):
    tiny.write_recording(tmp_path / "datasets/data/drive")
    file = tmp_path / "datasets/mine.yaml"
    file.write_text(CARD.format(more=""))
    return file


def words(card, *more):
    return ("--dataset", card, "--recording", "drive", *more)


def test_every_format_is_listed_with_what_it_is(monkeypatch, capsys):
    assert call(monkeypatch, "annotations", "formats") == 0
    shown = capsys.readouterr().out
    for name in known_formats():
        assert f"{name} " in shown
        assert label_format(name).name == name
        assert label_format(name).description


def test_what_is_exported_is_imported_and_used(monkeypatch, capsys, card, tmp_path):
    out, folder = tmp_path / "tool", tmp_path / "annotations"
    assert call(monkeypatch, "annotations", "export", "openlabel", "--dataset", card, "--out", out) == 0
    shown = capsys.readouterr().out
    assert "drive: 2 objects in 5 places, 2 of 2 sweeps annotated" in shown
    assert "1 vehicle: the middle box is 5.20 m long, 2.00 m wide, 2.10 m high" in shown
    assert str(out / "drive") in shown
    source = out / "drive/openlabel.json"
    assert call(monkeypatch, "annotations", "import", "openlabel", source, *words(card, "--out", folder)) == 0
    shown = capsys.readouterr().out
    assert str(folder / "drive.json") in shown
    assert f"give the card {card} this line: annotations: ../annotations" in shown
    found = {track.track_id: track for track in read_annotations(folder / "drive.json")}
    assert {name: len(track.states) for name, track in found.items()} == {"van": 3, "walker": 2}
    assert found["van"].states[0].category == "preceding"
    card.write_text(CARD.format(more="annotations: ../annotations"))
    assert call(monkeypatch, "annotations", "import", "openlabel", source, *words(card)) == 0
    assert "give the card" not in capsys.readouterr().out


def test_a_recording_that_nobody_annotated_is_imported_into(monkeypatch, capsys, card, tmp_path):
    out, folder = tmp_path / "tool", tmp_path / "annotations"
    assert call(monkeypatch, "annotations", "export", "cvat-tracklets", *words(card, "--out", out)) == 0
    assert "lost: 2 states that are" not in capsys.readouterr().out
    (card.parent / "data/drive/annotations.json").unlink()
    before = sorted(path for path in card.parent.rglob("*"))
    source = out / "drive"
    assert call(monkeypatch, "annotations", "import", "cvat-tracklets", source, *words(card, "--out", folder)) == 0
    shown = capsys.readouterr().out
    assert "drive: 1 objects in 2 places, 2 of 2 sweeps annotated" in shown
    assert "lost: " not in shown  # frame_list.txt, which is exported too, names the frames
    assert sorted(path for path in card.parent.rglob("*")) == before
    (track,) = read_annotations(folder / "drive.json")
    van = tiny.tracks()[0]
    for state, true in zip(track.states, van.states, strict=False):
        assert np.allclose(state.shape.vehicle_from_object.matrix, true.shape.vehicle_from_object.matrix, atol=1e-9)
        assert state.velocity_mps == pytest.approx(
            [3.0, 0.0, 0.0], abs=1e-6
        )  # it keeps its place before an ego vehicle at 3 m/s


@pytest.mark.parametrize("name", ["openlabel", "cvat-tracklets", "kitti-tracklets"])
def test_sweeps_without_a_frame_are_told(monkeypatch, capsys, card, tmp_path, name):
    assert call(monkeypatch, "annotations", "export", name, *words(card, "--out", tmp_path / "tool")) == 0
    source = next((tmp_path / "tool/drive").iterdir())
    if name == "openlabel":
        content = json.loads(source.read_text())
        del content["openlabel"]["frames"]["0"]
        source.write_text(json.dumps(content))
    capsys.readouterr()
    given = ("import", name, source, *words(card, "--out", tmp_path / "in"))
    assert call(monkeypatch, "annotations", *given) == 0
    told = "1 of 2 sweeps have no frame in the source" in capsys.readouterr().out
    assert told == (name == "openlabel")


def test_classes_and_first_frame_reach_the_format(monkeypatch, capsys, card, tmp_path):
    out = tmp_path / "tool"
    given = ("--out", out, "--class", "Lorry=vehicle", "--first-frame", 7)
    assert call(monkeypatch, "annotations", "export", "kitti-tracklets", *words(card, *given)) == 0
    text = (out / "drive/tracklet_labels.xml").read_text()
    assert "<objectType>Lorry</objectType>" in text
    assert "<first_frame>7</first_frame>" in text
    source = ("import", "kitti-tracklets", out / "drive", *words(card, "--out", tmp_path / "in"))
    assert call(monkeypatch, "annotations", *source, "--first-frame", 7) == 2
    assert "got 'Lorry'; map each of them: --class Lorry=vehicle" in capsys.readouterr().err
    assert not (tmp_path / "in").exists()
    assert call(monkeypatch, "annotations", *source, "--class", "lorry=none", "--first-frame", 7) == 0
    assert "lost: 1 objects of class 'Lorry', left out as asked" in capsys.readouterr().out


def test_a_calibration_is_printed_or_written(monkeypatch, capsys, card, tmp_path):
    assert call(monkeypatch, "annotations", "export", "openlabel", *words(card, "--out", tmp_path / "tool")) == 0
    source, out = tmp_path / "tool/drive/openlabel.json", tmp_path / "head.json"
    capsys.readouterr()
    assert call(monkeypatch, "annotations", "calibration", source) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["cameras"]["front"]["model"]["model"] == "radial_polynomial"
    assert call(monkeypatch, "annotations", "calibration", source, "--out", out) == 0
    assert json.loads(out.read_text()) == printed


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (("import", "openlable", "x", "--recording", "drive"), "did you mean 'openlabel'?"),
        (("import", "openlabel", "nowhere.json", "--recording", "drive"), "nowhere.json: expected a readable file"),
        (("import", "openlabel", "x", "--recording", "../drive"), "unknown recording '../drive': known are drive"),
        (
            ("import", "openlabel", "x", "--recording", "drive", "--class", "Car"),
            "--class: expected TOOL'S=OURS, got 'Car'",
        ),
        (("import", "openlabel", "x", "--recording", "drive", "--class", "Car=truck"), "class 'Car': expected one of"),
        (
            ("import", "openlabel", "x", "--recording", "drive", "--class", "Car=animal", "--class", "Car=none"),
            "--class Car: expected once, got twice",
        ),
        (("export", "openlabel", "--recording", "dirve", "--out", "x"), "did you mean 'drive'?"),
        (("export", "kitti", "--out", "x"), "unknown format of annotations 'kitti'"),
    ],
)
def test_a_mistake_is_one_line(monkeypatch, capsys, card, given, told):
    assert told in error_line(monkeypatch, capsys, "annotations", *given, "--dataset", card)


def test_a_recording_without_sweeps_has_nothing_to_label(monkeypatch, capsys, card, tmp_path):
    shutil.rmtree(card.parent / "data/drive/lidar")
    assert call(monkeypatch, "annotations", "export", "openlabel", *words(card, "--out", tmp_path / "x")) == 2
    assert "expected lidar sweeps, which tools label, got none in 'drive'" in capsys.readouterr().err
