"""An image depends on its own scene alone."""

from __future__ import annotations

import numpy as np
import pytest

from bench.cameras import RadialPolynomialCamera
from bench.geometry import RigidTransform
from bench.synthesis.ego import AHEAD_FROM_CAMERA, own_body
from bench.synthesis.imaging.renderer import ImageRenderer, Moment, RenderedImage
from bench.synthesis.mesh import Mesh, PlacedMesh, Surface, box, joined, quads
from bench.synthesis.scenario import SensorSpec
from tests.synthesis.pictures import GREY, mounted, renderer_of, road

ROAD = road(GREY)
AHEAD = RigidTransform(AHEAD_FROM_CAMERA, np.array([3.7, 0.0, 0.8]))
MODEL = RadialPolynomialCamera(
    width=157, height=117, coefficients=(42.0, -3.0, 5.0, -0.8), principal_point=(78.0, 58.0)
)  # whole tiles neither across nor down


def renderer(kind: str, world: Mesh = ROAD) -> ImageRenderer:
    camera = mounted(MODEL, AHEAD)
    return renderer_of(camera, world=world, own_body=own_body(), kind=kind, sensor=SensorSpec())


def image(renderer: ImageRenderer, body: Mesh, way_m: float) -> RenderedImage:
    def at(m: float) -> Moment:
        placed = PlacedMesh(mesh=body.moved(RigidTransform.from_yaw(0.2 * m, [0.0, m, 0.0])), instance_id=5)
        return Moment(placed=[placed], world_from_vehicle=RigidTransform.from_yaw(0.1 * m, [m, 0.0, 0.0]))

    middle = at(way_m)
    return renderer.render(middle, shutter=(middle, at(way_m + 0.05)), rng=np.random.default_rng(3))


@pytest.mark.parametrize("kind", ["sunny", "overcast", "night"])
def test_image_is_the_same_whatever_was_rendered_before(kind: str) -> None:
    body = box([2.0, 1.2, 1.5], [9.0, 0.0, 0.75], GREY)
    used = renderer(kind)
    for way_m in (0.0, 30.0, -2.0):
        image(used, body, way_m)
    alone, later = image(renderer(kind), body, 1.0), image(used, body, 1.0)
    assert np.array_equal(alone.pixels, later.pixels)
    assert np.array_equal(alone.instance_ids, later.instance_ids)
    assert np.array_equal(alone.distances_m, later.distances_m)
    assert (alone.instance_ids == 5).sum() > 100


def test_what_lies_behind_changes_nothing() -> None:
    # Hidden triangles are found early, in an order that depends on all of them.
    body = box([2.0, 1.2, 1.5], [9.0, 0.0, 0.75], GREY)
    wall = quads([[14, 9, 0], [14, -9, 0], [14, -9, 6], [14, 9, 6]], GREY)
    behind = box([1.0, 3.0, 2.0], [16.0, 0.0, 1.0], GREY)
    front, more = joined([ROAD, wall]), joined([behind, ROAD, wall])
    without, with_hidden = (image(renderer("overcast", world), body, 0.0) for world in (front, more))
    assert np.array_equal(without.instance_ids, with_hidden.instance_ids)
    assert np.array_equal(without.distances_m, with_hidden.distances_m)


def test_lamps_of_bodies_glow_by_night_alone() -> None:
    lamp, off = (
        box([0.5, 0.8, 0.8], [7.0, 0.0, 1.0], Surface(albedo=0.2, contrast=0.0, glow=glow)) for glow in (0.6, 0.0)
    )
    for kind, brighter in (("sunny", False), ("night", True)):
        lit, dark = (image(renderer(kind), body, 0.0).pixels.astype(int) for body in (lamp, off))
        assert ((lit - dark).max() > 50) == brighter
