"""Regions of an object: hulls, polygons of patches, what holds for every kind, and who gets a pixel of several."""

from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bench.geometry import RigidTransform
from bench.lidar.sweep import LidarSweep
from bench.recordings import PointIndices
from bench.records.reference import IgnoreReason, RegionKindName, Status
from bench.reference.grid import find_grid
from bench.reference.patches import covered_pixels, without_slits
from bench.reference.regions import REGION_KINDS, compose, hull_polygon, trace_polygon
from tests.reference.drives import (
    ERRORS,
    LEGS,
    LIDAR,
    a_region,
    an_object,
    pixels_of,
    reference_of,
    wall_recording,
    with_settings,
    with_state,
    with_sweep,
)

ROOT = Path(__file__).parents[2]
SIZE = {"width": 64, "height": 48}
U, V = np.meshgrid(np.arange(SIZE["width"]), np.arange(SIZE["height"]))
UNIT = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float64)
every_kind = pytest.mark.parametrize("kind", sorted(REGION_KINDS))


def hull(points, ratio=None):
    return hull_polygon(np.array(points, dtype=float), ratio=ratio, **SIZE)


def image_of(polygon):
    return pixels_of(polygon, **SIZE)


def squares(*corners, side=4.0):
    """Patches by their upper left corner."""
    return np.stack([np.array(corner) + side * UNIT for corner in corners], axis=1)


def pixels_of_patches(patches):
    """The pixels of patches, (4, N, 2), and the window's first one."""
    return covered_pixels(patches.T.swapaxes(1, 2), **SIZE)


def patch_polygon(patches, *, solid=False):
    covered, corner = pixels_of_patches(patches)
    return trace_polygon(without_slits(covered, solid=solid), corner - 1)


def assert_pixels_are_those_whose_centre(polygon, covered, u, v):
    """But for rounding at its border."""
    assert covered[shapely.contains_xy(polygon.buffer(-1e-6), u, v)].all()
    assert not covered[~shapely.contains_xy(polygon.buffer(1e-6), u, v)].any()


def test_hulls_of_points():
    assert hull([(10, 10), (20, 10), (20, 20), (10, 20), (15, 12)]).equals(shapely.box(10, 10, 20, 20))
    notched = [(x, y) for x in range(10, 31, 2) for y in range(10, 31, 2) if not (x > 18 and y > 18)]
    assert hull(notched, 0.15).area < 0.8 * hull(notched).area


@pytest.mark.parametrize("points", [np.empty((0, 2)), [(1, 1)], [(1, 1), (2, 2)], [(1, 1), (2, 2), (3, 3)]])
def test_points_that_span_no_area_give_no_polygon(points):
    assert hull(points) is None
    assert hull(points, 0.15) is None


def test_a_polygon_is_cut_beyond_one_image_size_around_the_image_and_not_before():
    touching = [(-64, -48), (128, -48), (128, 96), (-64, 96)]
    for beyond in ((0, 0), (-65, 0), (0, -49), (129, 0), (0, 97)):
        assert hull([*touching, beyond]).equals(shapely.box(-64, -48, 128, 96))
    assert image_of(hull([(-1e12, 10), (1e12, 10), (32, 40), (30, 12)])).any()


corner = st.tuples(*(st.integers(-20_000, end).map(lambda thousandth: thousandth / 1000) for end in (90_000, 70_000)))


@given(st.lists(st.lists(corner, min_size=3, max_size=12), max_size=6))
@example([[(u, 10.2), (u + 6.5, 20.0), (u + 1.0, 35.6)] for u in range(6, 52, 8)])
def test_pixels_are_those_whose_centre_the_polygon_covers(outlines):
    """A box, with holes and further parts where an odd number of hulls are."""
    hulls = filter(None, map(hull, outlines))
    polygon = reduce(shapely.symmetric_difference, hulls, shapely.box(3.3, 2.2, 60.6, 45.4))
    assert_pixels_are_those_whose_centre(polygon, image_of(polygon), U, V)


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
    covered, (left, top) = pixels_of_patches(patches.swapaxes(0, 1))
    u, v = np.meshgrid(np.arange(covered.shape[1]) + left, np.arange(covered.shape[0]) + top)
    assert_pixels_are_those_whose_centre(shapely.union_all(shapely.polygons(patches)), covered, u, v)


