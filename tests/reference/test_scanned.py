"""The reference with unknown bands, on a wall whose true outline is known: every shape, all sorts of lidars."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from bench.geometry import RigidTransform
from bench.lidar.sweep import LidarSweep
from bench.recordings import GroundPolygon, PointIndices
from bench.records.reference import Status
from bench.reference.build import ReferenceBuilder
from tests.reference.drives import (
    ERRORS,
    LIDAR,
    pixels_of,
    reference_of,
    upright_polygon,
    wall_recording,
    with_class,
    with_points,
    with_settings,
    with_state,
    with_sweep,
)
from tests.support.drive import cast
from tests.support.limits import memory_below
from tests.support.worlds import beams

SURFACE = with_settings(polygon_kind="surface-patches", unknown_band=ERRORS)


@pytest.fixture
def wall():
    """A wall of 2 m by 1.7 m, 6 m ahead."""
    return wall_recording(width_m=2.0, away_m=6.0)[0]


def object_of(recording, settings=SURFACE):
    return reference_of(recording, settings).objects[0]


def annotated_as(recording, shape: str):
    """The recording with the same wall annotated in another way."""
    box = recording.tracks[0].states[0].shape
    corners = box.vehicle_from_object.apply(
        np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * (box.size_m / 2 + 0.05)
    )
    points = recording.vehicle_from_lidar.apply(recording.sweeps[0].read().points_lidar.astype(np.float64))
    shapes = {
        "cuboid": box,
        "ground polygon": GroundPolygon(outline_m=corners[:, :2], bottom_m=0.0, top_m=float(box.size_m[2])),
        "point indices": PointIndices(sweep_timestamp_ns=0, indices=np.flatnonzero(points[:, 2] > 0.02)),
    }
    return with_state(recording, shape=shapes[shape])


@pytest.mark.parametrize("steps_deg", [(0.1728, 0.42), (0.2, 2.0)], ids=["64 rows", "16 rows"])
@pytest.mark.parametrize("shape", ["cuboid", "ground polygon", "point indices"])
@pytest.mark.parametrize("object_class", ["vehicle", "pedestrian"])
def test_the_core_is_the_objects_and_the_band_holds_its_outline(steps_deg, shape, object_class):
    recording, truth = wall_recording(width_m=2.0, away_m=6.0, steps_deg=steps_deg)
    frame, pixels = reference_of(annotated_as(with_class(recording, object_class), shape), SURFACE), pixels_of(truth)
    (item,) = frame.objects
    core = frame.labels == 1
    assert item.status is Status.EVALUATED
    assert item.region_px == core.sum() > 0.5 * pixels.sum()
    assert 0 < item.unknown_px == frame.ignored.sum() < item.region_px
    assert (core & ~pixels).sum() < 0.01 * pixels.sum()
    left_out = pixels & ~core & ~frame.ignored
    # Points tell nothing of what is between the lowest of them and the road.
    assert left_out.sum() < (0.1 if shape == "point indices" else 0.02) * pixels.sum()


def test_a_sparser_lidar_has_a_wider_band():
    walls = [wall_recording(width_m=2.0, away_m=6.0, steps_deg=(0.2, row_deg))[0] for row_deg in (0.2, 1.0, 2.0)]
    shares = [item.unknown_px / item.region_px for item in map(object_of, walls)]
    assert shares[0] < shares[1] < shares[2]


def test_limbs_and_times_that_nobody_tells_widen_the_band(wall):
    late = replace(wall, images={"front": (replace(wall.images["front"][0], timestamp_ns=50_000_000),)})
    walker = with_class(late, "pedestrian")
    still = SURFACE.model_copy(update={"unknown_band": ERRORS.model_copy(update={"limbs": {}})})
    solid_px, still_px = object_of(late).unknown_px, object_of(walker, still).unknown_px
    assert object_of(walker).unknown_px > still_px >= solid_px
    # A second sweep tells how long a revolution takes: without times of points, when in it was the wall met?
    two = replace(late, sweeps=(*late.sweeps, replace(late.sweeps[0], timestamp_ns=100_000_000)))
    assert object_of(two).unknown_px > solid_px


def test_what_the_lidar_looks_over_is_unknown():
    """3.5 m from a lidar at 1.8 m, beams that fall by 24.8 degrees meet nothing lower than 0.15 m."""
    frame = reference_of(wall_recording(width_m=2.0, away_m=4.5)[0], SURFACE)
    bottom = pixels_of(upright_polygon(shapely.box(-0.4, 0.02, 0.4, 0.1), 4.49))
    assert bottom.sum() > 500
    assert not (frame.labels[bottom] > 0).any()
    assert frame.ignored[bottom].all()


@pytest.mark.parametrize("shape", ["cuboid", "ground polygon"])
def test_a_box_that_is_tight_by_centimetres_keeps_its_noisy_returns(wall, shape):
    """A wall 2 cm thick with 1 cm of noise: without a margin a third of the returns lies beside it."""
    points, rng = wall.sweeps[0].read().points_lidar, np.random.default_rng(1)
    away_m = np.linalg.norm(points, axis=1)
    noisy = points * (1 + 0.01 * rng.standard_normal(len(away_m)) / away_m)[:, None]
    exact = annotated_as(wall, "cuboid") if shape == "cuboid" else wall
    shares = []
    for margin_m in (0.0, 0.05):
        settings = SURFACE.model_copy(update={"shape_margin_m": margin_m})
        shares.append(object_of(with_points(exact, noisy), settings).points / object_of(exact, settings).points)
    assert shares[0] < 0.75
    assert shares[1] > 0.98


def test_returns_twice_in_nearly_one_direction_take_no_memory_for_cells_of_nothing(wall):
    """A step of 1e-5 rad between columns divides the shape into 3e4 cells from side to side, each with its cone."""
    points = wall.sweeps[0].read().points_lidar
    turned = points + 1e-5 * points[:, [1, 0, 2]] * [-1.0, 1.0, 0.0]
    doubled = with_points(wall, np.concatenate([points, turned.astype(points.dtype)]))
    with memory_below(500_000_000):
        assert object_of(doubled).points > 0


def test_where_beams_went_past_is_not_certain():
    """A comb with teeth of two columns of beams, one beam between them; what is solid has no such gaps."""
    recording, truth = wall_recording(width_m=2.0, away_m=6.0)
    points = recording.sweeps[0].read().points_lidar
    _, y_m, height_m = recording.vehicle_from_lidar.apply(points.astype(np.float64)).T
    through = (height_m > 0.3) & (np.mod(y_m, 0.045) > 0.03)
    recording = with_points(recording, np.where(through[:, None], points * 1.8, points))
    comb, filled = (object_of(with_class(recording, name)) for name in ("pedestrian", "vehicle"))
    assert comb.region_px < 0.8 * filled.region_px
    assert pixels_of(truth).sum() > filled.region_px


@pytest.mark.parametrize("kind", ["convex", "concave", "surface-patches"])
def test_points_near_the_ground_on_which_an_object_stands_are_no_part_of_any_kind(wall, kind):
    """On a pavement 12 cm above the road the box's own bottom counts."""
    box = wall.tracks[0].states[0].shape
    upwards = RigidTransform(np.eye(3), np.array([0.0, 0.0, 0.12]))
    recording = with_state(wall, shape=replace(box, vehicle_from_object=upwards @ box.vehicle_from_object))
    lowest_m = []
    for above_shape in ("road", "shape"):
        settings = with_settings(polygon_kind=kind, ground_clearance_above=above_shape, ground_clearance_m=0.1)
        builder = ReferenceBuilder(recording, "front", settings)
        points = builder.geometry("object-0", recording.images["front"][0]).cluster_vehicle
        lowest_m.append(points[:, 2].min())
    assert lowest_m[1] > 0.22
    assert (lowest_m[0] < 0.22) == (kind != "surface-patches")


