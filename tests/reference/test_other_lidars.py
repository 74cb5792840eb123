"""Drawn sweeps of lidars that do not spin, return twice, or are two: what the reference makes of each."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.lidar import LidarSweep
from bench.recordings import Recording, SweepRef
from tests.reference.drives import LIDAR, pixels_of, wall_recording
from tests.reference.test_scanned import SURFACE, built

AWAY_M, WIDTH_M, HEIGHT_M = 6.0, 2.0, 1.7
COLUMNS, ROWS = np.meshgrid(np.tan(np.radians(np.arange(-40, 40, 0.2))), np.tan(np.radians(np.arange(-24, 2, 0.3))))
ODD = np.arange(COLUMNS.shape[1]) % 2
# Rows in the plane square to the lidar's view, as mirrors and chips scan it: none is a cone about an axis.
ROWS_OF = {
    "straight": ROWS,
    "falling to one side": ROWS + 0.3 * COLUMNS,
    "bows": ROWS - 0.3 * COLUMNS**2,
    "staggered": ROWS + ODD * np.tan(np.radians(0.15)),
}


def cast(rays, start):
    """Where rays from a place meet the wall, else the road; vehicle frame in, lidar frame out."""
    with np.errstate(divide="ignore", invalid="ignore"):
        wall = start + rays * np.where(rays[:, 0] > 0, (AWAY_M - start[0]) / rays[:, 0], np.nan)[:, None]
        road = start + rays * np.where(rays[:, 2] < -0.02, -start[2] / rays[:, 2], np.nan)[:, None]
    on_wall = (np.abs(wall[:, 1] - 0.4) <= WIDTH_M / 2) & (wall[:, 2] >= 0) & (wall[:, 2] <= HEIGHT_M)
    points = np.where(on_wall[:, None], wall, road)
    return LIDAR.inverse().apply(points[np.isfinite(points).all(axis=1)])


def spinning(start):
    azimuth, elevation = np.radians(np.mgrid[-60:60:0.2, -24.8:2:0.42].reshape(2, -1))
    flat = np.cos(elevation)
    return cast(np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)]), start)


def shares_of(points, object_class: str) -> tuple[float, float, float]:
    """Of the wall's mask: in the core; of the core outside, and of the mask in neither core nor band."""
    recording, truth = wall_recording(width_m=WIDTH_M, height_m=HEIGHT_M, away_m=AWAY_M)
    frame, mask = built(annotated(recording, points, object_class), SURFACE), pixels_of(truth)
    core = frame.labels == 1
    parts = core & mask, core & ~mask, mask & ~core & ~frame.ignored
    inside, outside, left_out = (float(part.sum() / mask.sum()) for part in parts)
    return inside, outside, left_out


def annotated(recording: Recording, points, object_class: str) -> Recording:
    sweep = LidarSweep(timestamp_ns=0, points_lidar=points)
    return replace(
        recording,
        sweeps=(SweepRef(timestamp_ns=0, path=Path("0.npz"), reader=lambda *_: sweep),),
        tracks=(replace(recording.tracks[0], object_class=object_class),),
    )


@pytest.mark.parametrize("object_class", ["vehicle", "pedestrian"])
@pytest.mark.parametrize("rows", list(ROWS_OF))
def test_rows_that_are_no_cones_are_found_as_rows(rows: str, object_class: str):
    rays = np.column_stack([np.ones(COLUMNS.size), COLUMNS.ravel(), ROWS_OF[rows].ravel()])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    inside, outside, left_out = shares_of(cast(rays, LIDAR.translation_m), object_class)
    assert inside > 0.94
    assert outside == 0.0
    assert left_out < 0.01


@pytest.mark.parametrize("behind_m", [0.0, 0.004, 3.0])
def test_second_returns_change_nothing(behind_m: float):
    """Of the same surface, of it a little later, or of what is behind its edge."""
    once = spinning(LIDAR.translation_m)
    later = once * (1 + behind_m / np.linalg.norm(once, axis=1))[:, None]
    assert shares_of(np.concatenate([once, later]), "pedestrian") == pytest.approx(
        shares_of(once, "pedestrian"), abs=0.001
    )


@pytest.mark.parametrize("apart_m", [(0.0, 0.0, 0.3), (0.0, 0.8, 0.0), (1.5, -0.6, -1.0)])
def test_sweeps_of_two_lidars_in_one_are_certain_of_less_but_not_wrong(apart_m: tuple[float, float, float]):
    """Seen from one place their rows cross: links between returns are doubtful, which only solid bodies do without."""
    two = np.concatenate([spinning(LIDAR.translation_m), spinning(LIDAR.translation_m + np.array(apart_m))])
    shares = {name: shares_of(two, name) for name in ("vehicle", "pedestrian")}
    assert shares["vehicle"][0] > 0.94
    assert 0.5 < shares["pedestrian"][0] < shares["vehicle"][0]
    for _, outside, left_out in shares.values():
        assert outside == 0.0
        assert left_out < 0.02
