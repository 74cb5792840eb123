"""From patches to pixels, from pixels to one polygon, and both in the reference of a drive."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bench.geometry import RigidTransform
from bench.geometry.raster import rasterise
from bench.lidar import LidarSweep
from bench.recordings import SweepRef
from bench.reference import Status
from bench.reference.grid import find_grid
from bench.reference.patches import count_patches, without_slits
from bench.reference.regions import trace_polygon
from tests.reference.drives import LIDAR, reference_of, wall_recording, with_settings

SIZE = {"width": 64, "height": 48}
UNIT = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float64)


def squares(*corners, side=4.0):
    """Patches by their upper left corner."""
    return np.stack([np.array(corner) + side * UNIT for corner in corners], axis=1)


def pixels_of(patches):
    """The pixels of patches, (4, N, 2), and the window's first one."""
    counts, corner = count_patches(patches.T.swapaxes(1, 2), np.zeros(patches.shape[1], int), layers=1, **SIZE)
    return counts[0] != 0, corner


def patch_polygon(patches, *, solid=False):
    covered, corner = pixels_of(patches)
    return trace_polygon(without_slits(covered, solid=solid), corner - 1)


def image_of(polygon):
    image = np.zeros((SIZE["height"], SIZE["width"]), dtype=bool)
    window, covered = rasterise(polygon, **SIZE)
    image[window] = covered
    return image


def test_pixels_of_two_overlapping_patches_by_hand():
    covered, corner = pixels_of(squares((10.5, 20.5), (12.5, 20.5)))
    assert np.argwhere(covered).min(axis=0).tolist() == [21 - corner[1], 11 - corner[0]]
    assert covered.sum() == 4 * 6


def within(least: float, most: float):
    return st.floats(least, most).map(lambda px: round(px, 9))  # shapely's unions divide by what is nearly 0


patch = st.tuples(within(-8, 70), within(-8, 54), within(1, 12), within(1, 12), within(-3, 3), st.booleans())


@given(st.lists(patch, min_size=1, max_size=8))
def test_pixels_are_those_whose_centre_any_patch_covers_whichever_way_it_turns(boxes):
    patches = np.array(
        [
            (np.array([u, v]) + UNIT * [wide, tall] + UNIT[:, ::-1] * [slant, 0])[:: -1 if flipped else 1]
            for u, v, wide, tall, slant, flipped in boxes
        ]
    )
    covered, (left, top) = pixels_of(patches.swapaxes(0, 1))
    union = shapely.union_all(shapely.polygons(patches))
    u, v = np.meshgrid(np.arange(covered.shape[1]) + left, np.arange(covered.shape[0]) + top)
    assert covered[shapely.contains_xy(union.buffer(-1e-6), u, v)].all()
    assert not covered[~shapely.contains_xy(union.buffer(1e-6), u, v)].any()


def test_holes_stay_open_and_slits_of_a_pixel_are_closed():
    ring = squares(*[(u, v) for u in (10.5, 14.5, 18.5) for v in (10.5, 14.5, 18.5) if (u, v) != (14.5, 14.5)])
    polygon = patch_polygon(ring)
    assert len(polygon.interiors) == 1
    assert image_of(polygon).sum() == 144 - 16
    assert image_of(patch_polygon(ring, solid=True)).sum() == 144
    slit = patch_polygon(squares((10.5, 10.5), (15.5, 10.5)))
    assert image_of(slit).sum() == 9 * 4


def test_what_the_lidar_sees_in_two_parts_is_a_polygon_of_two_parts():
    polygon = patch_polygon(squares((10.5, 10.5), (30.5, 12.5)))
    assert polygon.geom_type == "MultiPolygon"
    assert polygon.is_valid
    image = image_of(polygon)
    assert image[11:15, 11:15].all()
    assert image[13:17, 31:35].all()
    assert image.sum() == 2 * 16


