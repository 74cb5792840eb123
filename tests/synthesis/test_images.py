"""Images agree with the cameras' own projection, depend on their own scene alone, and err as lens and sensor state."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.cameras.angular import RadialPolynomialCamera
from bench.cameras.model import ray_grid
from bench.cameras.pinhole import PinholeCamera
from bench.cameras.stored import camera_parameters
from bench.geometry import RigidTransform
from bench.synthesis.ego import AHEAD_FROM_CAMERA, mounted_camera, own_body
from bench.synthesis.imaging.exposure import Sensor
from bench.synthesis.imaging.renderer import Moment
from bench.synthesis.imaging.visibility import lens_of
from bench.synthesis.mesh import PlacedMesh, Surface, box, joined
from bench.synthesis.scenario import CameraSpec, SensorSpec
from tests.support.lenses import LENSES
from tests.synthesis.pictures import EXACT, GREY, mounted, renderer_of, road, wall

SIZE = {"width": 320, "height": 240}
MODELS = {name: lens.scaled(**SIZE) for name, lens in LENSES.items()}
MODELS["pinhole"] = PinholeCamera(**SIZE, focal=(100, 100), principal_point=(159.5, 119.5))  # wide enough for the box
FISHEYE = MODELS["radial_polynomial"]
PITCH = Rotation.from_rotvec([0, 0.3, 0]).as_matrix()
VEHICLE_FROM_CAMERA = RigidTransform(PITCH @ AHEAD_FROM_CAMERA, np.array([3.7, 0.1, 0.8]))
WORLD_FROM_VEHICLE = RigidTransform.from_yaw(0.4, [20.0, -7.0, 0.0])


def picture(camera, *placed):
    renderer = renderer_of(camera, world=road(GREY), kind="sunny", sensor=SensorSpec())
    moment = Moment(placed=placed, world_from_vehicle=WORLD_FROM_VEHICLE)
    return renderer.render(moment, rng=np.random.default_rng(0))


def box_surface_m(size_m, centre_m):
    """Points all over a box's faces and edges."""
    steps = np.linspace(-0.5, 0.5, 61)
    a, b = (grid.ravel() for grid in np.meshgrid(steps, steps))
    faces = [np.insert(np.stack([a, b], axis=1), axis, side, axis=1) for axis in range(3) for side in (-0.5, 0.5)]
    return np.concatenate(faces) * size_m + centre_m


@pytest.mark.parametrize("model", MODELS)
def test_mask_of_a_box_is_its_projection_and_the_road_lies_in_its_plane(model):
    camera = mounted(MODELS[model], VEHICLE_FROM_CAMERA)
    size_m, centre_m = [2.0, 1.2, 1.5], [9.5, 1.0, 0.95]
    image = picture(camera, PlacedMesh(mesh=box(size_m, centre_m, GREY).moved(WORLD_FROM_VEHICLE), instance_id=7))
    shown = image.instance_ids == 7
    pixels, valid = camera.model.project(VEHICLE_FROM_CAMERA.inverse().apply(box_surface_m(size_m, centre_m)))
    assert valid.all()
    v, u = np.nonzero(shown)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    # A pixel is hit through its centre: never outside of the projection, while the tip of a corner may hold no centre.
    assert [u.min() >= low[0], v.min() >= low[1], u.max() <= high[0], v.max() <= high[1]] == [True] * 4
    assert [u.min(), v.min(), u.max(), v.max()] == pytest.approx([*low, *high], abs=1.2)
    covered = np.zeros(shown.shape, dtype=bool)
    inside = np.rint(pixels).astype(int)
    covered[inside[:, 1], inside[:, 0]] = True
    assert (covered & shown).sum() > 0.9 * covered.sum()

    rays = ray_grid(camera.model)
    wanted_m = camera.road.distance_m(rays.rays_camera)
    near = rays.valid & ~shown & (wanted_m < 30)
    assert near.sum() > 1000
    assert image.distances_m[near] == pytest.approx(wanted_m[near], rel=1e-4)
    assert (image.pixels[~rays.valid] == 0).all()
    near = image.pixels[(image.distances_m < 6) & ~shown]  # the road has texture, and nothing is clipped
    assert 0.1 < near.std() / near.mean() < 0.5
    assert ((near == 0) | (near == 255)).mean() < 0.01


