"""The static world: what is solid keeps clear of what moves, and the ground is where the plan says."""

from itertools import combinations

import numpy as np
import pytest
import shapely
from pydantic import ValidationError

from bench.synthesis.rays import RayScene
from bench.synthesis.scenario import SideStreetSpec, StreetSpec, named_rng
from bench.synthesis.world import build_world

SPECS = {
    "street": StreetSpec(parking="both", zebra_at_m=(12.0,), trees=0.6),
    "junction": StreetSpec(
        lanes_right=1,
        side_streets=(SideStreetSpec(at_m=25, side="left"), SideStreetSpec(at_m=25, side="right", width_m=6)),
    ),
    "bend_left": StreetSpec(lanes_right=1, curvature_per_m=0.0785),
    "bend_right": StreetSpec(lanes_right=1, curvature_per_m=-0.0942, parking="left"),
    "car_park": StreetSpec(kind="car_park", kerb_m=0.1),
    "avenue": StreetSpec(kind="avenue", side_streets=(SideStreetSpec(at_m=30, side="right"),)),
}
WALK = shapely.box(8.0, -25.0, 11.0, 25.0)  # someone crosses from house to house
DRIVE = shapely.box(-6.0, -1.2, 45.0, 1.2)
FLAT_M = 0.0035  # the thickest paint
EVERYTHING_M = 400.0


@pytest.fixture(scope="module", params=SPECS)
def kind(request):
    return str(request.param)


@pytest.fixture(scope="module")
def world(kind):
    return build_world(SPECS[kind], named_rng(3, kind), [WALK, DRIVE])


def seen_from_above(mesh, places_m, *, from_m=30.0):
    """What lies below places (N, 2), and how high it is."""
    origins = np.column_stack([places_m, np.full(len(places_m), from_m)])
    hits = RayScene(mesh.corners_m).cast(np.tile([[0.0, 0.0, -1.0]], (len(places_m), 1)), origins)
    return hits, from_m - hits.distances_m


def grid(x_m, y_m, step_m=0.31):
    x, y = np.meshgrid(np.arange(*x_m, step_m), np.arange(*y_m, step_m))
    return np.stack([x.ravel(), y.ravel()], axis=1)


def test_obstacles_keep_clear_of_ways_and_of_each_other(world):
    assert len(world.obstacles) > 20
    assert not any(shapely.intersects([WALK, DRIVE], obstacle).any() for obstacle in world.obstacles)
    assert sum(shapely.intersection(a, b).area for a, b in combinations(world.obstacles, 2)) == 0


def test_the_ground_has_no_holes_and_is_clear_where_someone_walks_and_drives(world, kind):
    _, height_m = seen_from_above(world.mesh, grid((-60.0, 120.0), (-60.0, 60.0), 1.7), from_m=100.0)
    assert height_m.min() > -0.06
    # From below the crowns and eaves that one may walk under.
    _, height_m = seen_from_above(world.mesh, grid((8.1, 10.9), (-24.9, 24.9)), from_m=1.9)
    assert height_m.max() <= max(SPECS[kind].kerb_m, 0.0) + 0.01
    assert height_m.min() > -0.06
    hits, height_m = seen_from_above(world.mesh, grid((-6.0, 5.0), (-1.1, 1.1)), from_m=1.9)
    assert np.abs(height_m).max() < FLAT_M
    assert hits.normals[:, 2].min() > 0.99


def test_what_stands_out_is_an_obstacle(world, kind):
    places_m = grid((-15.0, 45.0), (-9.0, 9.0), 0.23)
    _, height_m = seen_from_above(world.mesh, places_m, from_m=1.5)
    high = places_m[height_m > SPECS[kind].kerb_m + 0.05]
    away_m = shapely.distance(shapely.union_all(world.obstacles), shapely.points(high))
    # Twigs, awnings and bulges stick out a little, lamp heads and crowns are higher than the rays begin.
    assert len(high) > 30
    assert np.quantile(away_m, 0.98) < 0.3


