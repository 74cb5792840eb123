"""Points of moving objects meet at the exposure; the lowest and the highest beam of a sweep."""

from dataclasses import replace

import numpy as np
import pytest

import bench.reference.sweeps
from bench.geometry import RigidTransform
from bench.lidar.sweep import LidarSweep
from bench.recordings import Cuboid, GroundPolygon, ObjectState, PointIndices, Track
from bench.reference.grid import UP, Beam, Envelope, find_envelope, find_grid
from bench.reference.motion import ObjectAtExposure
from bench.reference.sweeps import object_cluster, pose_sweep
from tests.reference.drives import LIDAR, MS, Box, circle, sweep_of
from tests.support.real import REAL, needs_real

HOST = circle(5.0, 0.2)
EXPOSURE_NS = 40 * MS


def car(velocity_mps=(0, 0, 0), **more):
    return Box(size_m=(4.0, 1.8, 1.5), place_m=(9.0, 2.0, 0.75), velocity_mps=velocity_mps, **more)


def cluster(box, state, *, trajectory=HOST, velocity=None, sweep=None, **clear):
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


def on_box(box, points):
    return box.world_from_box(EXPOSURE_NS).inverse().apply(points)


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
    trajectory, box = circle(ego_mps, ego_radps), car(velocity, yaw_rate_radps=radps, yaw_rad=0.2)
    points = cluster(box, box.state(state_ns, trajectory), trajectory=trajectory)
    assert len(points) == 400  # all of the object's, none of the road's
    assert np.abs(np.sort(on_box(box, points), axis=0) - np.sort(box.skin(400), axis=0)).max() < 2e-3


def test_without_point_times_the_sweeps_time_and_without_a_velocity_rest_is_taken():
    box = car((0, 4, 0))
    points = cluster(box, box.state(0, HOST), sweep=sweep_of([box], HOST, 20 * MS, timed=False))
    assert len(points) == 400
    assert np.abs(on_box(box, points)[:, 1]).max() < 0.9
    assert len(cluster(car(), car().state(0, HOST), velocity=np.full(3, np.nan))) == 400


@pytest.mark.parametrize(
    "indices",
    [np.arange(100, 180), np.random.default_rng(1).permutation(400)[:80], np.empty(0, dtype=np.intp)],
    ids=["ordered", "unordered", "none"],
)
def test_point_indices_select_exactly_themselves_in_their_order(indices):
    box, shape = car((3, 1, 0)), PointIndices(indices=indices, sweep_timestamp_ns=0)
    points = cluster(box, ObjectState(timestamp_ns=0, shape=shape, velocity_mps=box.velocity_mps))
    np.testing.assert_allclose(on_box(box, points), box.skin(400)[indices], atol=2e-3)


