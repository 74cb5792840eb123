"""The commands of labels: exit status, what they print, which files they leave."""

import json

import numpy as np
import pytest

from bench.annotation.formats.conversion import LABEL_FORMATS, LabelFormat, label_format
from bench.recordings import read_annotations
from tests.support import tiny
from tests.support.cards import write_card
from tests.support.commands import call, error_line, output_of


@pytest.fixture
def card(tmp_path):
    tiny.write_recording(tmp_path / "datasets/data/drive")
    return write_card(tmp_path / "datasets")


def words(card, *more):
    return ("--dataset", card, "--recording", "drive", *more)


def exported(card, name, out, *more):
    return ("annotate", "export", card, "--annotated", "--format", name, "--out", out, *more)


def test_every_format_is_named_in_the_help():
    writable = [name for name in LABEL_FORMATS if type(label_format(name)).write is not LabelFormat.write]
    for command, names in (("import", LABEL_FORMATS), ("export", writable)):
        shown = output_of("annotate", command, "--help")
        assert all(name in shown for name in names)


@pytest.mark.parametrize(("name", "file"), [("openlabel", "openlabel.json"), ("boxes", "boxes.csv")])
def test_what_is_exported_is_imported_and_used(card, tmp_path, name, file):
    out, folder = tmp_path / "tool", tmp_path / "annotations"
    shown = output_of(*exported(card, name, out))
    assert "drive: 2 objects in 5 places, 2 of 2 sweeps annotated" in shown
    assert "1 vehicle: the middle box is 5.20 m long, 2.00 m wide, 2.10 m high" in shown
    assert str(out / "drive") in shown
    source = out / "drive" / file
    shown = output_of("annotate", "import", name, source, *words(card, "--out", folder))
    assert str(folder / "drive.json") in shown
    assert f"give the card {card} this line: annotations: ../annotations" in shown
    found = {track.track_id: track for track in read_annotations(folder / "drive.json")}
    assert len(found["van"].states) == 3
    assert np.isfinite([state.velocity_mps for state in found["van"].states]).all()
    write_card(card.parent, annotations="../annotations")
    assert "give the card" not in output_of("annotate", "import", name, source, *words(card))


def test_a_recording_that_nobody_annotated_is_imported_into(monkeypatch, capsys, card, tmp_path):
    out, folder = tmp_path / "tool", tmp_path / "annotations"
    assert call(monkeypatch, *exported(card, "openlabel", out)) == 0
    capsys.readouterr()
    (card.parent / "data/drive/annotations.json").unlink()
    before = sorted(path for path in card.parent.rglob("*"))
    source = out / "drive"
    assert "drive: 1 object in 3 places, 2 of 2 sweeps annotated" in output_of(
        "annotate", "import", "openlabel", source, *words(card, "--out", folder)
    )
    assert sorted(path for path in card.parent.rglob("*")) == before
    (track,) = read_annotations(folder / "drive.json")
    van = tiny.tracks()[0]
    for state, true in zip(track.states, van.states, strict=False):
        assert np.allclose(state.shape.vehicle_from_object.matrix, true.shape.vehicle_from_object.matrix, atol=1e-9)
        # It keeps its place before an ego vehicle at 3 m/s.
        assert state.velocity_mps == pytest.approx([3.0, 0.0, 0.0], abs=1e-6)


def test_classes_frames_units_and_the_first_frame_reach_the_format(monkeypatch, capsys, card, tmp_path):
    out = tmp_path / "tool"
    assert call(monkeypatch, *exported(card, "openlabel", out)) == 0
    labels = out / "drive/openlabel.json"
    content = json.loads(labels.read_text())
    content["openlabel"]["objects"]["0"]["type"] = "Lorry"
    del content["openlabel"]["frames"]["2"]  # at which there is no sweep
    labels.write_text(json.dumps(content))
    source = ("annotate", "import", "openlabel", labels, *words(card, "--out", tmp_path / "in", "--first-frame", 0))
    assert call(monkeypatch, *source) == 2
    assert "got 'Lorry'; map each of them, as --class 'Lorry=CLASS'" in capsys.readouterr().err
    assert not (tmp_path / "in").exists()
    assert "places of class 'Lorry': left out as asked" in " ".join(output_of(*source, "--class", "lorry=none").split())
    assert call(monkeypatch, *exported(card, "boxes", out)) == 0
    table = out / "drive/boxes.csv"
    table.write_text(table.read_text().replace(",vehicle,vehicle,", ",vehicle,base_link,"))
    source = ("annotate", "import", "boxes", table, *words(card, "--out", tmp_path / "boxes"))
    assert "say with --frame base_link=lidar" in error_line(monkeypatch, capsys, *source)
    assert call(monkeypatch, *source, "--frame", "base_link=vehicle") == 0
    assert call(monkeypatch, *exported(card, "openlabel", out, "--overwrite")) == 0
    content = json.loads(labels.read_text())
    for frame in content["openlabel"]["frames"].values():
        frame["frame_properties"]["timestamp"] /= 1e9
    labels.write_text(json.dumps(content))
    source = ("import", "openlabel", labels, *words(card, "--out", tmp_path / "seconds"))
    assert "--time-unit" in error_line(monkeypatch, capsys, "annotate", *source)
    assert call(monkeypatch, "annotate", *source, "--time-unit", "s") == 0


IMPORT = ("import", "openlabel", "x", "--dataset", "CARD", "--recording")
EXPORT = ("export", "CARD", "--out", "x", "--annotated")
KNOWN = "pedestrian, cyclist, vehicle, animal, unclear"


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (("import", "openlable", *IMPORT[2:], "drive"), "did you mean 'openlabel'?"),
        ((*IMPORT[:2], "nowhere.json", *IMPORT[3:], "drive"), "nowhere.json: expected a readable file"),
        ((*IMPORT, "../drive"), "unknown recording '../drive': known are drive"),
        ((*IMPORT, "drive", "--class", "Car"), "--class: expected TOOL'S=OURS, got 'Car'"),
        (
            (*IMPORT, "drive", "--class", "Car=truck"),
            f"class 'Car': expected one of {KNOWN}, got 'truck'",
        ),
        (
            (*IMPORT, "drive", "--frame", "base=camera"),
            "frame 'base': expected one of vehicle, lidar, world, got 'camera'",
        ),
        ((*EXPORT, "--format", "openlabel", "--split", "dirve"), "did you mean 'drive'?"),
        ((*EXPORT, "--format", "kitti"), "unknown label format 'kitti'"),
        ((*EXPORT, "--format", "semantickitti"), "got one that is only read"),
        (EXPORT, "expected a format to write annotations in, got none; name one with --format"),
    ],
)
def test_a_mistake_is_one_line(monkeypatch, capsys, card, given, told):
    assert told in error_line(monkeypatch, capsys, "annotate", *(card if word == "CARD" else word for word in given))
