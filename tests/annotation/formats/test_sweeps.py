"""Frames of a tool and sweeps of a recording: paired by key, never shifted in silence."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.annotation.formats import LabelOptions
from bench.annotation.formats.sweeps import pair_with_sweeps, recording_times
from bench.errors import DataError
from bench.lidar import read_sweep
from bench.recordings import SweepRef
from tests.annotation.formats import street

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


def test_frames_that_are_counted_pair_only_where_the_user_says_from_which_number():
    with pytest.raises(DataError, match=r"got 0, 2; name frames after the sweeps; or, .* say with --first-frame"):
        paired(["0", "2"], drive("x", "y", "z"))
    assert paired(["0", "2"], drive("x", "y", "z"), LabelOptions(first_frame=0)) == {"0": "x", "2": "z"}
    assert paired(["5", "6"], drive("x", "y", "z"), LabelOptions(first_frame=5)) == {"5": "x", "6": "y"}
    assert paired(["000005"], drive("x", "y", "z"), LabelOptions(first_frame=5)) == {"000005": "x"}


def test_frames_from_1_are_not_taken_for_frames_from_0():
    """All but the last of the names fit; by them each label would go to the sweep before its own."""
    with pytest.raises(DataError, match=r"expected frames named like the 3 sweeps, 0 to 2.*got 3; name frames"):
        paired(["1", "2", "3"], drive("0", "1", "2"))
    with pytest.raises(DataError, match="expected frames from 0 to 2, got 3; --first-frame is the number"):
        paired(["1", "2", "3"], drive("0", "1", "2"), LabelOptions(first_frame=0))


def test_the_first_frame_counts_even_where_names_would_fit():
    assert paired(["1", "2"], drive("0", "1", "2"), LabelOptions(first_frame=1)) == {"1": "0", "2": "1"}
    assert paired(["0", "1"], drive("50", "51", "52"), LabelOptions(first_frame=-1)) == {"0": "51", "1": "52"}


def test_one_missing_sweep_does_not_shift_the_others():
    """Labels 249 ... 251 and sweeps 250 ...: by place, 249 would take the first sweep."""
    with pytest.raises(
        DataError, match=r"labels: frames: expected frames named like the 3 sweeps, 250 to 252.*got 249;"
    ):
        paired(["249", "250", "251"], drive("250", "251", "252"))


@pytest.mark.parametrize("name", ["-1", "3", "x", "", "9" * 40, "1.0"])
def test_frames_that_fit_nothing_are_named(name):
    with pytest.raises(DataError, match="--first-frame"):
        paired(["0", name], drive("a", "b", "c"))


def test_two_frames_of_one_sweep_are_refused():
    with pytest.raises(DataError, match=r"expected one frame for each sweep, got '7' and '07' of 7\.bin"):
        paired(["7", "07"], drive("007x", "7"))


def test_a_recording_without_sweeps_has_no_frames():
    with pytest.raises(DataError, match="lidar sweeps"):
        paired(["0"], replace(bare, sweeps=()))


@given(st.lists(st.integers(0, 10**9), min_size=1, max_size=8, unique=True), st.data())
def test_frames_pair_with_their_own_sweep_or_not_at_all(numbers, data):
    recording = drive(*(f"{number:010d}" for number in sorted(numbers)))
    asked = data.draw(st.lists(st.integers(0, 10**9), min_size=1, max_size=8, unique=True))
    try:
        found = paired(list(map(str, asked)), recording)
    except DataError:
        assert not set(asked) <= set(numbers)
    else:
        assert {int(name): int(stem) for name, stem in found.items()} == {number: number for number in asked}


def test_times_near_a_sweep_are_the_sweeps_and_others_stay():
    recording = drive("a", "b")
    first, second = street.FIRST_NS, street.FIRST_NS + street.STEP_NS
    found = recording_times([first + 256, second - 999_999, first + 50_000_000], recording, source=SOURCE, field="t")
    assert found == [first, second, first + 50_000_000]
    for wrong in (first // 10**9, first // 1000, first - 2 * 10**9):
        with pytest.raises(
            DataError, match=f"expected times of the recording, {first} to .*got {wrong} ns; .*--time-unit"
        ):
            recording_times([wrong], recording, source=SOURCE, field="t")
