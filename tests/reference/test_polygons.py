import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from bench.geometry.raster import rasterise
from bench.reference.regions import hull_polygon

SIZE = {"width": 64, "height": 48}


def hull(points, ratio=None):
    return hull_polygon(np.array(points, dtype=float), ratio=ratio, **SIZE)


def image_of(polygon):
    image = np.zeros((48, 64), dtype=bool)
    window, covered = rasterise(polygon, **SIZE)
    image[window] = covered
    return image


def test_convex_polygon_of_a_square_with_a_point_inside():
    polygon = hull([(10, 10), (20, 10), (20, 20), (10, 20), (15, 12)])
    assert polygon.equals(shapely.box(10, 10, 20, 20))


def test_concave_polygon_follows_the_notch():
    ring = [(x, y) for x in range(10, 31, 2) for y in range(10, 31, 2) if not (x > 18 and y > 18)]
    assert hull(ring, 0.15).area < 0.8 * hull(ring).area


@pytest.mark.parametrize("points", [np.empty((0, 2)), [(1, 1)], [(1, 1), (2, 2)], [(1, 1), (2, 2), (3, 3)]])
def test_points_that_span_no_area_give_no_polygon(points):
    assert hull(points) is None
    assert hull(points, 0.15) is None


def test_pixels_of_a_square_by_hand():
    image = image_of(shapely.box(1.5, 2.5, 5.4, 4.4))
    assert np.argwhere(image).tolist() == [[v, u] for v in (3, 4) for u in (2, 3, 4, 5)]


def test_a_polygon_beyond_the_border_is_cut_and_one_outside_is_empty():
    window, covered = rasterise(shapely.box(-10, -10, 2.5, 1.5), **SIZE)
    assert covered.shape == (2, 3)
    assert covered.all()
    assert window == (slice(0, 2), slice(0, 3))
    assert rasterise(shapely.box(100, 100, 120, 120), **SIZE)[1].sum() == 0


def test_a_polygon_that_reaches_to_infinity_is_cut_before_it_is_drawn():
    polygon = hull([(-1e12, 10), (1e12, 10), (32, 40), (30, 12)])
    assert polygon.bounds[0] >= -SIZE["width"]
    assert polygon.bounds[2] <= 2 * SIZE["width"]
    assert rasterise(polygon, **SIZE)[1].any()


def test_a_polygon_is_cut_beyond_one_image_size_around_the_image_and_not_before():
    touching = [(-64, -48), (128, -48), (128, 96), (-64, 96)]
    assert hull(touching).equals(shapely.box(-64, -48, 128, 96))
    for beyond in ((-65, 0), (0, -49), (129, 0), (0, 97)):
        assert hull([*touching, beyond]).equals(shapely.box(-64, -48, 128, 96))


def test_pixels_of_a_comb_with_holes():
    """Rows cross many edges, and those of the holes lie between those of the outline."""
    teeth = [shapely.box(u + 0.3, 5.4, u + 3.2, 30.7) for u in range(4, 60, 5)]
    comb = shapely.union_all([shapely.box(2.2, 28.1, 61.6, 40.9), *teeth])
    comb = comb.difference(shapely.union_all([shapely.Point(u, 35).buffer(2.2) for u in (10, 21.4, 40, 52)]))
    assert comb.geom_type == "Polygon"
    assert len(comb.interiors) == 4
    u, v = np.meshgrid(np.arange(64), np.arange(48))
    np.testing.assert_array_equal(image_of(comb), shapely.contains_xy(comb, u, v))


corner = st.tuples(*(st.integers(-20_000, end).map(lambda thousandth: thousandth / 1000) for end in (90_000, 70_000)))


@given(st.lists(corner, min_size=3, max_size=12))
def test_pixels_are_those_whose_centre_the_polygon_covers(corners):
    polygon = hull(corners)
    if polygon is None:
        return
    image = image_of(polygon)
    u, v = np.meshgrid(np.arange(64), np.arange(48))
    surely_in = shapely.contains_xy(polygon.buffer(-1e-6), u, v)
    surely_out = ~shapely.contains_xy(polygon.buffer(1e-6), u, v)
    assert image[surely_in].all()
    assert not image[surely_out].any()
