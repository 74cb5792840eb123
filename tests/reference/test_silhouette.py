"""The outline of annotated shapes: every pixel against its own ray, near the camera and over all borders."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from bench.cameras.model import ray_grid
from bench.cameras.pinhole import PinholeCamera
from bench.geometry import RigidTransform
from bench.recordings import Cuboid, GroundPolygon, PointIndices
from bench.records.reference import IgnoreReason, Status
from bench.reference.silhouette import convex_parts, silhouette
from tests.reference.drives import LENS, MOUNT, MS, Box, circle, drive, reference_of, with_settings, with_state
from tests.support.lenses import LENSES
from tests.support.worlds import FORWARD

SMALL = {name: lens.scaled(160, round(lens.height * 160 / lens.width)) for name, lens in LENSES.items()}
SMALL["cut"] = replace(SMALL["radial_polynomial"], max_angle_rad=1.2)  # a field that ends inside of the image
SMALL["odd"] = SMALL["radial_polynomial"].scaled(131, 77)  # no multiple of a block
SMALL["narrow"] = PinholeCamera(width=5, height=3, focal=(1.0, 1.0), principal_point=(2.0, 1.0))
TURNED = RigidTransform(FORWARD, np.zeros(3))  # x ahead, z up


def met_by_rays(lens, camera_from_object, low_m, high_m) -> np.ndarray:
    """Pixels whose ray enters a box: the interval of lengths in which it is between each pair of opposite sides."""
    rays = ray_grid(lens).rays_camera @ camera_from_object.rotation
    start_m = -camera_from_object.rotation.T @ camera_from_object.translation_m
    with np.errstate(divide="ignore", invalid="ignore"):
        to_low, to_high = (low_m - start_m) / rays, (high_m - start_m) / rays
    enter, leave = np.minimum(to_low, to_high).max(axis=-1), np.maximum(to_low, to_high).min(axis=-1)
    return (leave >= np.maximum(enter, 0.0)) & np.isfinite(rays).all(axis=-1)


def shown(shape, lens=LENS, camera_from_vehicle=TURNED) -> np.ndarray:
    """The whole image of what `silhouette` finds in its window."""
    window, covered = silhouette(camera_from_vehicle.apply(convex_parts(shape)), lens)
    whole = np.zeros((lens.height, lens.width), dtype=bool)
    whole[window] = covered
    return whole


def at_border(mask) -> np.ndarray:
    """Pixels with a neighbour that is not in the mask, which is nowhere beyond the image."""
    (height, width), wide = mask.shape, np.pad(mask, 1)
    return ~np.all([wide[i : i + height, j : j + width] for i in range(3) for j in range(3)], axis=0)


def cuboids(count, seed):
    """Boxes of all sizes all around the camera, from touching it to 30 m away; some hold it."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        size_m = rng.uniform([0.3, 0.3, 0.3], [12.0, 3.0, 4.0])
        direction = rng.normal(size=3) * [1.0, 1.0, 0.3]
        place_m = direction / np.linalg.norm(direction) * 30.0 ** rng.uniform(0.0, 1.0)
        turn = RigidTransform.from_quaternion(rng.normal(size=4) * [1.0, 0.1, 0.1, 1.0], place_m)
        yield Cuboid(vehicle_from_object=turn, size_m=size_m)


@pytest.mark.parametrize("name", SMALL)
def test_every_pixel_that_sees_the_box_is_in_its_outline_and_no_other(name):
    lens, areas, cut = SMALL[name], [], 0
    for shape in cuboids(150, seed=3):
        half = shape.size_m / 2
        expected = met_by_rays(lens, TURNED @ shape.vehicle_from_object, -half, half)
        np.testing.assert_array_equal(shown(shape, lens), expected)
        areas.append(expected.sum())
        seen = ray_grid(lens).valid
        cut += bool((expected & at_border(seen)).any() and (seen & ~expected).any())
    assert np.count_nonzero(areas) > 20
    assert cut > 10  # by the border of the field or of the image


def upright(outline, bottom_m=-1.0, top_m=1.0):
    return GroundPolygon(outline_m=np.array(outline, dtype=float), bottom_m=bottom_m, top_m=top_m)


@pytest.mark.parametrize("outline", [[[2, 0], [3, 0], [4, 0]], [[2, 0], [2, 0], [2, 0]]])
def test_what_has_no_extent_across_the_line_of_sight_covers_nothing(outline):
    assert not shown(upright(outline)).any()