def test_pavement_lies_a_kerb_above_the_road():
    spec = StreetSpec(kerb_m=0.14, pavement_m=3.0, trees=0.0)
    mesh = build_world(spec, named_rng(0, "kerb")).mesh
    edge_m = 0.5 * spec.lane_width_m
    _, road_m = seen_from_above(mesh, grid((0, 40), (-edge_m + 0.1, -edge_m + 0.5)), from_m=1.0)
    _, kerb_m = seen_from_above(mesh, grid((0, 40), (-edge_m - 0.12, -edge_m - 0.03), 0.05), from_m=1.0)
    _, pavement_m = seen_from_above(mesh, grid((0, 40), (-edge_m - 2.0, -edge_m - 0.2)), from_m=1.0)
    assert np.abs(road_m).max() < FLAT_M
    assert np.median(kerb_m) == pytest.approx(0.14, abs=1e-3)
    assert kerb_m.min() < 0.03 + FLAT_M  # a drive crosses it somewhere
    assert np.median(pavement_m) == pytest.approx(0.14, abs=FLAT_M)
    assert pavement_m.min() > 0.02


def test_zebra_crossing_is_painted_from_kerb_to_lowered_kerb():
    spec = StreetSpec(zebra_at_m=(12.0,))
    mesh = build_world(spec, named_rng(0, "zebra")).mesh
    across = np.stack([np.full(400, 12.0), np.linspace(-1.6, 4.85, 400)], axis=1)
    hits, height_m = seen_from_above(mesh, across, from_m=1.0)
    painted = mesh.surfaces[hits.triangles, 0] > 0.45
    assert 0.35 < painted.mean() < 0.65
    assert np.count_nonzero(np.diff(painted.astype(int)) == 1) >= 5
    assert np.abs(height_m).max() < FLAT_M
    _, kerb_m = seen_from_above(mesh, np.array([[12.0, -1.7], [12.0, 4.95]]), from_m=1.0)
    assert kerb_m == pytest.approx([0.025, 0.025], abs=2e-3)


def test_side_street_opens_the_kerb_with_rounded_corners():
    spec = StreetSpec(side_streets=(SideStreetSpec(at_m=20, side="right", width_m=6),), trees=0.0)
    mesh = build_world(spec, named_rng(0, "side")).mesh
    _, mouth_m = seen_from_above(mesh, grid((17.2, 22.8), (-30.0, -2.0)), from_m=1.0)
    assert np.quantile(np.abs(mouth_m), 0.99) < FLAT_M
    _, corners_m = seen_from_above(mesh, np.array([[16.5, -2.1], [14.0, -4.0]]), from_m=1.0)
    assert corners_m[0] == pytest.approx(0, abs=FLAT_M)  # cut off by the radius of the kerb
    assert corners_m[1] > 0.1


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_parked_cars_take_their_share_of_the_places(share):
    spec = StreetSpec(parking="right", parked_cars=share, lanes_left=0, buildings=False, hedges=0.0, trees=0.0)
    world = build_world(spec, named_rng(0, "cars"), [])
    lane = shapely.box(-40.0, -1.625 - 2.1, 100.0, -1.625)
    cars = [o for o in world.obstacles if shapely.intersects(lane, o)]
    assert len(cars) == (0 if share == 0 else pytest.approx(20, abs=3))
    assert all(3.0 < shapely.oriented_envelope(car).length < 20.0 for car in cars)


def test_an_avenue_has_as_many_lanes_on_both_sides_of_its_rail():
    spec = StreetSpec(kind="avenue", lanes_left=1)
    mesh = build_world(spec, named_rng(0, "avenue")).mesh
    left_m = 1.5 * spec.lane_width_m
    _, own_m = seen_from_above(mesh, grid((0, 40), (-1.5, left_m)), from_m=3.0)
    _, opposite_m = seen_from_above(mesh, grid((0, 40), (left_m + 3.0, left_m + 3.0 + 6.5)), from_m=3.0)
    _, rail_m = seen_from_above(mesh, grid((0, 40), (left_m + 0.9, left_m + 2.1), 0.04), from_m=3.0)
    assert max(np.abs(own_m).max(), np.abs(opposite_m).max()) < FLAT_M
    assert rail_m.max() == pytest.approx(0.75, abs=0.06)


