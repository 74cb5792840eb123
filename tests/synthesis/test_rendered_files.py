"""Files of a recording agree with each other: lidar, annotations, truth and ego-motion."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.recordings import open_native, read_truth
from tests.synthesis.conftest import IDEAL, REAL

NOISE_M = 0.02


@pytest.fixture(scope="module", params=[IDEAL, REAL], ids=["ideal", "real"])
def recordings(request, rendered):
    """As recorded by an ideal car, and by a real one whose exact poses and calibration are read."""
    folder, source = rendered(request.param) / "out", "recorded" if request.param == IDEAL else "exact"
    roots = (folder / name for name in ("crossing", "reversing"))
    return [open_native(root, ego_motion=source, calibration=source) for root in roots]


def world_points(recording, sweep_index):
    sweep = recording.sweeps[sweep_index].read()
    rotations, positions_m, valid = recording.trajectory.at(sweep.times_ns)
    assert valid.all()
    points_vehicle = recording.vehicle_from_lidar.apply(sweep.points_lidar.astype(np.float64))
    return np.einsum("nij,nj->ni", rotations, points_vehicle) + positions_m, sweep.times_ns


def placed(recording, state):
    return recording.trajectory.world_from_vehicle(state.timestamp_ns) @ state.shape.vehicle_from_object


def to_cuboid(recording, state, points_world, times_ns):
    """Points in the cuboid's frame, taken back to the annotation's time by the object's own motion."""
    world_from_vehicle = recording.trajectory.world_from_vehicle(state.timestamp_ns)
    world_from_object = placed(recording, state)
    velocity_mps = world_from_vehicle.rotate(state.velocity_mps)
    seconds = (times_ns - state.timestamp_ns)[:, None] / 1e9
    moved = points_world - seconds * velocity_mps - world_from_object.translation_m
    turned = Rotation.from_rotvec(-seconds * [0.0, 0.0, state.yaw_rate_radps]).apply(moved)
    return np.asarray(turned @ world_from_object.rotation)


def test_lidar_points_of_actors_lie_on_their_cuboids(recordings):
    for recording in recordings:
        index = len(recording.sweeps) // 2
        points_world, times_ns = world_points(recording, index)
        for track in recording.tracks:
            state = next(s for s in track.states if s.timestamp_ns == recording.sweeps[index].timestamp_ns)
            local_m, half_m = to_cuboid(recording, state, points_world, times_ns), state.shape.size_m / 2
            above_kerb = local_m[:, 2] > -half_m[2] + 0.2
            near = above_kerb & (np.abs(local_m) < half_m + 0.3).all(axis=1)
            inside = (np.abs(local_m[near]) <= half_m + 5 * NOISE_M).all(axis=1)
            assert near.sum() > 30, track.track_id
            assert inside.all(), track.track_id


def test_annotated_velocity_is_the_change_of_the_place(recordings):
    for recording in recordings:
        for track in recording.tracks:
            first, second = track.states[0], track.states[1]
            before, after = (placed(recording, state).translation_m for state in (first, second))
            seconds = (second.timestamp_ns - first.timestamp_ns) / 1e9
            speed_mps = np.linalg.norm(after - before) / seconds
            assert speed_mps == pytest.approx(np.linalg.norm(first.velocity_mps), abs=0.02)


def test_sweeps_surround_the_images_and_are_annotated(recordings):
    for recording in recordings:
        images = [image.timestamp_ns for image in recording.images["front"]]
        sweeps = [sweep.timestamp_ns for sweep in recording.sweeps]
        assert sweeps[0] < images[0]
        assert sweeps[-1] > images[-1]
        assert np.diff(images).tolist() == [recording.frame_interval_ns]
        for track in recording.tracks:
            assert [state.timestamp_ns for state in track.states] == sweeps


def test_truth_holds_the_tracks(recordings):
    for recording in recordings:
        ids = {track.instance_id for track in recording.tracks}
        assert ids == set(range(1, len(recording.tracks) + 1))
        seen: set[int] = set()
        for image in recording.images["front"]:
            seen |= set(np.unique(read_truth(image)).tolist())
        assert seen == ids | {0}