@given(arrays(bool, (7, 9)))
def test_the_polygon_gives_back_its_pixels(mask):
    cells = [(u + 20 - 0.5, v + 20 - 0.5) for v, u in np.argwhere(mask)]
    if not cells:
        return
    polygon = patch_polygon(squares(*cells, side=1.0))
    assert polygon.is_valid
    assert image_of(polygon)[20:27, 20:29][mask].all()


@pytest.mark.parametrize(
    "patches", [np.empty((4, 0, 2)), squares((10.2, 10.2), side=0.5), squares((500, 10)), squares((-90, 10))]
)
def test_patches_that_cover_no_pixel_give_no_polygon(patches):
    assert patch_polygon(patches) is None


def object_of(recording, kind):
    (found,) = reference_of(recording, with_settings(polygon_kind=kind)).objects
    return found


@pytest.mark.parametrize("away_m", [6.0, 8.0, 11.0])
def test_a_scanned_wall_is_covered_down_to_the_road_where_hulls_end_early(away_m):
    recording, truth = wall_recording(away_m=away_m)
    found = {}
    for kind in ("convex", "concave", "surface-patches"):
        wall = object_of(recording, kind)
        assert wall.status is Status.EVALUATED
        found[kind] = wall.polygon.intersection(truth).area / wall.polygon.union(truth).area
        if kind == "surface-patches":  # no pixels to count beyond the true outline's border
            assert wall.polygon.difference(truth.buffer(1.0)).area < 0.01 * truth.area
    assert found["surface-patches"] > max(found["convex"], found["concave"])
    assert found["surface-patches"] > 0.9


def test_what_lies_above_the_highest_beam_goes_on_to_the_top_of_the_annotated_shape():
    """A van of 2.6 m at 4 m from the lidar: beams rise by 2 degrees, so its upper half metre is never met."""
    recording, truth = wall_recording(away_m=6.0, width_m=2.0, height_m=2.6)
    shares = {
        kind: object_of(recording, kind).polygon.intersection(truth).area / truth.area
        for kind in ("concave", "surface-patches")
    }
    assert shares["concave"] < 0.8
    assert shares["surface-patches"] > 0.95


def test_points_without_rows_fall_back_to_the_concave_hull():
    recording, _ = wall_recording()
    rows = np.arange(12)
    zigzag = np.column_stack([np.full(12, 8.0), 0.4 + 0.08 * (rows % 2), 0.2 + 0.11 * rows])
    points = LIDAR.inverse().apply(zigzag)
    assert find_grid(points) is None
    sweep = LidarSweep(timestamp_ns=0, points_lidar=points)
    ref = SweepRef(timestamp_ns=0, path=Path("0.npz"), reader=lambda *_: sweep)
    sparse = replace(recording, sweeps=(ref,))
    polygons = [object_of(sparse, kind).polygon for kind in ("concave", "surface-patches")]
    assert polygons[0].area > 20
    assert polygons[1].equals(polygons[0])


def test_points_in_the_vehicles_axes_give_the_same_polygon_once_it_is_told_where_the_beams_start():
    """Seen from below the rear axle, rows of beams are no rows: stripes of the wall would stay open."""
    recording, truth = wall_recording(away_m=4.0, width_m=2.0)
    sweep = recording.sweeps[0].read()
    in_vehicle_axes = replace(sweep, points_lidar=LIDAR.apply(sweep.points_lidar))
    ref = replace(recording.sweeps[0], reader=lambda *_: in_vehicle_axes)
    merged = replace(recording, sweeps=(ref,), vehicle_from_lidar=RigidTransform.identity())
    stated = replace(merged, lidar_from_sensor=LIDAR)
    expected, found, unstated = (object_of(one, "surface-patches").polygon for one in (recording, stated, merged))
    assert found.symmetric_difference(expected).area < 0.005 * expected.area
    assert unstated.intersection(truth).area < found.intersection(truth).area
    hulls = [object_of(one, "convex") for one in (stated, merged)]
    assert hulls[0].polygon.equals(hulls[1].polygon)  # hulls do not ask where beams start
