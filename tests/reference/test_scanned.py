"""The reference with unknown bands, on a wall whose true outline is known: every shape, dense and sparse lidars."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from bench.geometry import RigidTransform
from bench.lidar import LidarSweep
from bench.recordings import GroundPolygon, PointIndices
from bench.records.reference import Limb
from bench.reference import OutlineErrors, ReferenceBuilder, Status
from bench.reference.bands import beyond_beam
from bench.reference.grid import Beam
from bench.reference.silhouette import Prism
from tests.reference.drives import (
    LIDAR,
    camera,
    pixels_of,
    reference_of,
    wall_recording,
    with_class,
    with_points,
    with_settings,
    with_state,
    with_sweep,
)
from tests.support.limits import memory_below

LEGS = (Limb(joint=0.53, end=0.0, speed=2.0),)
ERRORS = OutlineErrors(range_noise_m=0.02, angle_rad=0.002, position_m=0.007, limbs={"pedestrian": LEGS})
SURFACE = with_settings(polygon_kind="surface-patches", clearance_above_shape=True, outline=ERRORS)


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


def built(recording, settings=SURFACE):
    return reference_of(recording, settings)


def upright_area(ring_yz, away_m: float):
    """The pixels of an upright area that faces the camera, (y, z) m."""
    ring = np.asarray(shapely.segmentize(ring_yz, 0.02).exterior.coords)
    corners_vehicle = np.column_stack([np.full(len(ring), away_m), ring])
    mounted = camera()
    return pixels_of(
        shapely.Polygon(mounted.model.project(mounted.vehicle_from_camera.inverse().apply(corners_vehicle))[0])
    )


@pytest.mark.parametrize("steps_deg", [(0.1728, 0.42), (0.2, 2.0)], ids=["64 rows", "16 rows"])
@pytest.mark.parametrize("shape", ["cuboid", "ground polygon", "point indices"])
@pytest.mark.parametrize("object_class", ["vehicle", "pedestrian"])
def test_the_core_is_the_objects_and_the_band_holds_its_outline(steps_deg, shape, object_class):
    recording, truth = wall_recording(width_m=2.0, away_m=6.0, steps_deg=steps_deg)
    frame, pixels = built(annotated_as(with_class(recording, object_class), shape)), pixels_of(truth)
    (wall,) = frame.objects
    core = frame.labels == 1
    assert wall.status is Status.EVALUATED
    assert wall.region_px == core.sum() > 0.5 * pixels.sum()
    assert 0 < wall.unknown_px == frame.ignored.sum() < wall.region_px
    assert (core & ~pixels).sum() < 0.01 * pixels.sum()
    left_out = pixels & ~core & ~frame.ignored
    # Points tell nothing of what is between the lowest of them and the road.
    assert left_out.sum() < (0.1 if shape == "point indices" else 0.02) * pixels.sum()


def test_a_sparser_lidar_has_a_wider_band():
    shares = []
    for row_deg in (0.2, 1.0, 2.0):
        (wall,) = built(wall_recording(width_m=2.0, away_m=6.0, steps_deg=(0.2, row_deg))[0]).objects
        shares.append(wall.unknown_px / (wall.region_px + wall.unknown_px))
    assert shares[0] < shares[1] < shares[2]


def test_limbs_and_times_that_nobody_tells_widen_the_band():
    recording, _ = wall_recording(width_m=2.0, away_m=6.0)
    late = replace(recording.images["front"][0], timestamp_ns=50_000_000)
    recording = replace(recording, images={"front": (late,)})
    walker, unknown = with_class(recording, "pedestrian"), {}
    for name, one, settings in (
        ("solid", recording, SURFACE),
        ("still limbs", walker, replace(SURFACE, outline=replace(ERRORS, limbs={}))),
        ("limbs", walker, SURFACE),
    ):
        unknown[name] = built(one, settings).objects[0].unknown_px
    assert unknown["limbs"] > unknown["still limbs"] >= unknown["solid"]
    # A second sweep tells how long a revolution takes: without times of points, when in it was the wall met?
    second = replace(recording.sweeps[0], timestamp_ns=100_000_000)
    two = replace(recording, sweeps=(*recording.sweeps, second))
    assert built(two).objects[0].unknown_px > unknown["solid"]


def test_what_the_lidar_looks_over_is_unknown():
    """3.5 m from a lidar at 1.8 m, beams that fall by 24.8 degrees meet nothing lower than 0.15 m."""
    recording, _ = wall_recording(width_m=2.0, away_m=4.5)
    frame, bottom = built(recording), upright_area(shapely.box(-0.4, 0.02, 0.4, 0.1), 4.49)
    assert bottom.sum() > 500
    assert not (frame.labels[bottom] > 0).any()
    assert frame.ignored[bottom].all()


def test_a_beam_that_meets_the_ends_of_a_side_at_the_bottom_passes_above_its_middle():
    """A beam that falls by a half: 1 m down at 2 m, where the side is nearest, and 1.25 m down at its ends at 2.5 m."""
    side = np.array([[x, y, z] for x in (-1.5, 1.5) for y in (2.0, 3.0) for z in (-1.25, 0.0)])
    part = beyond_beam(side, Beam(0.0, -0.5), end_m=-1.25)
    x, y, z = part.T
    assert z.max() == pytest.approx(-1.0)
    assert part[z == z.max()].tolist() == [[pytest.approx(0.0), 2.0, pytest.approx(-1.0)]]
    assert np.abs(x).max() < 1.5
    assert (np.hypot(x, y)[z > -1.25] < 2.5).all()
    assert not len(beyond_beam(side, Beam(0.0, -1.0), end_m=-1.25))


@pytest.mark.parametrize("shape", ["cuboid", "ground polygon"])
def test_a_box_that_is_tight_by_centimetres_keeps_its_noisy_returns(shape):
    """A wall 2 cm thick with 1 cm of noise: without a margin a third of the returns lies beside it."""
    recording, _ = wall_recording(width_m=2.0, away_m=6.0)
    sweep, rng = recording.sweeps[0].read(), np.random.default_rng(1)
    away_m = np.linalg.norm(sweep.points_lidar, axis=1)
    noisy = sweep.points_lidar * (1 + 0.01 * rng.standard_normal(len(away_m)) / away_m)[:, None]
    recording = annotated_as(recording, "cuboid") if shape == "cuboid" else recording
    shares = []
    for margin_m in (0.0, 0.05):
        settings = replace(SURFACE, shape_margin_m=margin_m)
        (exact,), (wall,) = (built(drive, settings).objects for drive in (recording, with_points(recording, noisy)))
        shares.append(wall.points / exact.points)
    assert shares[0] < 0.75
    assert shares[1] > 0.98


def test_returns_twice_in_nearly_one_direction_take_no_memory_for_cells_of_nothing():
    """A step of 1e-5 rad between columns divides the shape into 3e4 cells from side to side, each with its cone."""
    recording, _ = wall_recording(width_m=2.0, away_m=6.0)
    sweep = recording.sweeps[0].read()
    turned = sweep.points_lidar + 1e-5 * sweep.points_lidar[:, [1, 0, 2]] * [-1.0, 1.0, 0.0]
    recording = with_points(recording, np.concatenate([sweep.points_lidar, turned.astype(sweep.points_lidar.dtype)]))
    with memory_below(500_000_000):
        assert built(recording).objects[0].points > 0


def test_where_beams_went_past_is_not_certain():
    """A comb with teeth of two columns of beams, one beam between them; what is solid has no such gaps."""
    recording, truth = wall_recording(width_m=2.0, away_m=6.0)
    sweep = recording.sweeps[0].read()
    points = recording.vehicle_from_lidar.apply(sweep.points_lidar.astype(np.float64))
    through = (points[:, 2] > 0.3) & (np.mod(points[:, 1], 0.045) > 0.03)
    farther = np.where(through[:, None], sweep.points_lidar * 1.8, sweep.points_lidar)
    recording = with_points(recording, farther)
    comb, filled = (built(with_class(recording, name)).objects[0] for name in ("pedestrian", "vehicle"))
    assert comb.region_px < 0.8 * filled.region_px
    assert pixels_of(truth).sum() > filled.region_px


def test_points_near_the_ground_on_which_an_object_stands_are_no_part_of_any_kind():
    """On a pavement 12 cm above the road the box's own bottom counts."""
    recording, _ = wall_recording(width_m=2.0, away_m=6.0)
    box = recording.tracks[0].states[0].shape
    upwards = RigidTransform(np.eye(3), np.array([0.0, 0.0, 0.12]))
    recording = with_state(recording, shape=replace(box, vehicle_from_object=upwards @ box.vehicle_from_object))
    for kind in ("convex", "concave", "surface-patches"):
        lowest = []
        for above_shape in (False, True):
            settings = with_settings(polygon_kind=kind, clearance_above_shape=above_shape, ground_clearance_m=0.1)
            builder = ReferenceBuilder(recording, "front", settings)
            points = builder.geometry("object-0", recording.images["front"][0]).cluster_vehicle
            lowest.append(points[:, 2].min())
        assert lowest[1] > 0.22
        assert (lowest[0] < 0.22) == (kind != "surface-patches")


