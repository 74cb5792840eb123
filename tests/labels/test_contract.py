"""What every format of labels promises, whichever tool it is of."""

import numpy as np
import pytest

from bench.errors import BenchError, DataError, UnknownNameError
from bench.labels import LABEL_FORMATS, LabelOptions, LabelSet, import_labels, known_formats, label_format
from bench.recordings import OBJECT_CLASSES, Cuboid, read_annotations
from tests.labels import street

PLAIN = LabelOptions()
NAMES = sorted(LABEL_FORMATS)


def files(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize("name", NAMES)
def test_names_and_descriptions(name):
    found = label_format(name)
    assert found.name == name
    assert 10 < len(found.description) < 120
    assert "\n" not in found.description


@pytest.mark.parametrize("name", NAMES)
def test_what_is_written_is_read_and_makes_an_annotation_file(name, tmp_path, drive):
    before = files(tmp_path)
    lost = label_format(name).write(street.label_set(), drive, tmp_path / "out", PLAIN)
    assert all(isinstance(line, str) and line and "\n" not in line for line in lost)
    written = [path for path in files(tmp_path) if path not in before]
    assert written
    assert all(path.is_relative_to(tmp_path / "out") for path in written)
    options = LabelOptions(classes={"Misc": "animal"})
    found = import_labels(name, tmp_path / "out", drive, options, file=tmp_path / "in/street.json")
    assert list(found.timestamps_ns) == sorted(set(found.timestamps_ns))
    assert set(found.timestamps_ns) <= set(street.TIMES_NS)
    assert {track.object_class for track in found.tracks} <= set(OBJECT_CLASSES)
    stored = read_annotations(tmp_path / "in/street.json")
    assert [track.track_id for track in stored] == [track.track_id for track in found.tracks]
    moving = [track for track in stored if track.object_class == "pedestrian"]
    assert moving, "the walker comes back from every tool"
    boxes = [state.shape for track in moving for state in track.states if isinstance(state.shape, Cuboid)]
    if boxes:
        true = street.box_track("walker").states[0].shape.vehicle_from_object.translation_m
        assert np.linalg.norm(boxes[0].vehicle_from_object.translation_m - true) < 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_writing_twice_leaves_the_same_bytes(name, tmp_path, drive):
    for folder in ("a", "b"):
        label_format(name).write(street.label_set(), drive, tmp_path / folder, PLAIN)
    one, other = ({p.relative_to(tmp_path / f): p.read_bytes() for p in files(tmp_path / f)} for f in "ab")
    assert one == other


@pytest.mark.parametrize("name", NAMES)
def test_a_drive_without_objects_comes_back_empty(name, tmp_path, drive):
    label_format(name).write(LabelSet(tracks=(), timestamps_ns=street.TIMES_NS), drive, tmp_path / "out", PLAIN)
    found = label_format(name).read(tmp_path / "out", drive, PLAIN)
    assert found.tracks == ()
    assert found.timestamps_ns == street.TIMES_NS


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("content", [None, b"", b"\0" * 64, b"{}", b"[[[["])
def test_what_is_no_such_file_is_one_clear_line(name, content, tmp_path, drive):
    label_format(name).write(street.label_set(), drive, tmp_path / "out", PLAIN)
    for path in files(tmp_path / "out"):
        path.unlink() if content is None else path.write_bytes(content)
    with pytest.raises(BenchError) as told:
        label_format(name).read(tmp_path / "out", drive, PLAIN)
    assert isinstance(told.value, DataError)
    assert "\n" not in str(told.value)


def test_unknown_formats_are_told_with_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'openlabel'"):
        label_format("openlable")
    assert set(LABEL_FORMATS) <= set(known_formats())
