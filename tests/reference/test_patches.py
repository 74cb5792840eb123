"""What each return stands for: unbiased, open where the lidar saw through, closed over dropouts.

Flat shapes are scanned by a lidar with a regular grid of beams, so that the true outline is known.
"""

import numpy as np
import pytest
import shapely
from shapely.affinity import scale

from bench.reference.grid import find_grid
from bench.reference.patches import CutOff, end_spread, surface_patches

SENSORS = {  # steps between columns and rows, degrees
    "hdl-64e": (0.1728, 0.42),
    "128 rows": (0.2, 0.2),
    "wide columns": (0.7, 0.35),
    "32 rows": (0.2, 1.33),
}


def scan(shape, *, steps_deg, distance_m=6.0, phase=(0.3, 0.6), jitter_rad=0.0, seed=0):
    """Returns of a shape in the plane x = distance, given in its (y, z); (N, 3) m, lidar frame."""
    columns, rows = (
        np.radians(np.arange(-30, 30, step) + part * step) for step, part in zip(steps_deg, phase, strict=True)
    )
    azimuth, elevation = (angles.ravel() for angles in np.meshgrid(columns, rows))
    rng = np.random.default_rng(seed)
    azimuth = azimuth + jitter_rad * rng.standard_normal(azimuth.shape)
    elevation = elevation + jitter_rad * rng.standard_normal(elevation.shape)
    across_m, up_m = distance_m * np.tan(azimuth), distance_m * np.tan(elevation) / np.cos(azimuth)
    points = np.column_stack([np.full(len(azimuth), distance_m), across_m, up_m])
    return points[shapely.contains_xy(shape, points[:, 1], points[:, 2])]


def patches_of(points):
    return surface_patches(points, world_from_sensor=np.eye(3), grid=find_grid(points))


def silhouette_of(points):
    """The union of the patches in the shape's own plane, (y, z) m."""
    return shapely.union_all(shapely.polygons(patches_of(points).corners[1:].T))


def iou(one, other):
    return one.intersection(other).area / one.union(other).area


ELLIPSE = scale(shapely.Point(0.2, -0.4).buffer(1.0, quad_segs=32), 0.45, 0.9)
LEGS = shapely.box(-0.5, -1.0, -0.15, 0.6).union(shapely.box(0.15, -1.0, 0.5, 0.6))


@pytest.mark.parametrize("name", SENSORS)
def test_steps_between_columns_and_rows_are_found_from_the_points(name):
    column, row = np.radians(SENSORS[name])
    grid = find_grid(scan(shapely.box(-1.5, -1.5, 1.5, 1.5), steps_deg=SENSORS[name], jitter_rad=0.02 * column))
    assert grid.column_step_rad == pytest.approx(column, rel=0.06)
    assert np.median(grid.row_step_rad) == pytest.approx(row, rel=0.06)
    assert (grid.neighbours >= 0).all(axis=0).mean() > 0.5


def test_rows_that_lie_close_at_the_horizon_and_far_apart_below_leave_no_stripes():
    box = shapely.box(-1.0, -2.0, 1.0, 0.5)
    dense = scan(shapely.box(-1.0, -0.5, 1.0, 0.5), steps_deg=(0.2, 0.17))
    sparse = scan(shapely.box(-1.0, -2.0, 1.0, -0.5), steps_deg=(0.2, 1.0))
    assert silhouette_of(np.vstack([dense, sparse])).area == pytest.approx(box.area, rel=0.05)


@pytest.mark.parametrize("phase", [(0.0, 0.0), (0.4, 0.8), (0.7, 0.3)])
@pytest.mark.parametrize("name", ["hdl-64e", "128 rows", "wide columns"])
def test_the_area_of_a_scanned_ellipse_is_right_whatever_the_beams_and_where_they_fall(name, phase):
    points = scan(ELLIPSE, steps_deg=SENSORS[name], phase=phase)
    found, hull = silhouette_of(points), shapely.MultiPoint(points[:, 1:]).convex_hull
    assert hull.area < ELLIPSE.area
    assert found.area == pytest.approx(ELLIPSE.area, rel=0.06)
    assert iou(found, ELLIPSE) > max(0.90, iou(hull, ELLIPSE) - 0.01)


def test_a_rectangle_is_right_on_average_over_where_the_beams_fall():
    box, hulls, areas = shapely.box(-0.4, -0.9, 0.4, 0.8), [], []
    for phase in np.random.default_rng(3).random((12, 2)):
        points = scan(box, steps_deg=SENSORS["hdl-64e"], phase=phase)
        areas.append(silhouette_of(points).area / box.area)
        hulls.append(shapely.MultiPoint(points[:, 1:]).convex_hull.area / box.area)
    assert np.mean(areas) == pytest.approx(1.0, abs=0.01)
    assert np.mean(hulls) < 0.96


