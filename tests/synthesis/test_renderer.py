"""What is rendered agrees with the cameras' own projection."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.cameras import PinholeCamera, camera_parameters, ray_grid
from bench.geometry import RigidTransform
from bench.recordings import MountedCamera
from bench.synthesis.ego import AHEAD_FROM_CAMERA, mounted_camera, own_body
from bench.synthesis.imaging.renderer import Moment, RenderedImage
from bench.synthesis.mesh import PlacedMesh, box
from bench.synthesis.scenario import CameraSpec, SensorSpec
from tests.support.lenses import LENSES
from tests.synthesis.pictures import GREY, mounted, renderer_of, road

SIZE = {"width": 320, "height": 240}
MODELS = {name: lens.scaled(**SIZE) for name, lens in LENSES.items()}
MODELS["pinhole"] = PinholeCamera(**SIZE, focal=(100, 100), principal_point=(159.5, 119.5))  # wide enough for the box
FISHEYE = MODELS["radial_polynomial"]
PITCH = RigidTransform(
    np.array([[np.cos(0.3), 0, np.sin(0.3)], [0, 1, 0], [-np.sin(0.3), 0, np.cos(0.3)]]), np.zeros(3)
)
VEHICLE_FROM_CAMERA = RigidTransform(PITCH.rotation @ AHEAD_FROM_CAMERA, np.array([3.7, 0.1, 0.8]))
WORLD_FROM_VEHICLE = RigidTransform.from_yaw(0.4, [20.0, -7.0, 0.0])


def picture(camera: MountedCamera, *placed: PlacedMesh) -> RenderedImage:
    renderer = renderer_of(camera, world=road(GREY), kind="sunny", sensor=SensorSpec())
    moment = Moment(placed=placed, world_from_vehicle=WORLD_FROM_VEHICLE)
    return renderer.render(moment, rng=np.random.default_rng(0))


def box_surface_m(size_m: list[float], centre_m: list[float]) -> NDArray[np.float64]:
    """Points all over a box's faces and edges."""
    steps = np.linspace(-0.5, 0.5, 61)
    a, b = (grid.ravel() for grid in np.meshgrid(steps, steps))
    faces = [np.insert(np.stack([a, b], axis=1), axis, side, axis=1) for axis in range(3) for side in (-0.5, 0.5)]
    return np.concatenate(faces) * size_m + centre_m


@pytest.mark.parametrize("model", MODELS)
def test_mask_of_a_box_is_its_projection(model: str) -> None:
    camera = mounted(MODELS[model], VEHICLE_FROM_CAMERA)
    size_m, centre_m = [2.0, 1.2, 1.5], [9.5, 1.0, 0.95]
    placed = PlacedMesh(mesh=box(size_m, centre_m, GREY).moved(WORLD_FROM_VEHICLE), instance_id=7)
    image = picture(camera, placed)
    pixels, valid = camera.model.project(VEHICLE_FROM_CAMERA.inverse().apply(box_surface_m(size_m, centre_m)))
    assert valid.all()
    v, u = np.nonzero(image.instance_ids == 7)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    # A pixel is hit through its centre: never outside of the projection, while the tip of a corner may hold no centre.
    assert [u.min() >= low[0], v.min() >= low[1], u.max() <= high[0], v.max() <= high[1]] == [True] * 4
    assert [u.min(), v.min(), u.max(), v.max()] == pytest.approx([*low, *high], abs=1.2)
    covered = np.zeros(image.instance_ids.shape, dtype=bool)
    inside = np.rint(pixels).astype(int)
    covered[inside[:, 1], inside[:, 0]] = True
    assert (covered & (image.instance_ids == 7)).sum() > 0.9 * covered.sum()


@pytest.mark.parametrize("model", MODELS)
def test_distance_of_the_road_is_that_of_the_road_plane(model: str) -> None:
    camera = mounted(MODELS[model], VEHICLE_FROM_CAMERA)
    image = picture(camera)
    grid = ray_grid(camera.model)
    wanted_m = camera.road.distance_m(grid.rays_camera[grid.valid])
    near = wanted_m < 30
    assert near.sum() > 1000
    assert image.distances_m[grid.valid][near] == pytest.approx(wanted_m[near], rel=1e-4)
    assert (image.pixels[~grid.valid] == 0).all()


def test_road_has_texture_everywhere_and_no_clipping() -> None:
    camera = mounted(FISHEYE, VEHICLE_FROM_CAMERA)
    image = picture(camera)
    near = image.distances_m < 6
    assert 0.1 < image.pixels[near].std() / image.pixels[near].mean() < 0.5
    assert ((image.pixels[near] == 0) | (image.pixels[near] == 255)).mean() < 0.01


def spec_of(name: str, **place: object) -> CameraSpec:
    parameters = {key: value for key, value in camera_parameters(MODELS[name]).items() if key not in {"model", *SIZE}}
    return CameraSpec(name="front", model=name, **SIZE, parameters=parameters, **place)  # type: ignore[arg-type]


def test_body_mask_covers_what_is_seen_of_the_ego_vehicle() -> None:
    camera = mounted_camera(spec_of("radial_polynomial", position_m=(3.7, 0.0, 0.66), pitch_down_deg=20))
    own = PlacedMesh(mesh=own_body().moved(WORLD_FROM_VEHICLE), instance_id=9)
    assert camera.ego_body is not None
    assert np.array_equal(picture(camera, own).instance_ids == 9, camera.ego_body)
    assert 0.02 < camera.ego_body.mean() < 0.25
    assert not camera.ego_body[:120].any()


def test_camera_looks_where_its_angles_say() -> None:
    spec = spec_of("pinhole", position_m=(2, 1, 1), yaw_deg=90, pitch_down_deg=30)
    ahead = mounted_camera(spec).vehicle_from_camera.rotate(np.array([0.0, 0.0, 1.0]))
    assert ahead == pytest.approx([0, np.cos(np.pi / 6), -0.5], abs=1e-12)