def test_holes_stay_open_and_slits_of_a_pixel_are_closed():
    ring = squares(*[(u, v) for u in (10.5, 14.5, 18.5) for v in (10.5, 14.5, 18.5) if (u, v) != (14.5, 14.5)])
    polygon = patch_polygon(ring)
    assert len(polygon.interiors) == 1
    assert image_of(polygon).sum() == 144 - 16
    assert image_of(patch_polygon(ring, solid=True)).sum() == 144
    assert image_of(patch_polygon(squares((10.5, 10.5), (15.5, 10.5)))).sum() == 9 * 4


def test_what_the_lidar_sees_in_two_parts_is_a_polygon_of_two_parts():
    polygon = patch_polygon(squares((10.5, 10.5), (30.5, 12.5)))
    assert (polygon.geom_type, polygon.is_valid) == ("MultiPolygon", True)
    expected = np.zeros((48, 64), dtype=bool)
    expected[11:15, 11:15] = expected[13:17, 31:35] = True
    np.testing.assert_array_equal(image_of(polygon), expected)


@given(arrays(bool, (7, 9)))
def test_the_polygon_gives_back_its_pixels(mask):
    polygon = trace_polygon(mask, np.array([20, 20]))
    if not mask.any():
        assert polygon is None
        return
    assert polygon.is_valid
    assert image_of(polygon)[20:27, 20:29][mask].all()


@pytest.mark.parametrize(
    "patches", [np.empty((4, 0, 2)), squares((10.2, 10.2), side=0.5), squares((500, 10)), squares((-90, 10))]
)
def test_patches_that_cover_no_pixel_give_no_polygon(patches):
    assert patch_polygon(patches) is None


def frame_of(recording, kind, **changes):
    return reference_of(recording, with_settings(polygon_kind=kind, **changes))


def polygon_of(recording, kind):
    return frame_of(recording, kind).objects[0].polygon


def overlap(polygon, truth):
    return polygon.intersection(truth).area / polygon.union(truth).area


@every_kind
def test_a_scanned_wall_is_evaluated_within_its_polygon_and_a_band_takes_from_it_and_adds_beside_it(kind):
    recording, truth = wall_recording(away_m=6.0, width_m=2.0)
    frame = frame_of(recording, kind)
    (wall,) = frame.objects
    assert wall.status is Status.EVALUATED
    assert wall.region_px == wall.polygon_px == (frame.labels == 1).sum()
    np.testing.assert_array_equal(frame.labels == 1, pixels_of(wall.polygon) & frame.valid)
    assert overlap(wall.polygon, truth) > 0.8
    assert not frame.ignored.any()
    banded = frame_of(recording, kind, unknown_band=ERRORS.model_copy(update={"limbs": {"vehicle": LEGS}}))
    (uncertain,) = banded.objects
    assert uncertain.region_px < pixels_of(truth).sum()
    assert uncertain.region_px + uncertain.unknown_px > wall.region_px
    assert uncertain.unknown_px == banded.ignored.sum() > 0


@every_kind
@pytest.mark.parametrize("chosen", [range(0), range(2), range(5)], ids=["no returns", "two returns", "one row"])
def test_returns_that_span_no_area_have_no_region_or_a_small_one(kind, chosen):
    named = PointIndices(sweep_timestamp_ns=0, indices=np.array(chosen, dtype=np.intp))
    recording = with_state(wall_recording(away_m=6.0, width_m=2.0)[0], shape=named)
    (item,) = frame_of(recording, kind, min_points=1).objects
    assert item.status is Status.IGNORED
    assert item.polygon_px < 20


def test_protocols_may_name_every_kind_of_the_documentation_and_no_other():
    assert set(get_args(RegionKindName)) == REGION_KINDS.keys()
    docs = (ROOT / "docs" / "metrics.md").read_text("utf-8")
    assert all(f"`{kind}`" in docs for kind in REGION_KINDS)


@pytest.mark.parametrize("away_m", [6.0, 8.0, 11.0])
def test_a_scanned_wall_is_covered_down_to_the_road_where_hulls_end_early(away_m):
    recording, truth = wall_recording(away_m=away_m)
    polygons = {kind: polygon_of(recording, kind) for kind in REGION_KINDS}
    shares = {kind: overlap(polygon, truth) for kind, polygon in polygons.items()}
    # No pixels to count beyond the true outline's border.
    assert polygons["surface-patches"].difference(truth.buffer(1.0)).area < 0.01 * truth.area
    assert shares["surface-patches"] > max(shares["convex"], shares["concave"], 0.9)


