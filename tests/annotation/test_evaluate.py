"""Proposals are compared by the returns in their boxes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.annotation.evaluate import evaluate_proposals, proposal_scores, worst_tracks
from bench.errors import UsageError
from bench.geometry import RigidTransform
from bench.records.recording import NOT_ANNOTATED, Annotated, Cuboid
from tests.support.drive import OBJECTS, SWEEPS


def outcomes(recording, proposed):
    frames = evaluate_proposals(recording, proposed)
    scores = proposal_scores(frames, minutes=0.5).set_index(["range", "group"]).loc[("all", "all")]
    return frames, scores


def named(recording, *names, as_=None):
    tracks = {track.track_id: track for track in recording.tracks}
    return [replace(tracks[name], track_id=as_ or f"p-{name}") for name in names]


def outcomes_of(frames, name, column="object"):
    return set(frames.loc[frames[column] == name, "outcome"])


def test_the_annotations_themselves_are_right(recording):
    frames, scores = outcomes(recording, recording.tracks)
    assert scores["recall"] == scores["precision"] == 1.0
    assert scores["speed_error_p90"] == scores["centre_error_p90"] == scores["false_tracks_per_minute"] == 0.0
    assert outcomes_of(frames, "parked") == {"neutral"}
    assert worst_tracks(frames).empty
    near, every = (proposal_scores(frames, minutes=1.0).set_index("range").loc[name] for name in ("< 8 m", "all"))
    assert {"all", "cyclist"} <= set(near["group"])
    assert near["object_frames"].max() < every["object_frames"].max()
    assert set(frames["object_class"]) == {kind for kind, *_ in OBJECTS.values()}


def test_a_second_proposal_for_an_object_is_false(recording):
    _, scores = outcomes(recording, [*named(recording, "leader"), *named(recording, "leader", as_="again")])
    assert scores["precision"] == 0.5
    assert scores["false_tracks_per_minute"] == 2.0


def test_moving_on_what_rests_is_false(recording):
    (parked,) = named(recording, "parked")
    states = tuple(replace(state, velocity_mps=np.array([2.0, 0.0, 0.0])) for state in parked.states)
    frames, _ = outcomes(recording, [replace(parked, states=states)])
    assert outcomes_of(frames, "p-parked", "proposal") == {"false"}


def test_a_track_that_changes_its_name(recording):
    (whole,) = named(recording, "rider")
    parts = (("first", whole.states[:8]), ("then", whole.states[8:]))
    _, scores = outcomes(recording, [replace(whole, track_id=name, states=states) for name, states in parts])
    assert scores["switches"] == 1


def test_errors_of_boxes_and_classes(recording):
    (rider,) = named(recording, "rider", as_="found")
    turn = RigidTransform(Rotation.from_euler("z", 30, degrees=True).as_matrix(), np.zeros(3))
    larger_m, states = np.array([0.1, 0.2, 1.5]), []
    for state in rider.states:
        pose, size_m = state.shape.vehicle_from_object, state.shape.size_m
        states.append(replace(state, shape=Cuboid(vehicle_from_object=pose @ turn, size_m=size_m + larger_m)))
    found = replace(rider, object_class="pedestrian", states=tuple(states))
    frames, scores = outcomes(recording, [found, *named(recording, "leader")])
    by_class = proposal_scores(frames, minutes=0.5).set_index(["range", "group"])
    assert by_class.loc[("all", "cyclist"), "size_error_p90"] == pytest.approx(1.5)
    assert by_class.loc[("all", "cyclist"), "yaw_error_deg_median"] == pytest.approx(30.0)
    assert by_class.loc[("all", "vehicle"), "size_error_p90"] == 0.0
    assert by_class.loc[("all", "vehicle"), "yaw_error_deg_p90"] == pytest.approx(0.0, abs=1e-6)
    count = int((frames.loc[frames["outcome"] == "found", "object"] == "rider").sum())
    assert scores["class_right"] == 1 - count / (frames["outcome"] == "found").sum()
    assert count > 0


def test_the_worst_tracks(recording):
    (rider,) = named(recording, "rider", as_="found")
    cut = replace(rider, object_class="pedestrian", states=rider.states[:6])
    frames, _ = outcomes(recording, [cut, *named(recording, "leader"), *named(recording, "leader", as_="again")])
    rows = worst_tracks(frames).set_index(["track", "wrong"])["frames"]
    assert rows["walker", "missed"] == ((frames["object"] == "walker") & (frames["outcome"] == "missed")).sum()
    assert rows["rider", "missed"] == SWEEPS - 6
    assert rows["rider", "cyclist proposed as pedestrian"] == 6
    assert {name for name, wrong in rows.index if wrong == "false"} <= {"again", "p-leader"}
    assert rows.is_monotonic_decreasing
    assert set(worst_tracks(outcomes(recording, [])[0])["wrong"]) == {"missed"}


def test_without_annotations_there_is_nothing_to_compare_with(recording):
    with pytest.raises(UsageError, match="expected annotations to compare with"):
        evaluate_proposals(replace(recording, annotated=NOT_ANNOTATED), ())


def around(recording, name, margin_m=1.0):
    """The area of the vehicle frame in which an object is, at all times."""
    (track,) = (track for track in recording.tracks if track.track_id == name)
    places = np.array([state.shape.vehicle_from_object.translation_m[:2] for state in track.states])
    (x0, y0), (x1, y1) = places.min(axis=0) - margin_m, places.max(axis=0) + margin_m
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def test_what_is_seen_where_nobody_annotated_is_neither_right_nor_wrong(recording):
    known = [track for track in recording.tracks if track.track_id != "rider"]
    partly = replace(recording, tracks=tuple(known))
    frames, scores = outcomes(partly, recording.tracks)
    assert outcomes_of(frames, "rider", "proposal") == {"false"}
    assert scores["precision"] < 1.0
    left_out = replace(partly.annotated, left_out_m=(around(recording, "rider"),))
    frames, scores = outcomes(replace(partly, annotated=left_out), recording.tracks)
    assert outcomes_of(frames, "rider", "proposal") == {"neutral"}
    assert scores["precision"] == 1.0
    missed, _ = outcomes(replace(recording, annotated=left_out), ())  # nor is it asked for
    assert outcomes_of(missed, "rider") == {"neutral"}


def test_times_that_nobody_annotated_are_not_compared(recording):
    times_ns = [sweep.timestamp_ns for sweep in recording.sweeps]
    half = Annotated(spans_ns=((times_ns[0], times_ns[7]),))
    frames, _ = outcomes(replace(recording, annotated=half), ())
    assert set(frames.loc[frames["timestamp_ns"] > times_ns[7], "outcome"]) == {"neutral"}
    assert "missed" in set(frames.loc[frames["timestamp_ns"] <= times_ns[7], "outcome"])
