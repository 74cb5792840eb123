"""What moves in a street is found without labels, with its speed; what stands is not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.annotation import evaluate_proposals, proposal_scores, propose
from bench.annotation.boxes import Box, Motion, _visible_shift, guess_class
from bench.annotation.proposals import is_own
from bench.annotation.settings import ProposalSettings
from bench.annotation.tracking import Fragment
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings import NOT_ANNOTATED
from tests.annotation.street import COARSE, annotated, street
from tests.validation import drive


def speeds(proposal):
    return np.hypot(*proposal.velocity_mps.T)


def test_what_moves_is_found_and_nothing_else(recording, proposals):
    frames = evaluate_proposals(recording, annotated(proposals, recording))
    scores = proposal_scores(frames, minutes=1 / 40).set_index(["range", "group"]).loc[("all", "all")]
    assert scores["recall"] > 0.9
    assert scores["precision"] == 1.0
    assert scores["switches"] == 0
    assert scores["speed_error_p90"] < 0.3
    assert set(frames.loc[frames["outcome"] == "found", "object"]) == {"walker", "leader", "rider"}


def test_classes_sizes_and_speeds(proposals):
    by_class = {proposal.object_class: proposal for proposal in proposals}
    assert sorted(by_class) == ["cyclist", "pedestrian", "vehicle"]
    assert [round(float(np.median(speeds(by_class[name]))), 0) for name in ("cyclist", "vehicle")] == [4.0, 6.0]
    np.testing.assert_allclose(by_class["cyclist"].size_m[0], 1.8, atol=0.4)
    assert dict(by_class["vehicle"].doubts).keys() == {"seen from one end"}  # its rear is all that the lidar sees


@pytest.mark.parametrize(
    ("length_m", "width_m", "speed_mps", "expected"),
    [
        (4.2, 1.8, 0.0, "vehicle"), (2.0, 1.4, 1.0, "vehicle"), (1.8, 0.7, 4.0, "cyclist"),
        (1.8, 0.7, 1.2, "pedestrian"),  # pushes a bicycle, or walks with a dog
        (0.7, 0.7, 3.0, "pedestrian"),
    ],
)  # fmt: skip
def test_size_and_speed_tell_the_class(length_m, width_m, speed_mps, expected):
    assert guess_class(np.array([length_m, width_m, 1.7]), speed_mps) == expected


REAR, FRONT = (np.stack([np.full(9, x), np.linspace(-0.9, 0.9, 9)], axis=1) for x in (-1.6, 1.6))
FLANK = np.stack([np.linspace(-1.6, 1.6, 14), np.full(14, 0.9)], axis=1)
MIRRORS = np.array([[1.5, -0.95], [1.5, 0.95], [1.55, -0.9], [1.55, 0.9]])


@pytest.mark.parametrize(
    ("seen", "ends_seen"),
    [
        ([REAR], False), ([REAR, MIRRORS], False), ([REAR, FRONT], True), ([FLANK], True),
        ([REAR, FLANK[:7]], False),  # half of a flank
    ],
    ids=["rear", "rear and mirrors", "rear and front", "flank", "rear and half a flank"],
)  # fmt: skip
def test_mirrors_are_no_other_end(seen, ends_seen):
    """A box of 3.2 m by 2 m around returns of one sweep, 5 m ahead and turned by a right angle; it has gone 0.5 m."""
    points = np.concatenate(seen) @ np.array([[0.0, 1.0], [-1.0, 0.0]]) + [5.0, 0.5]
    motion = Motion(
        times_s=np.array([0.1]),
        offset_s=np.array([0.1]),
        positions_m=np.array([[5.0, 0.5]]),
        velocity_mps=np.array([[0.0, 5.0]]),
        points=(np.column_stack([points, np.ones(len(points))]),),
        cut_off=(np.zeros(len(points), dtype=bool),),
    )
    box = Box(
        fragment=Fragment(chain=0, observations=()),
        motion=motion,
        moving=np.array([True]),
        centres_m=np.array([[5.0, 0.0]]),
        bottom_m=np.zeros(1),
        yaw_rad=np.array([np.pi / 2]),
        size_m=np.array([3.2, 2.0, 1.5]),
        top_seen=True,
    )
    assert box.ends_seen == ends_seen


@pytest.mark.parametrize(
    ("beside_m", "ranges_m", "way_m", "own"),
    [
        (1.3, 0.02, 8.0, True),  # a mirror
        (1.3, 0.02, 0.0, False),  # who stands beside a vehicle that stands
        (2.5, 0.5, 8.0, False),  # who walks along
        (8.0, 0.02, 8.0, False),  # who drives as fast
    ],
    ids=["mirror", "standing", "walking along", "ahead"],
)
def test_what_keeps_its_place_beside_the_lidar_is_the_vehicle_itself(beside_m, ranges_m, way_m, own):
    sensors_m = np.column_stack([np.linspace(0.0, way_m, 9), np.zeros(9)])
    places_m = sensors_m + np.column_stack([np.zeros(9), beside_m + np.linspace(0.0, ranges_m, 9)])
    seen = tuple(SimpleNamespace(cloud=SimpleNamespace(sensor_m=place)) for place in sensors_m)
    box = SimpleNamespace(fragment=SimpleNamespace(observations=seen), centres_m=places_m)
    assert is_own(box, ProposalSettings()) == own


@pytest.mark.parametrize(
    ("size_m", "height_m", "doubts"),
    [
        ((4.4, 1.8, 1.5), 1.5, set()),
        ((5.4, 2.0, 2.6), 2.4, {"top not seen"}),  # a van, by its length and width
        ((7.0, 2.5, 3.5), 3.3, {"top not seen"}),
        ((9.0, 2.5, 3.5), 3.3, {"top not seen"}),
    ],
)
def test_the_highest_beam_is_no_top(tmp_path, monkeypatch, size_m, height_m, doubts):
    """From a lidar at 1.8 m, beams of up to 4.5 degrees reach 2.1 m, 4 m away; the box goes on to a likely height."""
    passing = {"passing": ("vehicle", (-1.0, 5.0, size_m[2] / 2), 0.0, 12.0, size_m)}
    monkeypatch.setattr(drive, "OBJECTS", passing)
    monkeypatch.setattr(drive, "TURN_RADPS", 0.0)
    (found,) = propose(street(tmp_path / "street"), settings=COARSE)
    np.testing.assert_allclose(found.size_m[2], height_m, atol=0.15)
    assert {reason for reason, _ in found.doubts} & {"top not seen"} == doubts


@pytest.mark.parametrize(("heading_rad", "place_m"), [(np.pi / 2, (12.0, -1.5, 1.3)), (0.0, (3.0, 3.5, 1.3))])
def test_a_long_vehicle_that_goes_less_than_its_length(tmp_path, monkeypatch, heading_rad, place_m):
    """Most of its side covers itself in other sweeps: 3 m are gone in all, of 7."""
    monkeypatch.setattr(drive, "OBJECTS", {"slow": ("vehicle", place_m, heading_rad, 2.0, (7.0, 2.5, 2.4))})
    monkeypatch.setattr(drive, "SPEED_MPS", 1.5)
    monkeypatch.setattr(drive, "TURN_RADPS", 0.0)
    recording = street(tmp_path / "street")
    proposals = propose(recording, settings=COARSE)
    frames = evaluate_proposals(recording, annotated(proposals, recording))
    assert frames["outcome"].value_counts().to_dict() == {"found": drive.SWEEPS}
    assert frames["speed_error_mps"].max() < 0.3


def test_again_gives_the_same(recording, proposals):
    again = propose(recording, settings=COARSE)
    assert [one.track_id for one in again] == [one.track_id for one in proposals] == ["p000", "p001", "p002"]
    for one, other in zip(again, proposals, strict=True):
        np.testing.assert_array_equal(one.centres_m, other.centres_m)
        np.testing.assert_array_equal(one.velocity_mps, other.velocity_mps)


def test_segments_of_a_long_drive_are_one_track(recording, proposals):
    """Sweeps are forgotten after a segment; what goes on is one proposal all the same."""
    pieces = propose(recording, settings=replace(COARSE, segment_s=0.75))
    assert len(pieces) == len(proposals)
    rider, whole = pieces[0], proposals[0]
    assert set(rider.timestamps_ns) == set(whole.timestamps_ns)
    np.testing.assert_allclose(rider.centres_m, whole.centres_m, atol=0.25)


def test_who_starts_within_the_drive_rests_before(tmp_path, monkeypatch):
    """At rest for 0.5 s, then 6 m/s2: the states at rest stay, with velocity 0."""
    constant = drive.pose_at

    def starting(name, seconds):
        return constant(name, 0.75 * max(seconds - 0.5, 0.0) ** 2 if name == "rider" else seconds)  # the rider's 4 m/s

    monkeypatch.setattr(drive, "pose_at", starting)
    found = propose(street(tmp_path / "street"), settings=COARSE)
    rider = max(found, key=lambda proposal: proposal.centres_m[0, 1])
    moves = speeds(rider)
    assert len(moves) == drive.SWEEPS
    assert (moves[:4] == 0.0).all()
    assert (moves[-5:] > 1.5).all()


def test_people_side_by_side_are_two(tmp_path, monkeypatch):
    walkers = {
        name: ("pedestrian", (12.0, y, 0.9), np.pi, 1.2, (0.4, 0.5, 1.8)) for name, y in (("a", 2.0), ("b", 2.75))
    }
    monkeypatch.setattr(drive, "OBJECTS", walkers)
    recording = street(tmp_path / "street")
    proposals = propose(replace(recording, tracks=(), annotated=NOT_ANNOTATED), settings=COARSE)
    frames = evaluate_proposals(recording, annotated(proposals, recording))
    assert set(frames.loc[frames["outcome"] == "found", "object"]) == {"a", "b"}
    assert "false" not in set(frames["outcome"])
    assert [proposal.object_class for proposal in proposals] == ["pedestrian", "pedestrian"]


def test_tilted_mounting_changes_nothing(recording, proposals):
    """Each sweep is levelled by its own road, since the bus's ego-motion knows no pitch."""
    tilt = RigidTransform(Rotation.from_euler("y", 0.015).as_matrix(), np.zeros(3))
    tilted = replace(recording, vehicle_from_lidar=recording.vehicle_from_lidar @ tilt)
    assert len(propose(tilted, settings=COARSE)) == len(proposals)