def test_how_far_a_beam_runs_through_a_box():
    box = np.array([[[x, y, z] for x in (0.0, 4.0) for y in (-1.0, 1.0) for z in (0.0, 2.0)]])
    points = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 1.0], [5.0, 0.0, 1.0], [-3.0, 0.0, 1.0]])
    beams = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.6, 0.0, -0.8], [1.0, 0.0, 0.0], [0.6, 0.0, -0.8]])
    shape = Prism.around(box)
    assert shape is not None
    enter_m, leave_m = shape.ways_m(points, beams)
    assert leave_m == pytest.approx([4.0, 1.25, 1.25, -1.0, 1.25])
    assert enter_m[[0, 4]] == pytest.approx([0.0, 5.0])  # the last meets the ground before it meets the box
    above = Prism.around(box, clearance_m=0.5)
    assert above is not None
    assert above.ways_m(points, beams)[1][2] == pytest.approx(0.625)
    assert Prism.around(np.empty((0, 8, 3))) is None


@pytest.mark.parametrize(("behind_m", "unknown"), [(None, True), (12.0, False), (2.0, True)])
def test_where_nothing_came_back_from_a_vehicle_is_unknown_unless_it_was_seen_through(behind_m, unknown):
    """The middle of a wall's upper half sends nothing back: returns from behind say that beams went past, those from
    before it nothing."""
    recording, _ = wall_recording(width_m=2.0, height_m=1.7, away_m=6.0)
    sweep = recording.sweeps[0].read()
    _, y_m, height_m = recording.vehicle_from_lidar.apply(sweep.points_lidar).T
    points, dark = sweep.points_lidar, (height_m > 0.9) & (np.abs(y_m - 0.4) < 0.8)
    if behind_m is None:
        points = points[~dark]
    else:
        points = np.where(dark[:, None], points * behind_m / np.linalg.norm(points, axis=1)[:, None], points)
    box = recording.tracks[0].states[0].shape
    recording = with_state(
        with_points(recording, points), shape=replace(box, size_m=box.size_m + np.array([0.3, 0.0, 0.0]))
    )
    frame, upper = built(recording), upright_area(shapely.box(-0.2, 1.05, 1.0, 1.6), 6.0)
    assert upper.sum() > 500
    assert not (frame.labels[upper] > 0).any()
    assert frame.unknown[upper].mean() > 0.99 if unknown else frame.unknown[upper].mean() < 0.05
    assert built(with_class(recording, "pedestrian")).unknown[upper].mean() < 0.05


# Drawn sweeps of lidars that do not spin, return twice, or are two.
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
    scanned = with_class(with_sweep(recording, LidarSweep(timestamp_ns=0, points_lidar=points)), object_class)
    frame, mask = built(scanned), pixels_of(truth)
    core = frame.labels == 1
    parts = core & mask, core & ~mask, mask & ~core & ~frame.ignored
    inside, outside, left_out = (float(part.sum() / mask.sum()) for part in parts)
    return inside, outside, left_out


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
