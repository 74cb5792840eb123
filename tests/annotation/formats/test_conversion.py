"""Observations become tracks: classes, objects without ids, faults, and what is said of them."""

from dataclasses import replace

import numpy as np
import pytest

from bench.annotation.formats import LabelOptions, import_labels
from bench.annotation.formats.contract import Observation, ToolLabels, map_classes, tool_class
from bench.annotation.formats.openlabel import OpenLabelFormat
from bench.errors import DataError, UsageError
from tests.annotation.formats import street

PLAIN = LabelOptions()


@pytest.fixture
def handed(monkeypatch, drive):
    """Import what a format would hand over."""

    def bring(observations, options=PLAIN, times_ns=street.TIMES_NS, lost=()):
        labels = ToolLabels(observations=tuple(observations), timestamps_ns=tuple(times_ns), lost=lost)
        monkeypatch.setattr(OpenLabelFormat, "read", lambda *_: labels)
        return import_labels("openlabel", drive.root / "x", drive, options)

    return bring


def seen(name, *, track=None, label="Car", sweeps=range(street.SWEEPS)):
    states = street.box_track(name, told=False).states
    return [Observation(track=name if track is None else track, label=label, state=states[i]) for i in sweeps]


def test_an_object_twice_at_one_time_is_refused(handed):
    with pytest.raises(DataError, match=f"object 'car': expected one place at each time, got 2 at {street.FIRST_NS}"):
        handed([*seen("car"), *seen("parked", track="car", sweeps=[0])])


def test_an_object_of_two_classes_is_refused(handed):
    with pytest.raises(DataError, match="object 'car': expected one class for each object, got 'Car' and 'Person'"):
        handed([*seen("car", sweeps=[0, 1]), *seen("car", label="Person", sweeps=[2])])
    assert len(handed([*seen("car", sweeps=[0, 1]), *seen("car", label="van", sweeps=[2])]).tracks) == 1


def test_sweeps_without_a_frame_are_counted(handed):
    first, second = handed([], times_ns=street.TIMES_NS[2:5], lost=("a",)).lost
    assert first == "a"
    assert second.startswith("3 of 6 sweeps have no frame in the source, first 000000.npz: ")


def test_objects_without_ids_are_followed_class_by_class(handed):
    mixed = [*seen("car", track=""), *seen("walker", track="", label="Person"), *seen("parked", track="")]
    found = handed(reversed(mixed))
    assert {(track.track_id, len(track.states)) for track in found.tracks} == {
        ("Car-unnamed-1", 6),
        ("Car-unnamed-2", 6),
        ("Person-unnamed-1", 6),
    }
    assert "12 places of Car without an id: followed by nearness, 2 objects" in found.lost
    walker = next(track for track in found.tracks if track.object_class == "pedestrian")
    for state, true in zip(walker.states, street.box_track("walker").states, strict=True):
        assert state.velocity_mps == pytest.approx(true.velocity_mps, abs=1e-6)


def test_objects_seen_once_are_reported(handed):
    found = handed(seen("car", sweeps=[3]))
    assert np.isnan(found.tracks[0].states[0].velocity_mps).all()
    assert any(line.startswith("1 objects are seen once, so that their speed is unknown") for line in found.lost)


def test_what_nobody_can_tell_is_unclear_and_not_scored(handed):
    found = handed(
        [*seen("car", label="DontCare"), *seen("parked", label="Misc")], LabelOptions(classes={"Misc": "unclear"})
    )
    assert all(state.unclear for track in found.tracks for state in track.states)
    assert len(found.tracks) == 2


def test_classes_that_are_left_out_are_counted(handed):
    found = handed([*seen("car"), *seen("parked", label="Misc")], LabelOptions(classes={"misc": None}))
    assert [track.track_id for track in found.tracks] == ["car"]
    assert "6 places of class 'Misc', left out as asked" in found.lost


def test_velocities_that_the_files_have_stay(handed):
    told = replace(street.box_track("car").states[2], velocity_mps=np.array([1.0, 2.0, 3.0]))
    observations = [*seen("car", sweeps=[0, 1]), Observation(track="car", label="Car", state=told)]
    assert handed(observations).tracks[0].states[2].velocity_mps.tolist() == [1.0, 2.0, 3.0]


def test_classes_are_known_in_any_case_and_the_user_goes_first(tmp_path):
    options = LabelOptions(classes={"Rider": "pedestrian", "misc": None})
    found = map_classes(["Car", "PEDESTRIAN", "rider", "Misc", "DontCare"], options, source=tmp_path)
    assert found == {
        "Car": "vehicle",
        "PEDESTRIAN": "pedestrian",
        "rider": "pedestrian",
        "Misc": None,
        "DontCare": "unclear",
    }


def test_all_unknown_classes_are_named_at_once(tmp_path):
    told = r"got 'Blimp', 'Yeti'; map each of them: --class Blimp=CLASS --class Yeti=CLASS; CLASS is one of pedestrian"
    with pytest.raises(DataError, match=told):
        map_classes(["Yeti", "Car", "Blimp"], PLAIN, source=tmp_path)


@pytest.mark.parametrize(
    ("name", "proposed"),
    [
        ("egocar", "none"),
        ("police_car", "vehicle"),
        ("vehicle.bicycle", "cyclist"),
        ("bus_stop", "none"),
        ("shoppingCart", "CLASS"),
        ("scarecrow", "CLASS"),
        ("human.pedestrian.adult", "pedestrian"),
        ("vantage", "CLASS"),
    ],
)
def test_whole_words_of_a_name_propose_its_class(tmp_path, name, proposed):
    with pytest.raises(DataError, match="map each of them") as told:
        map_classes([name], PLAIN, source=tmp_path)
    assert f"{name}={proposed}" in str(told.value)


def test_classes_and_frames_that_are_none_of_ours_are_refused():
    known = "pedestrian, cyclist, vehicle, animal, unclear"
    with pytest.raises(UsageError, match=f"class 'Van': expected one of {known}, got 'truck'"):
        LabelOptions(classes={"Van": "truck"})
    with pytest.raises(UsageError, match="frame 'base': expected one of vehicle, lidar, world, got 'camera'"):
        LabelOptions(frames={"base": "camera"})


def test_the_users_class_is_written():
    defaults = {"vehicle": "Car"}
    assert tool_class("vehicle", LabelOptions(classes={"Misc": None, "Van": "vehicle"}), defaults) == "Van"
    assert tool_class("vehicle", PLAIN, defaults) == "Car"