def test_what_lies_above_the_highest_beam_goes_on_to_the_top_of_the_annotated_shape():
    """A van of 2.6 m at 4 m from the lidar: beams rise by 2 degrees, so its upper half metre is never met."""
    recording, truth = wall_recording(away_m=6.0, width_m=2.0, height_m=2.6)
    assert polygon_of(recording, "concave").intersection(truth).area < 0.8 * truth.area
    assert polygon_of(recording, "surface-patches").intersection(truth).area > 0.95 * truth.area


def test_points_without_rows_fall_back_to_the_concave_hull():
    rows = np.arange(12)
    points = LIDAR.inverse().apply(np.column_stack([np.full(12, 8.0), 0.4 + 0.08 * (rows % 2), 0.2 + 0.11 * rows]))
    assert find_grid(points) is None
    sparse = with_sweep(wall_recording()[0], LidarSweep(timestamp_ns=0, points_lidar=points))
    concave = polygon_of(sparse, "concave")
    assert concave.area > 20
    assert polygon_of(sparse, "surface-patches").equals(concave)


def test_points_in_the_vehicles_axes_give_the_same_polygon_once_it_is_told_where_the_beams_start():
    """Seen from below the rear axle, rows of beams are no rows: stripes of the wall would stay open."""
    recording, truth = wall_recording(away_m=4.0, width_m=2.0)
    sweep = recording.sweeps[0].read()
    merged = with_sweep(recording, replace(sweep, points_lidar=LIDAR.apply(sweep.points_lidar)))
    merged = replace(merged, vehicle_from_lidar=RigidTransform.identity())
    stated = replace(merged, lidar_from_sensor=LIDAR)
    expected, same, unstated = (polygon_of(drive, "surface-patches") for drive in (recording, stated, merged))
    assert same.symmetric_difference(expected).area < 0.005 * expected.area
    assert unstated.intersection(truth).area < same.intersection(truth).area
    assert polygon_of(stated, "convex").equals(polygon_of(merged, "convex"))  # hulls do not ask where beams start


@pytest.mark.parametrize("seed", range(40))
def test_every_pixel_goes_to_the_nearest_object_that_covers_it_and_within_nearer_bands_to_none(seed):
    rng, shape = np.random.default_rng(seed), (30, 40)
    objects, regions = [], []
    for _ in range(rng.integers(1, 9)):
        (top, bottom), (left, right) = np.sort(rng.integers(0, np.add(shape, 1), (2, 2)).T).tolist()
        possible = rng.random((bottom - top, right - left)) < rng.choice([0.1, 0.9])
        core = possible & (rng.random(possible.shape) < rng.choice([0.05, 0.5, 1.0]))
        objects.append(an_object(list(Status)[rng.integers(len(Status))]))
        region = replace(a_region((slice(top, bottom), slice(left, right)), possible), core=core)
        regions.append(region if rng.random() < 0.9 else None)
    settled, labels, ignored, unknown = compose(objects, regions, np.ones(shape, dtype=bool))

    cores, bands = np.zeros((2, len(objects), *shape), dtype=bool)
    for core, band, region in zip(cores, bands, regions, strict=True):
        if region is not None:
            core[region.window], band[region.window] = region.core, region.possible & ~region.core
    evaluated = [item.status is Status.EVALUATED for item in objects]
    expected, expected_ignored, expected_unknown = np.zeros(shape, dtype=int), *np.zeros((2, *shape), dtype=bool)
    for k, (item, result) in enumerate(zip(objects, settled, strict=True)):
        seen = (cores[k] | bands[k]) & ~cores[:k].any(axis=0)
        own = cores[k] & seen & ~bands[:k].any(axis=0)
        occluded = evaluated[k] and regions[k] is not None and not own.any()
        if evaluated[k] and own.any():
            expected[own] = k + 1
            expected_unknown |= seen & ~own
            assert (result.region_px, result.unknown_px) == (own.sum(), (seen & ~own).sum())
        else:
            assert (result.region_px, result.unknown_px) == (0, 0)
        if occluded or item.status is Status.IGNORED:
            expected_ignored |= cores[k] | bands[k]
        assert (result.reason is IgnoreReason.OCCLUDED) == (result.status is not item.status) == occluded
    assert labels.dtype == np.int32
    np.testing.assert_array_equal(labels, expected)
    np.testing.assert_array_equal(unknown, expected_unknown)
    np.testing.assert_array_equal(ignored, (expected_ignored & (expected == 0)) | expected_unknown)