def test_the_gap_between_two_legs_stays_open():
    found = silhouette_of(scan(LEGS, steps_deg=SENSORS["hdl-64e"]))
    assert found.intersection(shapely.box(-0.1, -1.0, 0.1, 0.6)).area == 0
    assert iou(found, LEGS) > 0.93


def test_one_missing_return_in_five_leaves_the_area_as_it_is():
    points = scan(ELLIPSE, steps_deg=SENSORS["hdl-64e"])
    kept = np.random.default_rng(1).random(len(points)) > 0.2
    assert silhouette_of(points[kept]).area == pytest.approx(ELLIPSE.area, rel=0.06)


def test_two_surfaces_one_behind_the_other_are_not_joined():
    """Seen along x they touch; a patch from one to the other would hang in the air between them."""
    near = scan(shapely.box(-0.5, -0.5, 0.0, 0.5), steps_deg=SENSORS["hdl-64e"], distance_m=6.0)
    far = scan(shapely.box(0.0, -0.6, 0.6, 0.6), steps_deg=SENSORS["hdl-64e"], distance_m=8.0)
    depths = patches_of(np.vstack([near, far])).corners[0]
    assert np.abs(depths - np.round(depths)).max() < 0.05


def test_the_order_of_points_and_a_turn_of_the_sensor_do_not_matter():
    points = scan(ELLIPSE, steps_deg=SENSORS["hdl-64e"], jitter_rad=1e-4)
    area = silhouette_of(points).area
    shuffled = np.random.default_rng(2).permutation(points)
    assert silhouette_of(shuffled).area == pytest.approx(area, rel=0.005)  # other returns tell the step
    backwards = np.diag([-1.0, -1.0, 1.0])  # the cluster now lies across the jump of the azimuth
    turned = surface_patches(points, world_from_sensor=backwards, grid=find_grid(points @ backwards)).corners
    assert shapely.union_all(shapely.polygons(turned[1:].T)).area == pytest.approx(area, rel=0.01)


def test_a_return_on_the_axis_of_the_lidar_has_nothing_beside_it():
    ring = [[0.05 * np.cos(a), 0.05 * np.sin(a), 2.0] for a in np.linspace(0, 0.3, 7)]
    grid = find_grid(np.array([[0.0, 0.0, 2.0], *ring]))
    assert not grid.linked[:2, 0].any()
    assert np.isnan(grid.step_m[1]).tolist() == [True] + [False] * 7


@pytest.mark.parametrize(
    "points", [np.empty((0, 3)), [(5, 0, 0)], [(5, 0, 0.1), (5, 0, 0.2), (5, 0, 0.3)], [(5, 1, 0)] * 4]
)
def test_returns_that_do_not_lie_beside_each_other_have_no_grid(points):
    assert find_grid(np.array(points, dtype=np.float64).reshape(-1, 3)) is None


def test_ends_move_by_the_spacing_of_the_beams_along_rows_and_columns():
    """A wall under a lidar with wide rows: its ends differ by direction, and neighbours hold what lies between."""
    points = scan(shapely.box(-0.5, -0.5, 0.5, 0.5), steps_deg=SENSORS["32 rows"])
    patches = patches_of(points)
    extents = patches.corners, *patches.with_free_ends_moved(np.zeros(len(points)))
    half, least, most = (corners[1:].min(axis=(1, 2)) for corners in extents)
    moved_m = 6.0 * np.radians([0.2, 1.33]) / 12**0.5
    assert least - half == pytest.approx(moved_m, rel=0.02)
    assert half - most == pytest.approx(moved_m, rel=0.02)


def test_ends_move_the_less_the_larger_the_other_errors():
    """Variances add up: an error of 3 and a spacing of 4 make 5, of which 3 are the outline's."""
    step_m = np.array([[4.0 * 12**0.5], [4e-9]])
    assert (end_spread(step_m, np.array([3.0])) * step_m).ravel() == pytest.approx([2.0, 0.0], abs=1e-9)


def test_patches_reach_the_ground_and_the_ends_of_the_lidars_field_only_where_it_is_due():
    patch = np.array([[5, 0.1, 0.5], [5, -0.1, 0.5], [5, -0.1, 0.3], [5, 0.1, 0.3]])
    low = patch - [0, 0, 0.26]

    def extended(*patches, grounded_m=0.05, top_m=-np.inf):
        cut_off = CutOff(grounded_m=np.full(2, grounded_m), bottom_m=0.0, top_m=np.broadcast_to(top_m, 2))
        return cut_off.restored(np.array(patches).T).T

    bumper, shoe = extended(patch, low)
    np.testing.assert_array_equal(bumper, patch)  # the lidar saw the road below it
    np.testing.assert_allclose(shoe[:, 2], [0.24, 0.24, 0.0, 0.0])
    cut = extended(patch, patch, grounded_m=np.inf, top_m=[-np.inf, 1.8])
    np.testing.assert_allclose(cut[..., 2], [[0.5, 0.5, 0, 0], [1.8, 1.8, 0, 0]])
    np.testing.assert_array_equal(cut[..., :2], [patch[:, :2]] * 2)
