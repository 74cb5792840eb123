"""Frames of a tool and sweeps of a recording: paired by key, never shifted in silence."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import DataError, UsageError
from bench.labels import LabelOptions
from bench.labels.formats import is_ignored, left_out, map_classes, tool_class
from bench.labels.frames import frame_numbers, pair_with_sweeps
from bench.lidar import read_sweep
from bench.recordings import SweepRef
from tests.labels import street

SOURCE = Path("labels")
PLAIN = LabelOptions()


def drive(*stems, times_ns=None):
    times_ns = times_ns or [street.FIRST_NS + i * street.STEP_NS for i in range(len(stems))]
    sweeps = tuple(
        SweepRef(timestamp_ns=t, path=Path(f"{stem}.bin"), reader=read_sweep)
        for t, stem in zip(times_ns, stems, strict=True)
    )
    return replace(bare, sweeps=sweeps)


bare = None


@pytest.fixture(autouse=True, scope="module")
def _recording(tmp_path_factory):
    global bare
    bare = street.recording(tmp_path_factory.mktemp("drive"))


def paired(names, recording, options=PLAIN):
    return {name: ref.path.stem for name, ref in pair_with_sweeps(names, recording, options, source=SOURCE).items()}


def test_names_of_files_go_first():
    assert paired(["b", "a"], drive("a", "b", "c")) == {"a": "a", "b": "b"}


def test_numbers_fit_whatever_zeros_stand_before_them():
    assert paired(["000250", "000252"], drive("0000000250", "0000000251", "0000000252")) == {
        "000250": "0000000250",
        "000252": "0000000252",
    }


def test_times_fit_sweeps_that_are_called_otherwise():
    expected = drive("frame_7", "frame_8")
    assert paired([str(street.FIRST_NS + street.STEP_NS)], expected) == {
        str(street.FIRST_NS + street.STEP_NS): "frame_8"
    }


def test_places_count_where_no_name_fits():
    assert paired(["0", "2"], drive("x", "y", "z")) == {"0": "x", "2": "z"}
    assert paired(["5", "6"], drive("x", "y", "z"), LabelOptions(first_frame=5)) == {"5": "x", "6": "y"}
    assert paired(["0", "2"], drive("900", "901", "902")) == {"0": "900", "2": "902"}


def test_another_first_frame_means_places_even_where_names_would_fit():
    assert paired(["1", "2"], drive("0", "1", "2"), LabelOptions(first_frame=1)) == {"1": "0", "2": "1"}
    assert paired(["0", "1"], drive("50", "51", "52"), LabelOptions(first_frame=-1)) == {"0": "51", "1": "52"}


def test_one_missing_sweep_does_not_shift_the_others():
    """Labels 249 ... 251 and sweeps 250 ...: by place, 249 would take the first sweep."""
    with pytest.raises(
        DataError, match=r"labels: frames: expected frames named like the 3 sweeps, 250 to 252.*got 249;"
    ):
        paired(["249", "250", "251"], drive("250", "251", "252"))


def test_zero_in_both_ways_of_counting_proves_nothing():
    times_ns = [0, 100_000_000, 200_000_000]
    assert paired(["0", "1"], drive("0", "100000000", "200000000", times_ns=times_ns)) == {"0": "0", "1": "100000000"}


@pytest.mark.parametrize("name", ["-1", "3", "x", "", "9" * 40, "\u0661", "1.0", " 1"])
def test_frames_that_fit_nothing_are_named(name):
    with pytest.raises(DataError, match="--first-frame"):
        paired(["0", name], drive("a", "b", "c"))


def test_two_frames_of_one_sweep_are_refused():
    with pytest.raises(DataError, match=r"expected one frame for each sweep, got '7' and '07' of 7\.bin"):
        paired(["7", "07"], drive("007x", "7"))


def test_a_recording_without_sweeps_has_no_frames():
    with pytest.raises(DataError, match="lidar sweeps"):
        paired(["0"], replace(bare, sweeps=()))


@given(st.lists(st.integers(0, 10**9), min_size=1, max_size=8, unique=True), st.integers(-5, 5))
def test_written_numbers_are_read_back(numbers, first_frame):
    recording = drive(*(f"{number:010d}" for number in sorted(numbers)))
    options = LabelOptions(first_frame=first_frame)
    written = frame_numbers(recording, options)
    found = pair_with_sweeps([str(number) for number in written.values()], recording, options, source=SOURCE)
    assert {ref.timestamp_ns: int(name) for name, ref in found.items()} == written


def test_times_are_no_numbers_of_frames():
    recording = drive(*(str(time_ns) for time_ns in street.TIMES_NS[:3]), times_ns=list(street.TIMES_NS[:3]))
    assert list(frame_numbers(recording, PLAIN).values()) == [0, 1, 2]


def test_classes_are_known_in_any_case_and_the_user_goes_first():
    options = LabelOptions(classes={"Rider": "pedestrian", "misc": None})
    found = map_classes(["Car", "PEDESTRIAN", "rider", "Misc"], options, source=SOURCE)
    assert found == {"Car": "vehicle", "PEDESTRIAN": "pedestrian", "rider": "pedestrian", "Misc": None}
    assert left_out(found, {"Misc": 3}) == ("3 objects of class 'Misc', left out as asked",)


def test_all_unknown_classes_are_named_at_once():
    told = r"got 'Blimp', 'Yeti'; map each of them: --class Blimp=CLASS --class Yeti=CLASS; CLASS is one of pedestrian"
    with pytest.raises(DataError, match=told):
        map_classes(["Yeti", "Car", "Blimp"], PLAIN, source=SOURCE)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("egocar", "--class egocar=none"),
        ("Ego vehicle", "--class 'Ego vehicle=none'"),
        ("police_car", "--class police_car=vehicle"),
        ("vehicle.bicycle", "--class vehicle.bicycle=cyclist"),
        ("vehicle.bus.rigid", "--class vehicle.bus.rigid=vehicle"),
        ("parkedCars", "--class parkedCars=vehicle"),
    ],
)
def test_a_name_that_tells_its_class_is_proposed_as_that(name, told):
    with pytest.raises(DataError, match=rf"map each of them: {told}$"):
        map_classes([name], PLAIN, source=SOURCE)


@pytest.mark.parametrize("name", ["cart", "bus_stop", "cargo", "scarecrow", "carpet", "dogma", "bicycle_rack", "Busch"])
def test_a_name_that_only_holds_the_letters_of_a_class_is_not(name):
    with pytest.raises(DataError, match=rf"map each of them: --class {name}=CLASS;"):
        map_classes([name], PLAIN, source=SOURCE)


@pytest.mark.parametrize("name", ["DontCare", "dontcare", "DONT_CARE", "ignore", "Ignore Area"])
def test_areas_in_which_nobody_looked_are_known(name):
    assert is_ignored(name)
    assert map_classes([name], PLAIN, source=SOURCE)
    assert map_classes([name], LabelOptions(classes={name: None}), source=SOURCE) == {name: None}
    assert not is_ignored("car")


def test_classes_that_are_none_of_ours_are_refused():
    with pytest.raises(
        UsageError, match="class 'Van': expected one of pedestrian, cyclist, vehicle, animal, got 'truck'"
    ):
        LabelOptions(classes={"Van": "truck"})


def test_the_users_class_is_written():
    defaults = {"vehicle": "Car"}
    assert tool_class("vehicle", LabelOptions(classes={"Misc": None, "Van": "vehicle"}), defaults) == "Van"
    assert tool_class("vehicle", PLAIN, defaults) == "Car"