def spec_of(name, **place):
    parameters = {key: value for key, value in camera_parameters(MODELS[name]).items() if key not in {"model", *SIZE}}
    return CameraSpec(name="front", model=name, **SIZE, parameters=parameters, **place)


def test_a_camera_looks_where_its_angles_say_and_its_body_mask_covers_what_is_seen_of_the_ego_vehicle():
    camera = mounted_camera(spec_of("radial_polynomial", position_m=(3.7, 0.0, 0.66), pitch_down_deg=20))
    own = PlacedMesh(mesh=own_body().moved(WORLD_FROM_VEHICLE), instance_id=9)
    assert camera.ego_body is not None
    assert np.array_equal(picture(camera, own).instance_ids == 9, camera.ego_body)
    assert 0.02 < camera.ego_body.mean() < 0.25
    assert not camera.ego_body[:120].any()
    spec = spec_of("pinhole", position_m=(2, 1, 1), yaw_deg=90, pitch_down_deg=30)
    ahead = mounted_camera(spec).vehicle_from_camera.rotate(np.array([0.0, 0.0, 1.0]))
    assert ahead == pytest.approx([0, np.cos(np.pi / 6), -0.5], abs=1e-12)


ROAD = road(GREY)
AHEAD = RigidTransform(AHEAD_FROM_CAMERA, np.array([3.7, 0.0, 0.8]))
BODY = box([2.0, 1.2, 1.5], [9.0, 0.0, 0.75], GREY)
# Whole tiles neither across nor down.
MODEL = RadialPolynomialCamera(width=157, height=117, coefficients=(42, -3, 5, -0.8), principal_point=(78.0, 58.0))


def renderer(kind, world=ROAD):
    camera = mounted(MODEL, AHEAD)
    return renderer_of(camera, world=world, own_body=own_body(), kind=kind, sensor=SensorSpec())


def image(renderer, body, way_m):
    def at(m):
        placed = PlacedMesh(mesh=body.moved(RigidTransform.from_yaw(0.2 * m, [0.0, m, 0.0])), instance_id=5)
        return Moment(placed=[placed], world_from_vehicle=RigidTransform.from_yaw(0.1 * m, [m, 0.0, 0.0]))

    middle = at(way_m)
    return renderer.render(middle, closes=at(way_m + 0.05), rng=np.random.default_rng(3))


@pytest.mark.parametrize("kind", ["sunny", "overcast", "night"])
def test_image_is_the_same_whatever_was_rendered_before(kind):
    used = renderer(kind)
    for way_m in (0.0, 30.0, -2.0):
        image(used, BODY, way_m)
    alone, later = image(renderer(kind), BODY, 1.0), image(used, BODY, 1.0)
    assert np.array_equal(alone.pixels, later.pixels)
    assert np.array_equal(alone.instance_ids, later.instance_ids)
    assert np.array_equal(alone.distances_m, later.distances_m)
    assert (alone.instance_ids == 5).sum() > 100


def test_what_lies_behind_changes_nothing():
    # Hidden triangles are found early, in an order that depends on all of them.
    behind = box([1.0, 3.0, 2.0], [16.0, 0.0, 1.0], GREY)
    front = joined(ROAD, wall(14, GREY, y_m=(-9, 9), height_m=6))
    more = joined(behind, front)
    without, with_hidden = (image(renderer("overcast", world), BODY, 0.0) for world in (front, more))
    assert np.array_equal(without.instance_ids, with_hidden.instance_ids)
    assert np.array_equal(without.distances_m, with_hidden.distances_m)


def test_lamps_of_bodies_glow_by_night_alone():
    glass = [Surface(albedo=0.2, contrast=0.0, glow=glow) for glow in (0.6, 0.0)]
    lamp, off = (box([0.5, 0.8, 0.8], [7.0, 0.0, 1.0], surface) for surface in glass)
    for kind, brighter in (("sunny", False), ("night", True)):
        lit, dark = (image(renderer(kind), body, 0.0).pixels.astype(int) for body in (lamp, off))
        assert ((lit - dark).max() > 50) == brighter