def ground_polygon(shape: Cuboid) -> GroundPolygon:
    """From 0.6 m below the middle of the cuboid to 0.7 m above."""
    corners = shape.vehicle_from_object.apply(
        shape.size_m * [[s / 2, t / 2, 0] for s, t in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    )
    return GroundPolygon(outline_m=corners[:, :2], bottom_m=corners[0, 2] - 0.6, top_m=corners[0, 2] + 0.7)


@pytest.mark.parametrize("shaped", [lambda shape: shape, ground_polygon])
@pytest.mark.parametrize("layout", [np.ascontiguousarray, np.asfortranarray])
@pytest.mark.parametrize("seed", range(8))
def test_no_point_on_the_object_is_missed_in_the_first_coarse_search(seed, layout, shaped, monkeypatch):
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
    coarse = cluster(box, state, trajectory=trajectory, sweep=sweep)
    monkeypatch.setattr(bench.reference.sweeps, "_candidates", lambda *_: np.arange(20_000))
    expected = cluster(box, state, trajectory=trajectory, sweep=sweep)
    assert len(coarse) == len(expected) > 5
    np.testing.assert_allclose(coarse, expected, atol=1e-9)


@pytest.mark.parametrize("clearance_m", [0.0, 0.3])
@pytest.mark.parametrize(("shaped", "low_m", "high_m"), [(lambda shape: shape, 0.0, 1.5), (ground_polygon, 0.15, 1.45)])
def test_points_within_the_clearance_above_the_bottom_of_a_shape_are_the_grounds(shaped, low_m, high_m, clearance_m):
    box, height_m = car(), car().skin(400)[:, 2] + 0.75
    state = replace(box.state(0, HOST), shape=shaped(box.state(0, HOST).shape))
    expected = (height_m >= low_m + clearance_m) & (height_m <= high_m)
    assert len(cluster(box, state, clearance_m=clearance_m)) == expected.sum() > 100


def test_an_outline_that_crosses_itself_holds_the_returns_of_both_its_parts():
    box, state = car(), car().state(0, HOST)
    ground = ground_polygon(state.shape)
    crossed = replace(state, shape=replace(ground, outline_m=ground.outline_m[[0, 1, 3, 2]]))
    for margin_m in (0.02, 0.05):
        _, y, _ = on_box(box, cluster(box, crossed, margin_m=margin_m)).T
        assert min((y > 0.5).sum(), (y < -0.5).sum()) > 50


def test_azimuths_are_seen_from_the_sensor_wherever_the_frame_of_the_points_is():
    lidar_from_sensor, sweep = RigidTransform.from_yaw(0.3, (1.0, -0.5, 0.2)), sweep_of([car((0, 4, 0))], HOST, 0)
    placed = pose_sweep(sweep, HOST, LIDAR, lidar_from_sensor)
    azimuths_rad, (x, y, z) = placed.azimuths_rad, placed.points_sensor().T
    by_azimuth = np.hypot(x, y) * np.stack([np.cos(azimuths_rad), np.sin(azimuths_rad)])
    points_sensor = np.column_stack([*by_azimuth, z])
    np.testing.assert_allclose(lidar_from_sensor.apply(points_sensor), sweep.points_lidar, atol=1e-4)


ONE_ORIGIN = [(0.0, degrees) for degrees in np.concatenate([np.arange(2, -8.5, -1 / 3), np.arange(-8.8, -25, -0.5)])]
TWO_BLOCKS = [(0.21 if degrees > -8.5 else 0.12, degrees) for _, degrees in ONE_ORIGIN]


def returns_of(beams, *, road_m=-1.73):
    """Returns of beams, (offset m, degrees), from walls at many distances and a road between them; (N, 3) m."""
    azimuth = np.radians(np.arange(0, 360, 0.4))
    wall_m = np.repeat(np.exp(np.random.default_rng(0).uniform(*np.log([2.5, 50]), 180)), 5)
    rows = []
    for offset_m, degrees in beams:
        slope = np.tan(np.radians(degrees))
        flat_m = np.minimum(wall_m, (road_m - offset_m) / slope if slope < 0 else np.inf)
        rows.append(np.column_stack([flat_m * np.cos(azimuth), flat_m * np.sin(azimuth), offset_m + slope * flat_m]))
    return np.concatenate(rows)


@pytest.mark.parametrize("beams", [ONE_ORIGIN, TWO_BLOCKS], ids=["one origin", "two blocks"])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_lowest_and_highest_beam_are_found(beams, kind):
    points = returns_of(beams).astype(kind)
    envelope = find_envelope(points)
    for beam, (offset_m, degrees), farthest_m in zip(envelope, (beams[-1], beams[0]), (4, 50), strict=True):
        flat_m = np.linspace(2.5, farthest_m, 20)  # where they meet anything
        heights_m = offset_m + np.tan(np.radians(degrees)) * flat_m
        np.testing.assert_allclose(beam.heights_m(flat_m), heights_m, rtol=0, atol=0.015)
        assert beam.offset_m == pytest.approx(offset_m, abs=0.03)
    if beams is ONE_ORIGIN:
        assert envelope.starts_apart_m == 0.0
        np.testing.assert_array_equal(envelope.starts_m(points), 0.0)


def test_returns_are_seen_from_where_their_beam_starts():
    points = returns_of(TWO_BLOCKS)
    placed = pose_sweep(LidarSweep(timestamp_ns=0, points_lidar=points), circle(0.0, 0.0), LIDAR)
    seen, of_beam = placed.points_from_beams(np.arange(len(points))), len(points) // len(TWO_BLOCKS)
    for beam, (_, degrees) in ((seen[:of_beam], TWO_BLOCKS[0]), (seen[-of_beam:], TWO_BLOCKS[-1])):
        np.testing.assert_allclose(beam[:, 2], np.tan(np.radians(degrees)) * np.hypot(*beam[:, :2].T), atol=0.06)
    envelope = Envelope(lowest=Beam(0.1, -0.5), highest=Beam(0.2, 0.1))
    points = np.array([[10.0, 0.0, 1.2], [6.0, 8.0, -4.9], [0.0, 10.0, -1.85], [10.0, 0.0, 9.0], [10.0, 0.0, -9.0]])
    np.testing.assert_allclose(envelope.starts_m(points), [0.2, 0.1, 0.15, 0.2, 0.1])  # in proportion


def test_stray_returns_change_nothing():
    points = returns_of(TWO_BLOCKS)
    stray = np.array([[9.0, 0.1 * k, 3.0 + k] for k in range(5)] + [[0.0, 0.0, 0.0], [0.01, 0.0, 0.4]])
    np.testing.assert_allclose(find_envelope(np.concatenate([points, stray])), find_envelope(points), atol=0.021)


@pytest.mark.parametrize("away_m", [1e-3, 1e8])
def test_returns_out_of_any_lidars_range_still_tell_their_slopes(away_m):
    points = np.array([[away_m, 0.0, 0.0], [away_m, 0.0, away_m / 2], [0.0, away_m, -away_m]])
    lowest, highest = find_envelope(points)
    assert lowest == pytest.approx((0.0, -1.0))
    assert highest == pytest.approx((0.0, 0.5))


def test_between_two_blocks_of_lasers_no_return_is_missing():
    """A wall of 1.6 m across, 3 m away."""
    y = 3.0 * np.tan(np.radians(np.arange(-12, 12, 0.2)))
    y = y[np.abs(y) < 0.8]
    rows = [offset_m + np.tan(np.radians(degrees)) * np.hypot(3.0, y) for offset_m, degrees in TWO_BLOCKS]
    wall = np.column_stack([np.full(len(y) * len(rows), 3.0), np.tile(y, len(rows)), np.concatenate(rows)])
    envelope = find_envelope(returns_of(TWO_BLOCKS))
    wall[:, 2] -= envelope.starts_m(wall)
    of_upper = wall[:, 2] / np.hypot(*wall[:, :2].T) > np.tan(np.radians(-8.6))
    bridged = []
    for apart_m in (0.0, envelope.starts_apart_m):
        above = find_grid(wall, starts_apart_m=apart_m).neighbours[UP]
        bridged.append(np.count_nonzero(~of_upper & (above >= 0) & of_upper[above]))
    assert bridged == [0, len(y)]
    behind = np.array([20.0, 0.0, 20.0 * np.tan(np.radians(-8.6))])  # a beam that went through, in the middle column
    (middle,) = find_grid(wall, starts_apart_m=envelope.starts_apart_m, others_sensor=behind[None]).neighbours[UP][
        ~of_upper & (above >= 0) & of_upper[above] & (np.abs(wall[:, 1]) < 1e-9)
    ]
    assert middle == -1


@needs_real
@pytest.mark.parametrize("name", ["0000003000.bin", "0000003001.bin"])
def test_nothing_below_the_real_top_beam_is_out_of_reach_and_nothing_above_it_is_background(name):
    stored = np.fromfile(REAL / "kitti360/data_3d_raw/velodyne_points" / name, np.float32).reshape(-1, 4)[:, :3]
    # Laser by laser from the top, each once round: azimuth starts anew where the next one begins.
    turned = np.mod(np.arctan2(stored[:, 1], stored[:, 0]), 2 * np.pi)
    top = stored[: np.flatnonzero(np.diff(turned) < -np.pi)[0] + 1].astype(np.float64)
    slope, offset_m = np.polyfit(np.hypot(top[:, 0], top[:, 1]), top[:, 2], 1)
    near_m = np.linspace(3, 30, 28)
    strip_m = find_envelope(stored).highest.heights_m(near_m) - (offset_m + slope * near_m)
    assert np.abs(strip_m).max() < 0.015
    steepest = (stored[:, 2] / np.hypot(stored[:, 0], stored[:, 1])).max()
    assert (steepest * 8 - (offset_m + slope * 8)) > 0.3  # what one origin for all beams makes of it