def test_proposals_need_sweeps(recording):
    with pytest.raises(DataError, match="expected lidar sweeps"):
        propose(replace(recording, sweeps=()))


def test_a_proposal_as_annotation(recording, proposals):
    track = annotated(proposals, recording)[0]
    world_from_vehicle = recording.trajectory.world_from_vehicle(track.states[3].timestamp_ns)
    shape = track.states[3].shape
    centre = world_from_vehicle.apply(shape.vehicle_from_object.translation_m)
    np.testing.assert_allclose(centre, proposals[0].centres_m[3], atol=1e-9)
    velocity = world_from_vehicle.rotate(track.states[3].velocity_mps)
    np.testing.assert_allclose(velocity[:2], proposals[0].velocity_mps[3], atol=1e-9)


@pytest.mark.parametrize("returns", [4, 40])
def test_a_long_object_is_shifted_by_the_ends_that_both_sweeps_see(returns):
    side = np.column_stack([np.linspace(0.0, 4.0, returns), np.zeros(returns), np.ones(returns)])
    uncut = np.zeros(returns, dtype=bool)
    moved = side + np.array([0.5, 0.0, 0.0])
    np.testing.assert_allclose(_visible_shift((side, moved), (uncut, uncut), np.array([0.3, 0.0])), [0.5, 0.0])
