"""Frames of a tool and sweeps of a recording: paired by key, never shifted in silence."""

from dataclasses import replace
from pathlib import Path

import pytest

from bench.annotation.formats.conversion import LabelOptions, pair_with_sweeps, recording_times
from bench.errors import DataError
from bench.lidar.files import read_sweep
from bench.recordings import SweepRef
from tests.annotation.formats import street

SOURCE = Path("labels")
PLAIN = LabelOptions()


def with_sweeps(recording, *stems):
    sweeps = tuple(
        SweepRef(timestamp_ns=street.FIRST_NS + i * street.STEP_NS, path=Path(f"{stem}.bin"), reader=read_sweep)
        for i, stem in enumerate(stems)
    )
    return replace(recording, sweeps=sweeps)


def paired(names, recording, options=PLAIN):
    return {name: ref.path.stem for name, ref in pair_with_sweeps(names, recording, options, source=SOURCE).items()}


TIME = str(street.FIRST_NS + street.STEP_NS)


@pytest.mark.parametrize(
    ("stems", "names", "first_frame", "expected"),
    [
        ("abc", ["b", "a"], None, {"a": "a", "b": "b"}),
        (["0000000250", "0000000251"], ["000250"], None, {"000250": "0000000250"}),  # whatever zeros stand before
        (["frame_7", "frame_8"], [TIME], None, {TIME: "frame_8"}),
        ("xyz", ["0", "2"], 0, {"0": "x", "2": "z"}),
        ("xyz", ["5", "6"], 5, {"5": "x", "6": "y"}),
        ("xyz", ["000005"], 5, {"000005": "x"}),
        ("012", ["1", "2"], 1, {"1": "0", "2": "1"}),  # even where names would fit
        (["50", "51", "52"], ["0", "1"], -1, {"0": "51", "1": "52"}),
    ],
)
def test_frames_pair_by_name_time_or_count(drive, stems, names, first_frame, expected):
    assert paired(names, with_sweeps(drive, *stems), LabelOptions(first_frame=first_frame)) == expected


@pytest.mark.parametrize(
    ("stems", "names", "first_frame", "told"),
    [
        ("xyz", ["0", "2"], None, r"got 0, 2; name frames after the sweeps; or, .* say with --first-frame"),
        # All but the last of the names fit; by them each label would go to the sweep before its own.
        ("012", ["1", "2", "3"], None, r"expected frames named like the 3 sweeps, 0 to 2.*got 3; name frames"),
        ("012", ["1", "2", "3"], 0, "expected frames from 0 to 2, got 3; --first-frame is the number"),
        # By place, 249 would take the first sweep.
        (["250", "251"], ["249", "250"], None, "labels: frames: expected frames named .*, 250 to 251.*got 249;"),
        (["007x", "7"], ["7", "07"], None, r"expected one frame for each sweep, got '7' and '07' of 7\.bin"),
        ("", ["0"], None, "lidar sweeps"),
        *[("abc", ["0", name], None, "--first-frame") for name in ("-1", "3", "x", "", "9" * 40, "1.0")],
    ],
)
def test_frames_that_fit_nothing_are_named_and_none_is_shifted(drive, stems, names, first_frame, told):
    with pytest.raises(DataError, match=told):
        paired(names, with_sweeps(drive, *stems), LabelOptions(first_frame=first_frame))


def test_times_near_a_sweep_are_the_sweeps_and_others_stay(drive):
    recording = with_sweeps(drive, "a", "b")
    first, second = street.FIRST_NS, street.FIRST_NS + street.STEP_NS
    found = recording_times([first + 256, second - 999_999, first + 50_000_000], recording, source=SOURCE, field="t")
    assert found == [first, second, first + 50_000_000]
    for wrong in (first // 10**9, first // 1000, first - 2 * 10**9):
        told = f"expected times of the recording, {first} to .*got {wrong} ns; .*--time-unit"
        with pytest.raises(DataError, match=told):
            recording_times([wrong], recording, source=SOURCE, field="t")
