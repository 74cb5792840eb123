"""Observations become tracks: classes, velocities, objects without ids, faults, and what is said of them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.annotation.formats.conversion import (
    LONGEST_GAP_NS,
    LabelOptions,
    Observation,
    ToolLabels,
    followed,
    import_labels,
    map_classes,
    middle_velocities,
    with_motion,
)
from bench.annotation.formats.openlabel import OpenLabelFormat
from bench.errors import DataError
from tests.annotation.formats import street

PLAIN = LabelOptions()
STEP_NS = street.STEP_NS


@pytest.fixture
def handed(monkeypatch, drive):
    """Import what a format would hand over."""

    def bring(observations, options=PLAIN, times_ns=street.TIMES_NS, lost=()):
        labels = ToolLabels(observations=tuple(observations), timestamps_ns=times_ns, lost=lost)
        monkeypatch.setattr(OpenLabelFormat, "read", lambda *_: labels)
        return import_labels("openlabel", drive.root / "x", drive, options)

    return bring


def seen(name, *, track=None, label="Car", sweeps=range(street.SWEEPS)):
    states = street.box_track(name, told=False).states
    return [Observation(track=name if track is None else track, label=label, state=states[i]) for i in sweeps]


def test_an_object_twice_at_one_time_or_of_two_classes_is_refused(handed):
    with pytest.raises(DataError, match=f"object 'car': expected one place at each time, got 2 at {street.FIRST_NS}"):
        handed([*seen("car"), *seen("parked", track="car", sweeps=[0])])
    with pytest.raises(DataError, match="object 'car': expected one class for each object, got 'Car' and 'Person'"):
        handed([*seen("car", sweeps=[0, 1]), *seen("car", label="Person", sweeps=[2])])
    assert len(handed([*seen("car", sweeps=[0, 1]), *seen("car", label="van", sweeps=[2])]).tracks) == 1


def test_sweeps_without_a_frame_are_counted(handed):
    first, second = handed([], times_ns=street.TIMES_NS[2:5], lost=("a",)).lost
    assert first == "a"
    assert second.startswith("3 of 6 sweeps have no frame in the source, first 000000.npz: ")


def test_times_of_another_unit_are_refused(handed):
    with pytest.raises(DataError, match=r"times: expected nanoseconds.* microseconds: multiply them by 1000"):
        handed([], times_ns=[time_ns // 1000 for time_ns in street.TIMES_NS])


def test_objects_without_ids_are_followed_class_by_class(handed):
    mixed = [*seen("car", track=""), *seen("walker", track="", label="Person"), *seen("parked", track="")]
    found = handed(reversed(mixed))
    assert {(track.track_id, len(track.states)) for track in found.tracks} == {
        ("Car-unnamed-1", 6),
        ("Car-unnamed-2", 6),
        ("Person-unnamed-1", 6),
    }
    assert "places of Car without an id: followed by nearness, 2 objects (12)" in found.lost
    walker = next(track for track in found.tracks if track.object_class == "pedestrian")
    for state, true in zip(walker.states, street.box_track("walker").states, strict=True):
        assert state.velocity_mps == pytest.approx(true.velocity_mps, abs=1e-6)


def test_objects_seen_once_are_reported(handed):
    found = handed(seen("car", sweeps=[3]))
    assert np.isnan(found.tracks[0].states[0].velocity_mps).all()
    assert any(
        line.startswith("objects that are seen once: their speed is unknown") and line.endswith("(1)")
        for line in found.lost
    )


def test_classes_that_nobody_can_tell_are_unclear_and_those_left_out_are_counted(handed):
    unclear = [*seen("car", label="DontCare"), *seen("parked", label="Misc")]
    found = handed(unclear, LabelOptions(classes={"Misc": "unclear"}))
    assert [all(state.unclear for state in track.states) for track in found.tracks] == [True, True]
    own = LabelOptions(classes={"misc": None, "rider": "pedestrian"})  # in any case, and the user goes first
    found = handed([*seen("car", label="Rider"), *seen("parked", label="Misc")], own)
    assert [(track.track_id, track.object_class) for track in found.tracks] == [("car", "pedestrian")]
    assert "places of class 'Misc': left out as asked (6)" in found.lost


def test_all_unknown_classes_are_named_at_once(tmp_path):
    told = r"got 'Blimp', 'Yeti'; map each of them, as --class 'Blimp=CLASS'; CLASS is one of pedestrian"
    with pytest.raises(DataError, match=told):
        map_classes(["Yeti", "Car", "Blimp"], PLAIN, source=tmp_path)


def test_velocities_and_turns_come_from_the_places_in_the_world_where_the_files_have_none():
    for name in ("walker", "car"):
        states = with_motion(seen(name), street.trajectory())
        for state, true in zip(states, street.box_track(name).states, strict=True):
            assert state.velocity_mps == pytest.approx(true.velocity_mps, abs=1e-6)
            assert state.yaw_rate_radps == pytest.approx(street.TURNS_RADPS[name], abs=1e-9)
    told = replace(street.box_track("car").states[2], velocity_mps=np.array([1.0, 2.0, 3.0]), yaw_rate_radps=9.0)
    mixed = [*seen("car", sweeps=[0, 1]), Observation(track="car", label="Car", state=told)]
    state = with_motion(mixed, street.trajectory())[2]
    assert (state.velocity_mps.tolist(), state.yaw_rate_radps) == ([1.0, 2.0, 3.0], 9.0)


def later(observations, by_ns):
    return [replace(o, state=replace(o.state, timestamp_ns=o.state.timestamp_ns + by_ns)) for o in observations]


def test_an_object_out_of_sight_for_long_says_nothing_of_its_speed():
    ego = street.trajectory()
    long = replace(ego, timestamps_ns=ego.timestamps_ns * 3 - 2 * ego.timestamps_ns[0])
    *known, last = seen("walker")
    (late,) = later([last], LONGEST_GAP_NS + 1 - STEP_NS)
    states = with_motion([*known, late], long)
    assert np.isfinite(states[-2].velocity_mps).all()
    assert np.isnan(states[-1].velocity_mps).all()
    (near,) = later([last], LONGEST_GAP_NS - STEP_NS)
    assert np.isfinite(with_motion([*known, near], long)[-1].velocity_mps).all()
    for state in with_motion(later(seen("walker"), 10**12), ego):  # without ego-motion nothing is said
        assert np.isnan(state.velocity_mps).all()


def numbered(*places, step_ns=STEP_NS, fastest_mps=30.0):
    rows = [np.array(row, dtype=float).reshape(-1, 3) for row in places]
    return followed([i * step_ns for i in range(len(rows))], rows, fastest_mps=fastest_mps)


def test_objects_keep_their_number_whatever_the_order():
    one, other = [[i, 0.0, 0.0] for i in range(5)], [[10.0 - i, 1.0, 0.0] for i in range(5)]
    places = [[a, b] if i % 2 else [b, a] for i, (a, b) in enumerate(zip(one, other, strict=True))]
    assert numbered(*places) == [[0, 1], [1, 0], [0, 1], [1, 0], [0, 1]]


@pytest.mark.parametrize(
    ("places", "numbers"),
    [
        ([[[0, 0, 0]], [[2.9, 0, 0]], [[5.8, 0, 0]], [], [[11.6, 0, 0]]], [[0], [0], [0], [], [0]]),  # fast, and a gap
        ([[[0, 0, 0]], [[4.1, 0, 0]]], [[0], [1]]),  # 30 m/s over 0.1 s, and a metre
        ([[[0, 0, 0]], [[3.9, 0, 0]]], [[0], [0]]),
        ([[[0, 0, 0]], *[[]] * 10, [[0, 0, 0]]], [[0], *[[]] * 10, [1]]),
        ([[[0, 0, 0]], *[[]] * 9, [[0, 0, 0]]], [[0], *[[]] * 9, [0]]),
        ([[[0, 0, 0]], [[np.nan] * 3], [[0, 0, 0]], [[np.nan] * 3]], [[0], [1], [0], [2]]),
    ],
    ids=["fast", "far", "near", "long gone", "gone for a second", "unknown places"],
)
def test_far_or_long_gone_ones_are_new(places, numbers):
    assert numbered(*places) == numbers


@pytest.mark.parametrize("step_ns", [100_000_000, 500_000_000, 1_000_000_000])
def test_the_step_of_one_object_grows_with_the_gap(step_ns):
    """A cyclist at 7 m/s, labelled ten times a second down to once."""
    cyclist = [[7.0 * step_ns / 1e9 * i, 0.0, 0.0] for i in range(4)]
    assert numbered(*([place] for place in cyclist), step_ns=step_ns, fastest_mps=15.0) == [[0]] * 4


@given(st.lists(st.lists(st.tuples(*[st.floats(-5, 5)] * 3), max_size=4), max_size=6))
def test_no_two_groups_of_a_sweep_are_one_object(places):
    numbers = numbered(*places)
    assert [len(row) for row in numbers] == [len(row) for row in places]
    assert all(len(set(row)) == len(row) for row in numbers)
    every = {number for row in numbers for number in row}
    assert every == set(range(len(every)))


def test_the_slope_of_a_straight_line_is_found_exactly():
    times_ns = 1_700_000_000_000_000_000 + np.array([0, 1, 2, 4, 7]) * STEP_NS
    seconds = (times_ns - times_ns[0]) / 1e9
    middles_m = np.array([5.0, -2.0, 0.5]) + seconds[:, None] * [3.0, -1.0, 0.0]
    assert middle_velocities(times_ns, middles_m) == pytest.approx(np.tile([3.0, -1.0, 0.0], (5, 1)), abs=1e-9)
    middles_m[2] = np.nan  # no ego-motion there: the others still tell
    assert middle_velocities(times_ns, middles_m) == pytest.approx(np.tile([3.0, -1.0, 0.0], (5, 1)), abs=1e-9)
    velocities = middle_velocities(np.array([0, 600, 700]) * 1_000_000, np.arange(9.0).reshape(3, 3))
    assert np.isnan(velocities[0]).all()  # nothing else within half a second
    assert velocities[1] == pytest.approx([30.0, 30.0, 30.0])
