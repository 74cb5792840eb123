"""What a format hands over is looked at before it becomes an annotation file."""

from dataclasses import replace

import pytest

from bench.errors import DataError
from bench.labels import LabelOptions, LabelSet, import_labels
from bench.labels.openlabel_format import OpenLabelFormat
from tests.labels import street


@pytest.fixture
def handed(monkeypatch):
    """Make the format hand over any label_set."""
    return lambda label_set: monkeypatch.setattr(OpenLabelFormat, "read", lambda *_: label_set)


def bring(tmp_path, drive):
    return import_labels("openlabel", tmp_path / "x", drive, LabelOptions(), file=tmp_path / "in/street.json")


def test_an_object_twice_is_refused_and_nothing_is_written(tmp_path, handed):
    car = street.box_track("car")
    handed(LabelSet(tracks=(car, car), timestamps_ns=street.TIMES_NS))
    with pytest.raises(DataError, match=r"object 'car': expected each object once, got it twice"):
        bring(tmp_path, street.recording(tmp_path / "drive"))
    assert not (tmp_path / "in").exists()


def test_two_states_at_one_time_are_refused(tmp_path, handed):
    car = street.box_track("car")
    car = replace(car, states=(*car.states[:2], car.states[1]))
    handed(LabelSet(tracks=(car,), timestamps_ns=street.TIMES_NS))
    with pytest.raises(DataError, match=f"expected one state at each time, got two at {street.TIMES_NS[1]}"):
        bring(tmp_path, street.recording(tmp_path / "drive"))


def test_sweeps_without_a_frame_are_counted(tmp_path, handed):
    handed(LabelSet(tracks=(), timestamps_ns=street.TIMES_NS[2:5], lost=("a",)))
    first, second = bring(tmp_path, street.recording(tmp_path / "drive")).lost
    assert first == "a"
    assert second.startswith("3 of 6 sweeps have no frame in the source, first 000000.npz: ")
