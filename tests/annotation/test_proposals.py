"""What moves in a street is found without labels, with its speed; what stands is not; and what lidars do beside."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.annotation.boxes import Box, guess_class
from bench.annotation.decisions import undecided
from bench.annotation.evaluate import evaluate_proposals, proposal_scores
from bench.annotation.proposals import is_own, propose
from bench.annotation.settings import ProposalSettings
from bench.annotation.tracking import Tracker
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.lidar.sweep import LidarSweep
from tests.annotation.street import COARSE, annotated, street
from tests.support import drive
from tests.support.tiny import VEHICLE_FROM_LIDAR


def motion(proposal):
    return undecided(proposal).motion


def speeds(proposal):
    return np.hypot(*motion(proposal).velocities_mps.T)


@pytest.fixture
def proposed(tmp_path, monkeypatch):
    """Proposals for a straight drive among some objects, and how they compare with the annotations."""

    def run(objects, *, ego_mps=2.0, **changed):
        changed |= {"OBJECTS": objects, "SPEED_MPS": ego_mps, "TURN_RADPS": 0.0}
        for name, value in changed.items():
            monkeypatch.setattr(drive, name, value)
        recording = street(tmp_path / "street")
        proposals = propose(recording, settings=COARSE)
        frames = evaluate_proposals(recording, annotated(proposals, recording))
        assert "false" not in set(frames["outcome"]) or "sweep" in changed
        return proposals, frames

    return run


def found(frames):
    return set(frames.loc[frames["outcome"] == "found", "object"])


def test_what_moves_is_found_and_nothing_else(recording, proposals):
    frames = evaluate_proposals(recording, annotated(proposals, recording))
    scores = proposal_scores(frames, minutes=1 / 40).set_index(["range", "group"]).loc[("all", "all")]
    assert scores["recall"] > 0.9
    assert scores["precision"] == 1.0
    assert scores["switches"] == 0
    assert scores["speed_error_p90"] < 0.3
    assert found(frames) == {"walker", "leader", "rider"}


def test_classes_sizes_and_speeds(proposals):
    by_class = {proposal.object_class: proposal for proposal in proposals}
    assert sorted(by_class) == ["cyclist", "pedestrian", "vehicle"]
    assert [round(float(np.median(speeds(by_class[name]))), 0) for name in ("cyclist", "vehicle")] == [4.0, 6.0]
    np.testing.assert_allclose(by_class["cyclist"].size_m[0], 1.8, atol=0.4)
    assert by_class["vehicle"].reasons == {"seen from one end"}  # its rear is all that the lidar sees


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
    motion = SimpleNamespace(offset_s=np.array([0.1]), velocity_mps=np.array([[0.0, 5.0]]), points=(points,))
    size_m, centres_m = np.array([3.2, 2.0, 1.5]), np.array([[5.0, 0.0]])
    box = SimpleNamespace(motion=motion, size_m=size_m, centres_m=centres_m, yaw_rad=[np.pi / 2])
    assert Box.ends_seen.fget(box) == ends_seen


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
    ("size_m", "height_m", "doubted"),
    [
        ((4.4, 1.8, 1.5), 1.5, False),
        ((5.4, 2.0, 2.6), 2.4, True),  # a van, by its length and width
        ((9.0, 2.5, 3.5), 3.3, True),
    ],
)
def test_the_highest_beam_is_no_top(proposed, size_m, height_m, doubted):
    """From a lidar at 1.8 m, beams of up to 4.5 degrees reach 2.1 m, 4 m away; the box goes on to a likely height."""
    passing = {"passing": ("vehicle", (-1.0, 5.0, size_m[2] / 2), 0.0, 12.0, size_m)}
    ((vehicle,), _) = proposed(passing, ego_mps=drive.SPEED_MPS)
    np.testing.assert_allclose(vehicle.size_m[2], height_m, atol=0.15)
    assert ("top not seen" in vehicle.reasons) == doubted


@pytest.mark.parametrize(("heading_rad", "place_m"), [(np.pi / 2, (12.0, -1.5, 1.3)), (0.0, (3.0, 3.5, 1.3))])
def test_a_long_vehicle_that_goes_less_than_its_length(proposed, heading_rad, place_m):
    """Most of its side covers itself in other sweeps: 3 m are gone in all, of 7."""
    slow = {"slow": ("vehicle", place_m, heading_rad, 2.0, (7.0, 2.5, 2.4))}
    _, frames = proposed(slow, ego_mps=1.5)
    assert frames["outcome"].value_counts().to_dict() == {"found": drive.SWEEPS}
    assert frames["speed_error_mps"].max() < 0.3


def test_again_gives_the_same(recording, proposals):
    again = propose(recording, settings=COARSE)
    assert [track.id for track in again] == ["p000", "p001", "p002"]
    assert again == proposals


@pytest.mark.parametrize(("more", "tracks"), [(0, 1), (1, 2)])
def test_a_track_ends_after_more_sweeps_without_a_cluster_than_may_be_missed(more, tracks):
    tracker, points = Tracker(ProposalSettings()), np.random.default_rng(4).uniform([9, 0, 0], [10, 1, 1], (50, 3))
    hidden = ProposalSettings().missed + more
    seen = [0, 1, 2, 3 + hidden, 4 + hidden]
    for number in range(5 + hidden):
        cloud = SimpleNamespace(number=number, timestamp_ns=number * 100_000_000, points=points, offset_s=np.zeros(50))
        tracker.add(cloud, [np.arange(50)] if number in seen else [])
    fragments = tracker.take()
    assert len(fragments) == tracks
    assert [number for fragment in fragments for number in fragment.numbers] == seen


def test_segments_of_a_long_drive_are_one_track(recording, proposals):
    """Sweeps are forgotten after a segment; what goes on is one proposal all the same."""
    pieces = propose(recording, settings=replace(COARSE, segment_s=0.75))
    assert len(pieces) == len(proposals)
    rider, whole = pieces[0], proposals[0]
    assert motion(rider).times_ns.tolist() == motion(whole).times_ns.tolist()
    np.testing.assert_allclose(motion(rider).centres_m, motion(whole).centres_m, atol=0.25)


RIDER = {"rider": ("cyclist", (8.0, 5.0, 0.85), 0.3, 4.0, (1.8, 0.6, 1.7))}
AT = drive.pose_at


@pytest.mark.parametrize(
    ("seconds_at", "moves", "rests"),
    [
        # The rider's 4 m/s: at rest for 0.5 s, then 6 m/s2; and as much of braking to a stop after 1 s.
        (lambda seconds: 0.75 * max(seconds - 0.5, 0.0) ** 2, slice(-5, None), slice(0, 4)),
        (lambda seconds: -0.75 * max(1.0 - seconds, 0.0) ** 2, slice(0, 5), slice(-4, None)),
    ],
    ids=["starts", "stops"],
)
def test_who_starts_or_stops_within_the_drive_rests_before_or_behind(proposed, seconds_at, moves, rests):
    ((rider,), _) = proposed(RIDER, pose_at=lambda name, seconds: AT(name, seconds_at(seconds)))
    assert len(speeds(rider)) == drive.SWEEPS
    assert (speeds(rider)[moves] > 1.5).all()
    assert (speeds(rider)[rests] == 0.0).all()


def test_people_side_by_side_are_two(proposed):
    walk = np.pi, 1.2, (0.4, 0.5, 1.8)
    walkers = {"a": ("pedestrian", (12.0, 2.0, 0.9), *walk), "b": ("pedestrian", (12.0, 2.75, 0.9), *walk)}
    proposals, frames = proposed(walkers)
    assert found(frames) == {"a", "b"}
    assert [proposal.object_class for proposal in proposals] == ["pedestrian", "pedestrian"]


def test_tilted_mounting_changes_nothing(recording, proposals):
    """Each sweep is levelled by its own road, since the bus's ego-motion knows no pitch."""
    tilt = RigidTransform(Rotation.from_euler("y", 0.015).as_matrix(), np.zeros(3))
    tilted = replace(recording, vehicle_from_lidar=recording.vehicle_from_lidar @ tilt)
    assert len(propose(tilted, settings=COARSE)) == len(proposals)


