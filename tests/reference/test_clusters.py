"""Points of moving objects, taken over a tenth of a second from a moving host, meet at the exposure."""

from dataclasses import replace

import numpy as np
import pytest

import bench.reference.sweeps
from bench.geometry import RigidTransform
from bench.lidar import LidarSweep
from bench.recordings import Cuboid, GroundPolygon, ObjectState, PointIndices, Track
from bench.reference.motion import ObjectAtExposure
from bench.reference.sweeps import object_cluster, pose_sweep
from tests.reference.drives import LIDAR, MS, Box, circle, sweep_of

CAR = {"size_m": (4.0, 1.8, 1.5), "place_m": (9.0, 2.0, 0.75)}
EXPOSURE_NS = 40 * MS


def cluster(box, trajectory, state, *, velocity=None, sweep=None, **clear):
    velocity_mps = box.velocity_mps if velocity is None else velocity
    annotated = ObjectAtExposure(
        track=Track(track_id="a", object_class="vehicle", states=(state,)),
        state=state,
        world_from_vehicle=trajectory.world_from_vehicle(state.timestamp_ns),
        velocity_world_mps=velocity_mps,
        smooth_world_mps=velocity_mps,
        moving=True,
    )
    placed = pose_sweep(sweep or sweep_of([box], trajectory, 0), trajectory, LIDAR)
    return object_cluster(placed, annotated, EXPOSURE_NS, lowest_m=0.003, **clear).points_world


@pytest.mark.parametrize("state_ns", [-30 * MS, 0, 25 * MS])
@pytest.mark.parametrize(
    ("ego_mps", "ego_radps", "velocity", "radps"),
    [
        (0.0, 0.0, (0, 0, 0), 0.0),
        (12.0, 0.0, (0, 0, 0), 0.0),
        (8.0, 0.6, (0, 0, 0), 0.0),
        (8.0, -0.5, (10, 3, 0), 0.0),
        (-3.0, 0.3, (4, -6, 0), 0.8),
    ],
)
def test_every_point_returns_to_its_place_on_the_object(ego_mps, ego_radps, velocity, radps, state_ns):
    trajectory = circle(ego_mps, ego_radps)
    box = Box(velocity_mps=velocity, yaw_rate_radps=radps, yaw_rad=0.2, **CAR)
    points = cluster(box, trajectory, box.state(state_ns, trajectory))
    on_box = box.world_from_box(EXPOSURE_NS).inverse().apply(points)
    assert len(points) == 400  # all of the object's, none of the road's
    assert np.abs(np.sort(on_box, axis=0) - np.sort(box.skin(400), axis=0)).max() < 2e-3


def test_a_sweep_without_point_times_is_taken_at_its_reference_time():
    trajectory, box = circle(5.0, 0.0), Box(velocity_mps=(0, 4, 0), **CAR)
    sweep = sweep_of([box], trajectory, 0, timed=False)
    points = cluster(box, trajectory, box.state(0, trajectory), sweep=sweep)
    on_box = box.world_from_box(EXPOSURE_NS).inverse().apply(points)
    assert len(points) == 400
    assert np.abs(on_box[:, 1]).max() < 0.9


def test_unknown_velocity_counts_as_stationary():
    trajectory, box = circle(5.0, 0.0), Box(velocity_mps=(0, 0, 0), **CAR)
    points = cluster(box, trajectory, box.state(0, trajectory), velocity=np.full(3, np.nan))
    assert len(points) == 400


def test_ground_polygon_with_height_span_selects_what_stands_on_it():
    trajectory, box = circle(5.0, 0.2), Box(velocity_mps=(3, 0, 0), **CAR)
    outline = np.array([[6.9, 1.0], [11.1, 1.0], [11.1, 3.0], [6.9, 3.0]])
    shape = GroundPolygon(outline_m=outline, bottom_m=0.3, top_m=1.6)
    state = ObjectState(timestamp_ns=0, shape=shape, velocity_mps=box.velocity_mps)
    points = cluster(box, trajectory, state)
    expected = box.skin(400)
    assert len(points) == (expected[:, 2] + 0.75 >= 0.3).sum()
    assert np.abs(box.world_from_box(EXPOSURE_NS).inverse().apply(points)[:, 0]).max() < 2.0


@pytest.mark.parametrize(
    "indices",
    [np.arange(100, 180), np.random.default_rng(1).permutation(400)[:80], np.empty(0, dtype=np.intp)],
    ids=["ordered", "unordered", "none"],
)
def test_point_indices_select_exactly_themselves_in_their_order(indices):
    trajectory, box = circle(5.0, 0.2), Box(velocity_mps=(3, 1, 0), **CAR)
    shape = PointIndices(indices=indices, sweep_timestamp_ns=0)
    points = cluster(box, trajectory, ObjectState(timestamp_ns=0, shape=shape, velocity_mps=box.velocity_mps))
    on_box = box.world_from_box(EXPOSURE_NS).inverse().apply(points)
    np.testing.assert_allclose(on_box, box.skin(400)[indices], atol=2e-3)


