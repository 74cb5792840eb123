"""Each tool's format through the public commands: out of a recording and back into `annotations/`."""

import numpy as np
import pytest

from bench.recordings import ObjectState, PointIndices, Track, read_annotations, write_annotations
from tests.labels.same import assert_same_boxes
from tests.labels.street import FORMATS
from tests.support import tiny
from tests.support.commands import call

BIKE = Track(
    track_id="bike",
    object_class="cyclist",
    states=tuple(
        ObjectState(
            timestamp_ns=time_ns,
            shape=PointIndices(indices=np.array([3, 1, 4]), sweep_timestamp_ns=time_ns),
            velocity_mps=np.array([2.0, 0.0, 0.0]),
        )
        for time_ns in tiny.TIMES_NS[:2]
    ),
)


@pytest.fixture(scope="module")
def card(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drives")
    root = tiny.write_recording(folder / "data" / "drive")
    write_annotations(root / "annotations.json", (tiny.tracks()[0], BIKE))
    file = folder / "drives.yaml"
    file.write_text("name: drives\ntitle: one drive\nadapter: native\nroot: data\nlicence: CC0-1.0\n")
    return file


@pytest.mark.parametrize("name", FORMATS)
def test_out_of_a_recording_and_back(monkeypatch, capsys, tmp_path, card, name):
    assert call(monkeypatch, "annotations", "export", name, "--dataset", card, "--out", tmp_path / "tool") == 0
    exported = " ".join(capsys.readouterr().out.split())
    assert "lost: 1 states at 1 times at which there is no sweep" in exported
    source = tmp_path / "tool" / "drive"
    words = ("--dataset", card, "--recording", "drive", "--out", tmp_path / "annotations")
    assert call(monkeypatch, "annotations", "import", name, source, *words) == 0
    shown = capsys.readouterr().out
    assert "drive:" in shown
    tracks = read_annotations(tmp_path / "annotations" / "drive.json")
    if name == "semantickitti":
        assert "lost: 2 places of objects hold no point of their sweep" in exported  # the van is far from the points
        (bike,) = tracks
        assert (bike.track_id, bike.object_class) == ("moving-bicyclist-1", "cyclist")
        assert [sorted(state.shape.indices.tolist()) for state in bike.states] == [[1, 3, 4]] * 2
        assert [state.shape.sweep_timestamp_ns for state in bike.states] == list(tiny.TIMES_NS[:2])
        return
    van = tiny.tracks()[0]
    (found,) = tracks
    assert_same_boxes([found], [van_at_sweeps(van)], names=name == "sustechpoints")
    assert [state.category for state in found.states] == ["preceding" if name == "sustechpoints" else None] * 2
    assert np.isfinite(found.states[0].velocity_mps).all()  # from its places


def van_at_sweeps(van):
    return type(van)(track_id=van.track_id, object_class=van.object_class, states=van.states[:2])


def test_all_are_listed(monkeypatch, capsys):
    assert call(monkeypatch, "annotations", "formats") == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in FORMATS)


def test_a_fault_is_one_line_and_status_2(monkeypatch, capsys, tmp_path, card):
    (tmp_path / "0.label").write_bytes(b"123")
    words = ("--dataset", card, "--recording", "drive", "--out", tmp_path / "annotations")
    assert call(monkeypatch, "annotations", "import", "semantickitti", tmp_path, *words) == 2
    assert "error: " in capsys.readouterr().err
    assert not (tmp_path / "annotations").exists()