def test_proposals_need_sweeps(recording):
    with pytest.raises(DataError, match="expected lidar sweeps"):
        propose(replace(recording, sweeps=()))


@pytest.mark.parametrize("speed_mps", [9.0, 16.0])
def test_sweeps_that_overlap_show_an_object_twice(proposed, speed_mps):
    """Each revolution is stored with the next; the object is 0.9 m further by then, or 1.6 m, as long as it is."""
    once = drive.sweep

    def overlapping(index, path):
        first, again = once(index, path), once(index + 1, path)
        points = np.concatenate([first.points_lidar, again.points_lidar])
        times_ns = np.repeat([0, drive.SWEEP_NS], [len(first.points_lidar), len(again.points_lidar)])
        return LidarSweep(timestamp_ns=first.timestamp_ns, points_lidar=points, time_offset_ns=times_ns)

    fast = {"car": ("vehicle", (2.0, 5.0, 1.0), 0.0, speed_mps, (1.6, 1.0, 1.9))}
    proposals, frames = proposed(fast, sweep=overlapping)
    assert len(proposals) == 1
    assert "false" not in set(frames["outcome"])


def test_a_ghost_at_the_range_of_a_reflector_is_doubted(proposed):
    """Other beams that fire with the one that meets a bright plate tell its range; here 25 degrees to its left."""
    plain = drive.sweep

    def with_ghost(index, path):
        swept = plain(index, path)
        seconds, lidar_m = index * drive.SWEEP_NS / 1e9, np.array([1.2, 0.0])
        ego_m = 2.0 * seconds * np.array([1.0, 0.0])
        rear_m = drive.pose_at("van", seconds).translation_m[:2] - np.array([2.5, 0.0]) - ego_m - lidar_m
        range_m, azimuth = np.hypot(*rear_m), np.arctan2(rear_m[1], rear_m[0]) + np.radians(25.0) - 0.1
        across, up = np.meshgrid(azimuth + np.radians(np.arange(-3, 3.1, 1.0)), np.radians(np.arange(-9, 0.1, 1.5)))
        rays = np.stack([np.cos(up) * np.cos(across), np.cos(up) * np.sin(across), np.sin(up)], axis=-1).reshape(-1, 3)
        points = np.concatenate([swept.points_lidar, (rays * range_m).astype(np.float32)])
        return LidarSweep(timestamp_ns=swept.timestamp_ns, points_lidar=points)

    van = {"van": ("vehicle", (9.0, 4.0, 1.0), 0.0, 5.0, (5.0, 2.0, 2.0))}
    proposals, frames = proposed(van, sweep=with_ghost)
    vans = set(frames.loc[frames["outcome"] == "found", "proposal"])
    assert len(vans) == 1
    others = [proposal for proposal in proposals if proposal.id not in vans]
    assert all(proposal.doubts for proposal in others)
    assert any(("at the range of a larger one" in proposal.reasons) for proposal in others)