def ground_polygon(shape: Cuboid) -> GroundPolygon:
    corners = shape.vehicle_from_object.apply(
        shape.size_m * [[s / 2, t / 2, 0] for s, t in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    )
    return GroundPolygon(outline_m=corners[:, :2], bottom_m=corners[0, 2] - 0.6, top_m=corners[0, 2] + 0.7)


@pytest.mark.parametrize("shaped", [lambda shape: shape, ground_polygon])
@pytest.mark.parametrize("layout", [np.ascontiguousarray, np.asfortranarray])
@pytest.mark.parametrize("seed", range(8))
def test_no_point_on_the_object_is_missed_in_the_first_coarse_search(seed, layout, shaped, monkeypatch):
    """A sweep full of points at random, a host and an object that move at random: the search finds what asking every
    single point finds."""
    rng = np.random.default_rng(seed)
    trajectory = circle(float(rng.uniform(-10, 20)), float(rng.uniform(-1, 1)))
    box = Box(
        place_m=(*rng.uniform(-9, 9, 2), 0.75),
        size_m=rng.uniform(0.5, 5, 3),
        velocity_mps=(*rng.uniform(-15, 15, 2) * (seed % 2), 0),
        yaw_rate_radps=float(rng.uniform(-1, 1)),
        yaw_rad=float(rng.uniform(-3, 3)),
    )
    points = layout(np.concatenate([rng.uniform(-16, 16, (20_000, 2)), rng.uniform(-2, 2, (20_000, 1))], axis=1))
    sweep = LidarSweep(
        timestamp_ns=0,
        points_lidar=points.astype(np.float32, order="K"),
        time_offset_ns=rng.integers(-50 * MS, 50 * MS, 20_000),
    )
    state = box.state(int(rng.integers(-80, 80)) * MS, trajectory)
    state = replace(state, shape=shaped(state.shape))
    found = cluster(box, trajectory, state, sweep=sweep)
    monkeypatch.setattr(bench.reference.sweeps, "_candidates", lambda *_: np.arange(20_000))
    expected = cluster(box, trajectory, state, sweep=sweep)
    assert len(found) == len(expected) > 5
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_points_within_the_clearance_above_the_bottom_of_a_shape_are_the_grounds():
    trajectory, box = circle(5.0, 0.2), Box(velocity_mps=(0, 0, 0), **CAR)
    state = box.state(0, trajectory)
    height_m = box.skin(400)[:, 2] + 0.75
    for shape in (state.shape, ground_polygon(state.shape)):
        bottom_m = 0.75 - 0.6 if isinstance(shape, GroundPolygon) else 0.0
        top_m = 0.75 + 0.7 if isinstance(shape, GroundPolygon) else 1.5
        for clearance_m in (0.0, 0.3):
            found = cluster(box, trajectory, replace(state, shape=shape), clearance_m=clearance_m)
            assert len(found) == ((height_m >= bottom_m + clearance_m) & (height_m <= top_m)).sum() > 100


def test_a_box_of_absurd_size_takes_all_that_lies_above_the_road():
    trajectory, box = circle(5.0, 0.2), Box(velocity_mps=(0, 0, 0), **CAR)
    state = box.state(0, trajectory)
    vast = Cuboid(vehicle_from_object=state.shape.vehicle_from_object, size_m=np.full(3, 1e60))
    sweep = sweep_of([box], trajectory, 0)
    sweep = replace(sweep, points_lidar=sweep.points_lidar.astype(np.float32))
    assert len(cluster(box, trajectory, replace(state, shape=vast), sweep=sweep)) == 400


def test_azimuths_are_seen_from_the_sensor_wherever_the_frame_of_the_points_is():
    trajectory, lidar_from_sensor = circle(5.0, 0.3), RigidTransform.from_yaw(0.3, (1.0, -0.5, 0.2))
    sweep = sweep_of([Box(velocity_mps=(0, 4, 0), **CAR)], trajectory, 0)
    placed = pose_sweep(sweep, trajectory, LIDAR, lidar_from_sensor)
    flat_m = np.hypot(*placed.points_sensor()[:, :2].T)
    points_sensor = placed.points_sensor()
    points_sensor[:, 0], points_sensor[:, 1] = (
        np.cos(placed.azimuths_rad) * flat_m,
        np.sin(placed.azimuths_rad) * flat_m,
    )
    np.testing.assert_allclose(lidar_from_sensor.apply(points_sensor), sweep.points_lidar, atol=1e-4)