@pytest.mark.parametrize(("behind_m", "unknown"), [(None, True), (12.0, False), (2.0, True)])
def test_where_nothing_came_back_from_a_vehicle_is_unknown_unless_it_was_seen_through(wall, behind_m, unknown):
    """The middle of a wall's upper half sends nothing back: returns from behind say that beams went past, those from
    before it nothing."""
    points, box = wall.sweeps[0].read().points_lidar, wall.tracks[0].states[0].shape
    _, y_m, height_m = wall.vehicle_from_lidar.apply(points).T
    dark = (height_m > 0.9) & (np.abs(y_m - 0.4) < 0.8)
    if behind_m is None:
        points = points[~dark]
    else:
        points = np.where(dark[:, None], points * behind_m / np.linalg.norm(points, axis=1)[:, None], points)
    thicker = replace(box, size_m=box.size_m + np.array([0.3, 0.0, 0.0]))
    recording = with_state(with_points(wall, points), shape=thicker)
    frame = reference_of(recording, SURFACE)
    upper = pixels_of(upright_polygon(shapely.box(-0.2, 1.05, 1.0, 1.6), 6.0))
    assert upper.sum() > 500
    assert not (frame.labels[upper] > 0).any()
    assert frame.unknown[upper].mean() > 0.99 if unknown else frame.unknown[upper].mean() < 0.05
    assert reference_of(with_class(recording, "pedestrian"), SURFACE).unknown[upper].mean() < 0.05