def test_a_corner_of_walls_is_not_filled():
    """An outline like an L: exactly the pixels of its two arms."""
    shape = upright([[2.0, -3.0], [6.0, -3.0], [6.0, -2.0], [3.0, -2.0], [3.0, 3.0], [2.0, 3.0]], top_m=0.43)
    arms = (((2.0, -3.0, -1.0), (6.0, -2.0, 0.43)), ((2.0, -3.0, -1.0), (3.0, 3.0, 0.43)))
    for lens in SMALL.values():
        for camera_from_vehicle in (TURNED, TURNED @ RigidTransform.from_yaw(0.4, (-6.0, -1.0, -2.0))):
            expected = [met_by_rays(lens, camera_from_vehicle, np.array(low), np.array(high)) for low, high in arms]
            np.testing.assert_array_equal(shown(shape, lens, camera_from_vehicle), np.any(expected, axis=0))


def test_an_outline_that_crosses_itself_covers_what_it_encloses():
    corners = [[4.0, -1.0], [4.0, 1.0], [6.0, -1.0], [6.0, 1.0]]
    bow, whole = shown(upright(corners)), shown(upright([corners[i] for i in (0, 1, 3, 2)]))
    assert 0 < bow.sum() < whole.sum() * 1.001
    assert not (bow & ~whole).any()


HOST = circle(8.0, 0.5)


def ignored_as(box, exposure_ns, **annotated):
    """The reference of a box of too few points, and the pixels that show it."""
    recording = drive([box], HOST, exposures_ns=(exposure_ns,))
    frame = reference_of(with_state(recording, **annotated), with_settings(min_points=10_000))
    assert [(item.status, item.reason) for item in frame.objects] == [(Status.IGNORED, IgnoreReason.FEW_POINTS)]
    camera_from_world = (HOST.world_from_vehicle(exposure_ns) @ MOUNT).inverse()
    camera_from_box = camera_from_world @ box.world_from_box(exposure_ns)
    expected = met_by_rays(LENS, camera_from_box, -box.size_m / 2, box.size_m / 2) & frame.valid
    return frame, expected, camera_from_box


@pytest.mark.parametrize("yaw_rate_radps", [0.0, 1.5, -0.7])
@pytest.mark.parametrize("exposure_ms", [-90, 0, 60])
def test_a_car_without_points_is_ignored_where_it_is_at_exposure(exposure_ms, yaw_rate_radps):
    """Beside the camera, cut by the field's border and the image's, turning, from a turning host."""
    for place_m in ((5.0, 2.0, 0.75), (4.0, -2.2, 0.75), (7.0, 0.5, 0.75), (3.0, 2.0, 0.75)):
        box = Box(place_m, (4.5, 1.8, 1.5), (3.0, -2.0, 0.0), yaw_rate_radps=yaw_rate_radps, yaw_rad=0.3)
        frame, expected, _ = ignored_as(box, exposure_ms * MS)
        np.testing.assert_array_equal(frame.ignored, expected)
        (item,) = frame.objects
        assert item.polygon_px == expected.sum() > 3000
        drawn = shapely.contains_xy(item.polygon, *np.meshgrid(np.arange(640), np.arange(480)))
        np.testing.assert_array_equal(drawn & frame.valid, expected)


def test_a_ground_outline_turns_as_the_car_does():
    box = Box((6.0, 1.5, 0.75), (4.5, 1.8, 1.5), (3.0, -2.0, 0.0), yaw_rate_radps=1.5, yaw_rad=0.3)
    corners = np.array([[1, 1, -1], [-1, 1, -1], [-1, -1, -1], [1, -1, -1]]) * box.size_m / 2
    outline_m = box.world_from_box(0).apply(corners)[:, :2]  # the vehicle stands in the world's origin at 0
    frame, expected, _ = ignored_as(box, 80 * MS, shape=upright(outline_m, 0.0, 1.5))
    assert (frame.ignored ^ expected).sum() <= 2
    assert expected.sum() > 3000


def test_few_points_named_one_by_one_are_ignored_within_their_hull():
    box = Box((6.0, 1.5, 0.75), (4.5, 1.8, 1.5), (3.0, -2.0, 0.0))
    named = PointIndices(indices=np.arange(0, 400, 9), sweep_timestamp_ns=0)
    frame, _, camera_from_box = ignored_as(box, 20 * MS, shape=named)
    hull = shapely.MultiPoint(LENS.project(camera_from_box.apply(box.skin(400)[::9]))[0]).convex_hull
    expected = shapely.contains_xy(hull, *np.meshgrid(np.arange(640), np.arange(480))) & frame.valid
    assert (frame.ignored ^ expected).sum() < 0.02 * expected.sum()
    assert expected.sum() > 3000