def test_a_gantry_spans_the_whole_road_above_the_traffic_and_posts_mark_its_edges():
    plain = StreetSpec(kind="avenue", lanes_left=1, trees=0.0, hedges=0.0, buildings=False)
    fast = plain.model_copy(update={"gantries_at_m": (20.0,), "marker_posts": True})
    bare, built = (build_world(spec, named_rng(0, "fast")) for spec in (plain, fast))
    known = {triangle.tobytes() for triangle in bare.mesh.corners_m}
    added_m = np.array([triangle for triangle in built.mesh.corners_m if triangle.tobytes() not in known])
    over = np.abs(added_m[..., 0] - 20.0).max(axis=1) < 1.0
    high_m = added_m[over & (added_m[..., 2].min(axis=1) > 5.5)]
    assert np.ptp(high_m[..., 1]) > 4 * plain.lane_width_m  # both carriageways
    posts_m = added_m[~over]
    assert posts_m[..., 2].max() == pytest.approx(1.0 + plain.kerb_m, abs=0.05)
    right, left = posts_m[..., 1] < -0.5 * plain.lane_width_m - 0.5, posts_m[..., 1] > 3.5 * plain.lane_width_m + 2.0
    assert right.any()
    assert left.any()
    assert (right | left).all()


def test_the_same_seed_gives_the_same_bytes_and_another_one_another_world(kind, world):
    again = build_world(SPECS[kind], named_rng(3, kind), [WALK, DRIVE])
    for name in ("corners_m", "texture_m", "surfaces"):
        assert np.array_equal(getattr(again.mesh, name), getattr(world.mesh, name)), name
    assert [o.wkb for o in again.obstacles] == [o.wkb for o in world.obstacles]
    if kind == "street":
        other = build_world(SPECS[kind], named_rng(4, kind), [WALK, DRIVE])
        assert len(other.mesh.corners_m) != len(world.mesh.corners_m)


def test_world_is_sound_and_small_enough_to_render(world):
    mesh = world.mesh
    assert len(mesh.corners_m) <= 40_000
    assert np.isfinite(mesh.corners_m).all()
    assert np.isfinite(mesh.texture_m).all()
    assert np.abs(mesh.corners_m).max() <= 500.0
    sky = mesh.surfaces[:, 5] > 0
    assert np.abs(mesh.corners_m[~sky]).max() < EVERYTHING_M
    assert ((mesh.surfaces[:, 0] > 0) & (mesh.surfaces[:, 0] < 1)).all()
    edges = mesh.corners_m[:, 1:] - mesh.corners_m[:, :1]
    assert (np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) > 0).all()


def test_rain_darkens_the_ground_and_nothing_else():
    dry, wet = (build_world(StreetSpec(wet=wet), named_rng(3, "street")).mesh for wet in (False, True))
    np.testing.assert_array_equal(dry.corners_m, wet.corners_m)
    np.testing.assert_array_equal(dry.surfaces[:, 1:], wet.surfaces[:, 1:])
    darker = wet.surfaces[:, 0] / dry.surfaces[:, 0]
    assert set(np.round(np.unique(darker), 9)) == {round(1 / 1.33**2, 9), 1.0}
    heights_m = dry.corners_m[..., 2].max(axis=1)
    assert heights_m[darker < 1].max() <= StreetSpec().kerb_m + 0.01
    seen, _ = seen_from_above(dry, grid((2.0, 20.0), (-1.4, 1.4)))
    assert (darker[seen.triangles] < 1).mean() > 0.9  # of the ego vehicle's lane; the rest is paint


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"parked_cars": 0.5}, "parked_cars: this street has no place"),
        ({"parking": "left", "parked_cars": 1.2}, "less than or equal to 1"),
        ({"kind": "car_park", "parking": "left"}, "parking: a car park has bays"),
        ({"kind": "car_park", "zebra_at_m": [10]}, "zebra_at_m: only a street"),
        ({"zebra_at_m": [10, 13]}, "10 and 13 on the left overlap; keep them 6 m apart"),
        ({"zebra_at_m": [99]}, "less than or equal to 92"),
        ({"zebra_at_m": [20], "side_streets": [{"at_m": 24, "side": "right"}]}, "on the right overlap"),
        ({"kind": "avenue", "side_streets": [{"at_m": 24, "side": "left"}]}, "only on the right of an avenue"),
        ({"curvature_per_m": 0.05, "side_streets": [{"at_m": 10, "side": "left"}]}, "none inside the bend"),
    ],
)
def test_what_does_not_fit_is_refused(fields, expected):
    with pytest.raises(ValidationError, match=expected):
        StreetSpec.model_validate(fields)