COLUMNS, ROWS = np.meshgrid(np.tan(np.radians(np.arange(-40, 40, 0.2))), np.tan(np.radians(np.arange(-24, 2, 0.3))))
ODD = np.arange(COLUMNS.shape[1]) % 2
# Rows in the plane square to the lidar's view, as mirrors and chips scan it: none is a cone about an axis.
ROWS_OF = {
    "straight": ROWS,
    "falling to one side": ROWS + 0.3 * COLUMNS,
    "bows": ROWS - 0.3 * COLUMNS**2,
    "staggered": ROWS + ODD * np.tan(np.radians(0.15)),
}


def returns_of(rays, start):
    """Where rays from a place meet the wall, else the road; vehicle frame in, lidar frame out."""
    reach_m = cast(start, rays, [(RigidTransform.from_yaw(0.0, (6.01, 0.4, 0.85)), np.array([0.02, 2.0, 1.7]))])
    met = reach_m < 90.0
    return LIDAR.inverse().apply(start + rays[met] * reach_m[met, None])


def spinning(start):
    return returns_of(beams(np.arange(-60, 60, 0.2), np.arange(-24.8, 2, 0.42)), start)


def shares_of(points, object_class: str) -> tuple[float, float, float]:
    """Of the wall's mask: in the core; of the core outside, and of the mask in neither core nor band."""
    recording, truth = wall_recording(width_m=2.0, away_m=6.0)
    scanned = with_class(with_sweep(recording, LidarSweep(timestamp_ns=0, points_lidar=points)), object_class)
    frame, mask = reference_of(scanned, SURFACE), pixels_of(truth)
    core = frame.labels == 1
    parts = core & mask, core & ~mask, mask & ~core & ~frame.ignored
    inside, outside, left_out = (float(part.sum() / mask.sum()) for part in parts)
    return inside, outside, left_out


@pytest.mark.parametrize("object_class", ["vehicle", "pedestrian"])
@pytest.mark.parametrize("rows", list(ROWS_OF))
def test_rows_that_are_no_cones_are_found_as_rows(rows: str, object_class: str):
    rays = np.column_stack([np.ones(COLUMNS.size), COLUMNS.ravel(), ROWS_OF[rows].ravel()])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    inside, outside, left_out = shares_of(returns_of(rays, LIDAR.translation_m), object_class)
    assert inside > 0.94
    assert outside == 0.0
    assert left_out < 0.01


@pytest.mark.parametrize("behind_m", [0.0, 0.004, 3.0])
def test_second_returns_change_nothing(behind_m: float):
    """Of the same surface, of it a little later, or of what is behind its edge."""
    once = spinning(LIDAR.translation_m)
    later = once * (1 + behind_m / np.linalg.norm(once, axis=1))[:, None]
    twice = shares_of(np.concatenate([once, later]), "pedestrian")
    assert twice == pytest.approx(shares_of(once, "pedestrian"), abs=0.001)


@pytest.mark.parametrize("apart_m", [(0.0, 0.0, 0.3), (0.0, 0.8, 0.0), (1.5, -0.6, -1.0)])
def test_sweeps_of_two_lidars_in_one_are_certain_of_less_but_not_wrong(apart_m: tuple[float, float, float]):
    """Seen from one place their rows cross: links between returns are doubtful, which only solid bodies do without."""
    two = np.concatenate([spinning(LIDAR.translation_m), spinning(LIDAR.translation_m + np.array(apart_m))])
    vehicle, pedestrian = (shares_of(two, name) for name in ("vehicle", "pedestrian"))
    assert vehicle[0] > 0.94
    assert 0.5 < pedestrian[0] < vehicle[0]
    for _, outside, left_out in (vehicle, pedestrian):
        assert outside == 0.0
        assert left_out < 0.02


def test_the_underside_of_a_floor_that_only_the_camera_sees_is_unknown(wall):
    """A flank 6 m ahead ends 1.2 m above the road; below it the lidar meets a recess 1.5 m deeper, without a gap
    between rows. The camera is lower than the lidar: below the edge it sees the floor.
    """
    points, box = wall.sweeps[0].read().points_lidar, wall.tracks[0].states[0].shape
    ahead_m, _, height_m = wall.vehicle_from_lidar.apply(points).T
    starts_m = wall.vehicle_from_lidar.translation_m[0]
    deeper = (height_m < 1.2) & (np.abs(ahead_m - 6.0) < 0.01)
    recessed = np.where(deeper[:, None], points * (7.5 - starts_m) / (6.0 - starts_m), points)
    middle = RigidTransform(np.eye(3), np.array([0.8, 0.0, 0.0]))
    size_m, vehicle_from_object = box.size_m + np.array([1.6, 0.0, 0.0]), middle @ box.vehicle_from_object
    long = replace(box, size_m=size_m, vehicle_from_object=vehicle_from_object)
    frame = reference_of(with_state(with_points(wall, recessed), shape=long), SURFACE)
    floor = pixels_of(upright_polygon(shapely.box(-0.2, 1.14, 1.0, 1.18), 6.0))
    assert floor.sum() > 40
    assert frame.unknown[floor].mean() > 0.95
