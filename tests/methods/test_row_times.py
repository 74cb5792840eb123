"""Two views of a static world by a rolling shutter: what bisection sees agrees with the geometry of its rows."""

import numpy as np
import pytest

from bench.cameras.model import RollingShutter
from bench.egomotion.trajectory import camera_motion
from bench.geometry import RoadPlane
from bench.methods.rigid_scene.scene import RigidScene
from bench.methods.spherical.likelihood import PAPER_ANGLE_RAD, SphericalSettings
from bench.methods.two_views import RowTimes
from tests.reference.drives import LENS, MOUNT, circle
from tests.support.rolling import seen_by_rows

SECONDS = 1 / 15
DRIVE = circle(10.0, np.deg2rad(30))
NOW_S = 0.4
SHUTTER = RollingShutter(readout_s=0.04)
ROWS = RowTimes(shutter=SHUTTER, seconds=SECONDS)


def camera_at(time_s):
    return DRIVE.world_from_vehicle(round(time_s * 1e9)) @ MOUNT


@pytest.fixture(scope="module")
def views():
    """Points and the pixels that show them now and one image before."""
    ahead = np.stack(np.meshgrid([4.5, 6.0, 9.0], [-3.0, -1.5, 1.0, 2.5], [0.0, 0.8, 2.0]), axis=-1).reshape(-1, 3)
    points = DRIVE.world_from_vehicle(round(NOW_S * 1e9)).apply(ahead)
    now, before = (
        seen_by_rows(lambda _: points, camera_at, camera=LENS, shutter=SHUTTER, image_s=image_s)
        for image_s in (NOW_S, NOW_S - SECONDS)
    )
    seen = np.isfinite(now).all(axis=1) & np.isfinite(before).all(axis=1)
    assert seen.sum() > 20
    return points[seen], now[seen], before[seen], ahead[seen, 2] == 0


def scene(row_times):
    motion = camera_motion(
        world_from_vehicle_previous=DRIVE.world_from_vehicle(round((NOW_S - SECONDS) * 1e9)),
        world_from_vehicle_current=DRIVE.world_from_vehicle(round(NOW_S * 1e9)),
        vehicle_from_camera=MOUNT,
    )
    return RigidScene(camera=LENS, current_from_previous=motion, road=RoadPlane.below(MOUNT), row_times=row_times)


def deviations(views, row_times):
    _, now, before, _ = views
    used = scene(row_times)
    extra = None if row_times is None else row_times.extra_motion(now, before, LENS)
    found = SphericalSettings().likelihood_of_rays(
        LENS.unproject(before)[0],
        LENS.unproject(now)[0],
        seen=np.ones(len(now), dtype=bool),
        current_from_previous=used.current_from_previous,
        road=used.road,
        extra_motion=extra,
    )
    return found.deviations


def test_what_is_static_deviates_nowhere_but_for_who_is_told_of_no_rolling_shutter(views):
    on_road = views[3]
    told, untold = (deviations(views, rows) for rows in (ROWS, None))
    assert np.maximum(told["epipolar"], told["positive_depth"]).max() < 1e-6
    assert np.maximum(told["positive_height"], told["anti_parallel"])[on_road].max() < 1e-6
    assert untold["epipolar"].max() > PAPER_ANGLE_RAD / 2
    assert np.maximum(untold["positive_height"], untold["anti_parallel"])[on_road].max() > 5 * PAPER_ANGLE_RAD


def test_a_rigid_scene_predicts_the_row_of_the_previous_image(views):
    points, now, before, _ = views
    rays = LENS.unproject(now)[0]
    distances_m = [
        np.linalg.norm(point - camera_at(NOW_S + offset_s).translation_m)
        for point, offset_s in zip(points, SHUTTER.row_time_offset_s(now, LENS), strict=True)
    ]
    inverse_depth = 1 / np.array(distances_m)
    told, untold = (np.abs(scene(rows).previous_pixels(rays, inverse_depth) - before).max() for rows in (ROWS, None))
    assert told < 0.05
    assert untold > 1