CAMERA = PinholeCamera(width=160, height=120, focal=(80, 80), principal_point=(79.5, 59.5))
EVEN = np.full((120, 160), 0.4, dtype=np.float32)
LOW_AHEAD = RigidTransform(AHEAD_FROM_CAMERA, np.array([0.0, 0.0, 1.0]))


def test_edge_of_the_lens_gets_its_share_of_the_light():
    spec = EXACT.model_copy(update={"edge_light": 0.5})
    pixels = Sensor(spec, lens_of(CAMERA), gain=1.0).expose(EVEN, np.random.default_rng(0))
    assert pixels[59, 79] == 102
    assert pixels[0, 0] == pytest.approx(51, abs=1)


@pytest.mark.parametrize(("gain", "grey"), [(1.0, 0.4), (4.0, 0.4), (1.0, 0.1)])
def test_noise_has_its_variance(gain, grey):
    spec = SensorSpec(edge_light=1.0, read_noise_grey=1.5, full_well_electrons=8000.0)
    pixels = Sensor(spec, lens_of(CAMERA), gain=gain).expose(EVEN * (grey / 0.4), np.random.default_rng(0))
    # Electrons follow Poisson's law; rounding adds a twelfth.
    variance = (1.5 * gain) ** 2 + 255 * grey * 255 * gain / 8000.0 + 1 / 12
    assert pixels.mean() == pytest.approx(255 * grey, abs=0.2)
    assert pixels.var() == pytest.approx(variance, rel=0.05)


def test_stripe_is_smeared_by_its_way_in_the_image():
    # A white stripe 8 m ahead moves 0.8 m to the left while the shutter is open: 0.8 / 8 * 80 px = 8 px.
    black, white = Surface(albedo=0.02, contrast=0.0), Surface(albedo=0.7, contrast=0.0)
    renderer = renderer_of(mounted(CAMERA, LOW_AHEAD), world=wall(9, black, y_m=(-30, 30), height_m=20))

    def at(y_m):
        stripe = box([0.02, 2.0, 4], [8.01, y_m, 1], white)
        return Moment(placed=[PlacedMesh(mesh=stripe, instance_id=3)], world_from_vehicle=RigidTransform.identity())

    still = renderer.render(at(0.0), rng=np.random.default_rng(0))
    moved = renderer.render(at(0.0), closes=at(0.4), rng=np.random.default_rng(0))
    assert np.array_equal(still.instance_ids, moved.instance_ids)
    middle = moved.pixels[60].astype(float)
    inside = moved.instance_ids[60] == 3
    # Half of the smear lies on the stripe: at its edge the pixel was covered for half of the time.
    first = int(np.flatnonzero(inside)[0])
    low, high = middle[~inside].min(), middle.max()
    assert middle[first] == pytest.approx((low + high) / 2, abs=0.12 * (high - low))
    assert middle[first + 5] == pytest.approx(high, abs=2)
    assert (np.diff(middle[first : first + 5]) > 0.05 * (high - low)).all()


def test_ego_vehicle_that_turns_leaves_its_own_body_sharp():
    rough = Surface(albedo=0.5, contrast=0.4, texel_m=0.02)
    own_body = box([2, 4, 0.2], [0.3, 0, 0.3], rough)
    renderer = renderer_of(mounted(MODEL, LOW_AHEAD), world=road(rough), own_body=own_body)
    moments = [Moment(placed=[], world_from_vehicle=RigidTransform.from_yaw(0, [x_m, 0, 0])) for x_m in (0, 0.8)]
    still = renderer.render(moments[0], rng=np.random.default_rng(0))
    moved = renderer.render(moments[0], closes=moments[1], rng=np.random.default_rng(0))
    own = np.zeros((MODEL.height, MODEL.width), dtype=bool)
    own[100:, 60:100] = True
    ground = np.zeros_like(own)
    ground[68:75, 20:140] = True
    assert (still.distances_m[own] < 1.5).all()
    assert np.array_equal(still.pixels[own], moved.pixels[own])
    assert moved.pixels[ground].std() < 0.9 * still.pixels[ground].std()
