"""The lowest and the highest beam of a sweep, of sensors whose beams start in one point and of others."""

import numpy as np
import pytest

from bench.lidar import LidarSweep
from bench.reference.grid import UP, Beam, Envelope, find_envelope, find_grid
from bench.reference.sweeps import pose_sweep
from tests.reference.drives import LIDAR, circle
from tests.support.real import REAL, needs_real

ONE_ORIGIN = [(0.0, degrees) for degrees in np.concatenate([np.arange(2, -8.5, -1 / 3), np.arange(-8.8, -25, -0.5)])]
TWO_BLOCKS = [(0.21 if degrees > -8.5 else 0.12, degrees) for _, degrees in ONE_ORIGIN]
SCANS = ["0000003000.bin", "0000003001.bin"]


def sweep_of(beams, *, road_m=-1.73, seed=0):
    """Returns of beams, (offset m, degrees), from walls at many distances and a road between them; (N, 3) m."""
    rng = np.random.default_rng(seed)
    azimuth = np.radians(np.arange(0, 360, 0.4))
    wall_m = np.repeat(np.exp(rng.uniform(*np.log([2.5, 50]), 180)), 5)
    found = []
    for offset_m, degrees in beams:
        slope = np.tan(np.radians(degrees))
        road_at_m = (road_m - offset_m) / slope if slope < 0 else np.inf
        flat_m = np.minimum(wall_m, road_at_m)
        found.append(np.column_stack([flat_m * np.cos(azimuth), flat_m * np.sin(azimuth), offset_m + slope * flat_m]))
    return np.concatenate(found)


def wall_of(beams, distance_m):
    """Returns of a wall of 1.6 m across at a distance, (N, 3) m."""
    y = distance_m * np.tan(np.radians(np.arange(-12, 12, 0.2)))
    y = y[np.abs(y) < 0.8]
    rows = [offset_m + np.tan(np.radians(degrees)) * np.hypot(distance_m, y) for offset_m, degrees in beams]
    return np.column_stack([np.full(len(y) * len(rows), distance_m), np.tile(y, len(rows)), np.concatenate(rows)])


@pytest.mark.parametrize("beams", [ONE_ORIGIN, TWO_BLOCKS], ids=["one origin", "two blocks"])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_lowest_and_highest_beam_are_found(beams, kind):
    envelope = find_envelope(sweep_of(beams).astype(kind))
    for found, (offset_m, degrees), farthest_m in zip(envelope, (beams[-1], beams[0]), (4, 50), strict=True):
        flat_m = np.linspace(2.5, farthest_m, 20)  # where they meet anything
        heights_m = offset_m + np.tan(np.radians(degrees)) * flat_m
        np.testing.assert_allclose(found.heights_m(flat_m), heights_m, rtol=0, atol=0.015)
        assert found.offset_m == pytest.approx(offset_m, abs=0.03)


def test_where_beams_start_in_one_point_returns_stay_as_they_are():
    points = sweep_of(ONE_ORIGIN)
    envelope = find_envelope(points)
    assert envelope.starts_apart_m == 0.0
    np.testing.assert_array_equal(envelope.starts_m(points), 0.0)


def test_returns_are_seen_from_where_their_beam_starts():
    points = sweep_of(TWO_BLOCKS)
    placed = pose_sweep(LidarSweep(timestamp_ns=0, points_lidar=points), circle(0.0, 0.0), LIDAR)
    seen, of_beam = placed.points_from_beams(np.arange(len(points))), len(points) // len(TWO_BLOCKS)
    for beam, (_, degrees) in ((seen[:of_beam], TWO_BLOCKS[0]), (seen[-of_beam:], TWO_BLOCKS[-1])):
        np.testing.assert_allclose(beam[:, 2], np.tan(np.radians(degrees)) * np.hypot(*beam[:, :2].T), atol=0.06)


def test_stray_returns_change_nothing():
    points = sweep_of(TWO_BLOCKS)
    stray = np.array([[9.0, 0.1 * k, 3.0 + k] for k in range(5)] + [[0.0, 0.0, 0.0], [0.01, 0.0, 0.4]])
    np.testing.assert_allclose(find_envelope(np.concatenate([points, stray])), find_envelope(points), atol=0.021)


def test_beams_start_in_proportion_between_the_lowest_and_the_highest():
    envelope = Envelope(lowest=Beam(0.1, -0.5), highest=Beam(0.2, 0.1))
    points = np.array([[10.0, 0.0, 1.2], [6.0, 8.0, -4.9], [0.0, 10.0, -1.85], [10.0, 0.0, 9.0], [10.0, 0.0, -9.0]])
    np.testing.assert_allclose(envelope.starts_m(points), [0.2, 0.1, 0.15, 0.2, 0.1])


@pytest.mark.parametrize("away_m", [1e-3, 1e30])
def test_returns_out_of_any_lidars_range_still_tell_their_slopes(away_m):
    points = np.array([[away_m, 0.0, 0.0], [away_m, 0.0, away_m / 2], [0.0, away_m, -away_m]])
    lowest, highest = find_envelope(points)
    assert lowest == pytest.approx((0.0, -1.0))
    assert highest == pytest.approx((0.0, 0.5))


def test_what_float32_cannot_hold_is_no_error():
    points = np.array([[3e38, 3e38, 1.0], [5.0, 0.0, 1.0]], dtype=np.float32)
    assert find_envelope(points).highest.heights_m(np.array([5.0])) == pytest.approx(1.0)


def test_between_two_blocks_of_lasers_no_return_is_missing():
    wall = wall_of(TWO_BLOCKS, 3.0)
    envelope = find_envelope(sweep_of(TWO_BLOCKS))
    wall[:, 2] -= envelope.starts_m(wall)
    of_upper = wall[:, 2] / np.hypot(*wall[:, :2].T) > np.tan(np.radians(-8.6))
    bridged = []
    for apart_m in (0.0, envelope.starts_apart_m):
        grid = find_grid(wall, starts_apart_m=apart_m)
        assert grid is not None
        above = grid.neighbours[UP]
        bridged.append(np.count_nonzero(~of_upper & (above >= 0) & of_upper[above]))
    assert bridged == [0, len(np.unique(wall[:, 1]))]


@needs_real
@pytest.mark.parametrize("name", SCANS)
def test_nothing_below_the_real_top_beam_is_out_of_reach_and_nothing_above_it_is_background(name):
    stored = np.fromfile(REAL / "kitti360/data_3d_raw/velodyne_points" / name, np.float32).reshape(-1, 4)[:, :3]
    # Laser by laser from the top, each once round: azimuth starts anew where the next one begins.
    turned = np.mod(np.arctan2(stored[:, 1], stored[:, 0]), 2 * np.pi)
    top = stored[: np.flatnonzero(np.diff(turned) < -np.pi)[0] + 1].astype(np.float64)
    flat_m = np.hypot(top[:, 0], top[:, 1])
    slope, offset_m = np.polyfit(flat_m, top[:, 2], 1)
    near_m = np.linspace(3, 30, 28)
    strip_m = find_envelope(stored).highest.heights_m(near_m) - (offset_m + slope * near_m)
    assert np.abs(strip_m).max() < 0.015
    steepest = (stored[:, 2] / np.hypot(stored[:, 0], stored[:, 1])).max()
    assert (steepest * 8 - (offset_m + slope * 8)) > 0.3  # what one origin for all beams makes of it