@pytest.mark.parametrize("apart_m", [0.65, 1.4])
def test_somebody_with_a_dog_is_one_pedestrian(proposed, apart_m):
    """The dog is too low for a proposal of its own; at heel it is a part of the person, as what else they carry."""
    pair = {
        "person": ("pedestrian", (10.0, 2.0, 0.9), np.pi, 1.2, (0.4, 0.5, 1.8)),
        "dog": ("animal", (10.0, 2.0 + apart_m, 0.25), np.pi, 1.2, (0.8, 0.25, 0.5)),
    }
    (person,), frames = proposed(pair)
    assert person.object_class == "pedestrian"
    assert set(frames.loc[frames["object"] == "person", "outcome"]) == {"found"}


@pytest.mark.parametrize(("length_m", "doubted"), [(12.0, False), (18.0, True)])
def test_a_bus_is_one_vehicle(proposed, length_m, doubted):
    """It crosses 11 m ahead, and so does one with a joint that goes straight on."""
    bus = {"bus": ("vehicle", (13.0, -5.0, 1.5), np.pi / 2, 5.0, (length_m, 2.5, 3.0))}
    ((vehicle,), _) = proposed(bus)
    assert vehicle.object_class == "vehicle"
    np.testing.assert_allclose(vehicle.size_m[0], length_m, atol=0.6)
    assert ("longer than a rigid vehicle" in vehicle.reasons) == doubted


def test_a_trailer_half_a_metre_behind_a_car_is_one_of_its_own(proposed):
    """On a straight way; nearer it is a part of the car, and in a tight bend neither may be found."""
    drives = np.pi / 2, 5.0, (4.5, 1.8, 1.6)
    pair = {"car": ("vehicle", (13.0, -2.0, 0.8), *drives), "trailer": ("vehicle", (13.0, -7.0, 0.8), *drives)}
    proposals, frames = proposed(pair)
    assert len(proposals) == 2
    assert found(frames) == {"car", "trailer"}


def test_a_lorry_beside_us_in_parts_that_change_and_with_stray_returns(proposed):
    """A part without returns cuts it in two in most sweeps, and returns between it and us, as of mirrors, widen it."""
    whole = drive.sweep

    def ragged(index, path):
        swept = whole(index, path)
        lorry = drive.pose_at("lorry", index * drive.SWEEP_NS / 1e9)
        world_from_lidar = path.world_from_vehicle(swept.timestamp_ns) @ VEHICLE_FROM_LIDAR
        points = lorry.inverse().apply(world_from_lidar.apply(swept.points_lidar.astype(np.float64)))
        kept = (np.abs(points[:, 0] - 2.0) > 0.8) | (np.abs(points[:, 1]) > 1.4) | (index % 3 == 0)
        stray = np.column_stack([np.zeros(10), np.linspace(1.25, 4.65, 10), np.full(10, -0.4)])
        back = world_from_lidar.inverse().apply(lorry.apply(np.concatenate([points[kept], stray])))
        return drive.as_at_once(swept.timestamp_ns, back.astype(np.float32))

    long = {"lorry": ("vehicle", (2.0, -6.2, 1.85), 0.0, 4.0, (10.0, 2.5, 3.5))}
    (lorry,), frames = proposed(long, sweep=ragged)
    assert frames["outcome"].value_counts().to_dict() == {"found": drive.SWEEPS}
    np.testing.assert_allclose(lorry.size_m[0], 10.0, atol=0.6)
    assert lorry.size_m[1] < 0.8  # its flank is all that the lidar sees
    assert frames["speed_error_mps"].median() < 0.2
