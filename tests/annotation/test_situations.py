"""What traffic and lidars do beside the plain case, each with a known answer."""

import numpy as np
import pytest

from bench.annotation import evaluate_proposals, propose
from bench.lidar import LidarSweep
from tests.annotation.street import COARSE, annotated, street
from tests.support.tiny import VEHICLE_FROM_LIDAR
from tests.validation import drive


@pytest.fixture
def proposed(tmp_path, monkeypatch):
    """Proposals for a slow straight drive among some objects, and what they are compared with the annotations."""

    def run(objects, *, pose_at=None, sweep=None):
        monkeypatch.setattr(drive, "OBJECTS", objects)
        monkeypatch.setattr(drive, "SPEED_MPS", 2.0)
        monkeypatch.setattr(drive, "TURN_RADPS", 0.0)
        if pose_at is not None:
            monkeypatch.setattr(drive, "pose_at", pose_at)
        if sweep is not None:
            monkeypatch.setattr(drive, "sweep", sweep)
        recording = street(tmp_path / "street")
        proposals = propose(recording, settings=COARSE)
        return proposals, evaluate_proposals(recording, annotated(proposals, recording))

    return run


VAN = {"van": ("vehicle", (9.0, 4.0, 1.0), 0.0, 5.0, (5.0, 2.0, 2.0))}


def test_who_stops_stays_and_rests(proposed):
    """6 m/s2 of braking to a stop after 1 s, then 0.5 s at rest."""
    constant = drive.pose_at
    rider = {"rider": ("cyclist", (8.0, 5.0, 0.85), 0.3, 4.0, (1.8, 0.6, 1.7))}
    (found,), frames = proposed(
        rider, pose_at=lambda name, seconds: constant(name, -0.75 * max(1.0 - seconds, 0.0) ** 2)
    )
    speeds_mps = np.hypot(*found.velocity_mps.T)
    assert len(speeds_mps) == drive.SWEEPS
    assert (speeds_mps[:5] > 1.5).all()
    assert (speeds_mps[-4:] == 0.0).all()
    assert "false" not in set(frames["outcome"])


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

    proposals, frames = proposed(VAN, sweep=with_ghost)
    vans = set(frames.loc[frames["outcome"] == "found", "proposal"])
    assert len(vans) == 1
    others = [dict(proposal.doubts) for proposal in proposals if proposal.track_id not in vans]
    assert all(others)
    assert any("at the range of a larger one" in doubts for doubts in others)


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
    assert "false" not in set(frames["outcome"])


@pytest.mark.parametrize(("length_m", "doubts"), [(12.0, set()), (18.0, {"longer than a rigid vehicle"})])
def test_a_bus_is_one_vehicle(proposed, length_m, doubts):
    """It crosses 11 m ahead, and so does one with a joint that goes straight on."""
    bus = {"bus": ("vehicle", (13.0, -5.0, 1.5), np.pi / 2, 5.0, (length_m, 2.5, 3.0))}
    (found,), frames = proposed(bus)
    assert found.object_class == "vehicle"
    np.testing.assert_allclose(found.size_m[0], length_m, atol=0.6)
    assert {reason for reason, _ in found.doubts} & {"longer than a rigid vehicle"} == doubts
    assert "false" not in set(frames["outcome"])


def test_a_trailer_half_a_metre_behind_a_car_is_one_of_its_own(proposed):
    """On a straight way; nearer it is a part of the car, and in a tight bend neither may be found."""
    pair = {
        "car": ("vehicle", (13.0, -2.0, 0.8), np.pi / 2, 5.0, (4.5, 1.8, 1.6)),
        "trailer": ("vehicle", (13.0, -7.0, 0.8), np.pi / 2, 5.0, (4.5, 1.8, 1.6)),
    }
    proposals, frames = proposed(pair)
    assert len(proposals) == 2
    assert set(frames.loc[frames["outcome"] == "found", "object"]) == {"car", "trailer"}
    assert "false" not in set(frames["outcome"])


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
    (found,), frames = proposed(long, sweep=ragged)
    assert frames["outcome"].value_counts().to_dict() == {"found": drive.SWEEPS}
    np.testing.assert_allclose(found.size_m[0], 10.0, atol=0.6)
    assert found.size_m[1] < 0.8  # its flank is all that the lidar sees
    assert frames["speed_error_mps"].median() < 0.2
