"""Points are projected at the time of the row that sees them."""

from dataclasses import replace

import numpy as np
import pytest

from bench.cameras.model import RollingShutter
from bench.geometry import RigidTransform
from bench.reference.exposure import Exposure, visible_region
from tests.reference.drives import LENS, MOUNT, MS, Box, camera, circle, drive, reference_of, with_settings
from tests.support.rolling import seen_by_rows

DRIVE = circle(14.0, np.deg2rad(30))
EXPOSURE_NS = 430 * MS
SPREAD = np.stack(np.meshgrid([2.0, 5.0, 15.0], [-4.0, -1.0, 3.0], [0.1, 1.5, 3.0]), axis=-1).reshape(-1, 3)


def exposure(shutter):
    mounted, recording = replace(camera(), rolling_shutter=shutter), drive([], DRIVE)
    return Exposure.at(EXPOSURE_NS, recording=recording, camera=mounted, valid=visible_region(mounted))


@pytest.mark.parametrize("velocity_mps", [(0.0, 0.0, 0.0), (-9.0, 6.0, 0.0)], ids=["static", "moving"])
@pytest.mark.parametrize("direction", ["down", "up", "right", "left"])
def test_points_are_where_bisection_finds_them(direction, velocity_mps):
    shutter, velocity = RollingShutter(readout_s=0.025, direction=direction), np.array(velocity_mps)
    points = (DRIVE.world_from_vehicle(EXPOSURE_NS) @ RigidTransform.from_yaw(0.0, (3.7, 0.0, 0.0))).apply(SPREAD)
    expected = seen_by_rows(
        lambda time_s: points + velocity * (time_s - EXPOSURE_NS / 1e9),
        lambda time_s: DRIVE.world_from_vehicle(round(time_s * 1e9)) @ MOUNT,
        camera=LENS,
        shutter=shutter,
        image_s=EXPOSURE_NS / 1e9,
    )
    seen = np.isfinite(expected).all(axis=1)
    assert seen.sum() > 10
    by_rows, at_once = (exposure(kind).of_object(velocity).project(points)[seen] for kind in (shutter, None))
    assert np.abs(by_rows - expected[seen]).max() < 0.01
    assert np.abs(at_once - expected[seen]).max() > 3


@pytest.mark.parametrize("min_points", [10, 1000], ids=["returns", "annotated outline"])
def test_regions_follow_the_rows(min_points):
    """The columns on the left are exposed when a van that passes at 28 m/s is 0.2 m nearer."""
    recording = drive([Box([8.5, 3.0, 1.0], [4.0, 1.8, 1.8], [-14.0, 0.0, 0.0])], circle(14.0, 0.0))

    def left_side(shutter):
        cameras = {"front": replace(camera(), rolling_shutter=shutter)}
        settings = with_settings(min_points=min_points, min_polygon_px=1, range_limit_m=30)
        frame = reference_of(replace(recording, cameras=cameras), settings)
        return np.nonzero(frame.labels if min_points == 10 else frame.ignored)[1].min()

    at_once = left_side(None)
    assert left_side(RollingShutter(readout_s=0.025, direction="left")) < at_once - 3
    assert left_side(RollingShutter(readout_s=0.025, direction="right")) > at_once + 3
    assert left_side(RollingShutter(readout_s=1e-9)) == at_once
