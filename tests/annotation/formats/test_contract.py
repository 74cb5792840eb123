"""What every format of labels promises, whichever tool it is of."""

from dataclasses import replace

import numpy as np
import pytest

from bench.annotation.formats.conversion import LABEL_FORMATS, LabelFormat, LabelOptions, import_labels, label_format
from bench.errors import DataError, UnknownNameError, UsageError
from bench.recordings import read_annotations, write_annotations
from tests.annotation.formats import street
from tests.annotation.formats.street import assert_same_boxes, written

PLAIN = LabelOptions()
NAMES = sorted(LABEL_FORMATS)
WRITABLE = [name for name in NAMES if type(label_format(name)).write is not LabelFormat.write]


@pytest.mark.parametrize("name", WRITABLE)
def test_what_is_written_is_read_and_makes_an_annotation_file(name, tmp_path, drive):
    tracks = street.box_tracks()
    lost = written(label_format(name), tracks, drive, tmp_path / "out")
    assert lost == {"boxes": ["yaw rates: no field for them (6)"], "openlabel": []}[name]
    found = import_labels(name, tmp_path / "out", drive, PLAIN)
    assert found.timestamps_ns == street.TIMES_NS
    assert_same_boxes(found.tracks, tracks)
    for track, true in zip(found.tracks, tracks, strict=True):
        for state, expected in zip(track.states, true.states, strict=True):
            limit = 1e-9 if name == "boxes" else 0.5  # written, or from the places
            assert np.linalg.norm(state.velocity_mps - expected.velocity_mps) < limit
    write_annotations(tmp_path / "street.json", found.tracks, timestamps_ns=found.timestamps_ns)
    assert_same_boxes(read_annotations(tmp_path / "street.json"), tracks)
    again = import_labels("openlabel", tmp_path / "street.json", drive, PLAIN)
    assert_same_boxes(again.tracks, tracks)


@pytest.mark.parametrize("name", WRITABLE)
def test_writing_twice_gives_the_same_bytes_and_a_drive_without_objects_comes_back_empty(name, tmp_path, drive):
    full = replace(drive, tracks=street.box_tracks())
    first, second = (label_format(name).write(full) for _ in range(2))
    assert first == second
    written(label_format(name), (), drive, tmp_path / "out")
    assert import_labels(name, tmp_path / "out", drive, PLAIN).tracks == ()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("content", [None, b"", b"\0" * 64, b"{}", b"[[[[", b"PAR1" + bytes(60)])
def test_what_is_no_such_file_is_one_clear_line(name, content, tmp_path, drive):
    for file in ("boxes.csv", "openlabel.json", "tracklet_labels.xml", "000000.label"):
        if content is not None:
            (tmp_path / "in").mkdir(exist_ok=True)
            (tmp_path / "in" / file).write_bytes(content)
    with pytest.raises(DataError) as told:
        label_format(name).read(tmp_path / "in", drive, PLAIN)
    assert "\n" not in str(told.value)


def test_unknown_formats_are_told_with_the_nearest_and_some_are_only_read(drive):
    with pytest.raises(UnknownNameError, match="did you mean 'openlabel'"):
        label_format("openlable")
    with pytest.raises(UsageError, match="'semantickitti': expected one that can be written"):
        label_format("semantickitti").write(drive)
