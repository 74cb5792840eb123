"""Light and shadow of rendered images, checked where the answer is known by hand."""

import numpy as np
import pytest

from bench.cameras.pinhole import PinholeCamera
from bench.geometry import RigidTransform
from bench.synthesis.ego import AHEAD_FROM_CAMERA
from bench.synthesis.imaging.renderer import Moment
from bench.synthesis.mesh import PlacedMesh, Surface, box, joined, quads
from bench.synthesis.scene import KINDS
from tests.synthesis.pictures import PLAIN, mounted, renderer_of, road, wall

pytestmark = pytest.mark.slow

ROAD = road(PLAIN)
# 5 m up, looking straight down; the right of the image is -y of the world, its top is +x.
DOWN = RigidTransform(np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), np.array([0.0, 0.0, 5.0]))
AHEAD = RigidTransform(AHEAD_FROM_CAMERA, np.array([0.0, 0.0, 1.0]))


def seen(*placed, kind, sun, world=ROAD, mounting=DOWN, ego=None):
    model = PinholeCamera(width=201, height=201, focal=(100, 100), principal_point=(100, 100))
    renderer = renderer_of(mounted(model, mounting), world=world, kind=kind, sun=sun)
    moment = Moment(placed=placed, world_from_vehicle=ego or RigidTransform.identity())
    return renderer.render(moment, rng=np.random.default_rng(0))


def block():
    """A metre cube that floats with its underside 1 m above the road, at the image's middle."""
    return PlacedMesh(mesh=box([1, 1, 1], [0, 0, 1.5], PLAIN), instance_id=1)


@pytest.mark.parametrize("moving", [True, False])
def test_shadow_falls_where_the_sun_throws_it(moving):
    # At 45 degrees from +y the shadow of heights 1 to 2 m and of y from -0.5 to 0.5 covers y from -2.5 to -0.5.
    placed = [block()] if moving else []
    world = ROAD if moving else joined(ROAD, block().mesh)
    image = seen(*placed, kind="sunny", sun=(0, 1, 1), world=world)
    y_m = -(np.arange(201) - 100) / 100 * 5.0
    row = image.pixels[100].astype(float)
    dark, lit = row[(y_m < -1.1) & (y_m > -2.4)], row[(y_m < -2.7) & (y_m > -4.5)]
    assert dark.max() < lit.min()
    day = KINDS["sunny"]
    assert lit.mean() == pytest.approx(255 * 0.5 * (day.sky_light + day.sun_light * np.sqrt(0.5)), abs=3)
    assert np.ptp(row[y_m > 2]) <= 1
    edge_m = y_m[np.flatnonzero((row < (dark.mean() + lit.mean()) / 2) & (y_m < -1)).max()]
    assert edge_m == pytest.approx(-2.5, abs=0.06)


def test_clouds_throw_no_shadow_but_take_light_from_below_bodies():
    with_block, without = (seen(*placed, kind="overcast", sun=(0, 1, 1)) for placed in ([block()], []))
    changed = with_block.pixels.astype(int) - without.pixels
    away = np.ones(changed.shape, dtype=bool)
    away[40:161, 40:161] = False
    assert (changed[away] == 0).all()
    assert changed[100, 100 - 13] == pytest.approx(changed[100, 100 + 13], abs=3)


def test_sky_stands_still_when_the_camera_drives():
    images = [
        seen(kind="sunny", sun=(0, 1, 1), mounting=AHEAD, ego=RigidTransform.from_yaw(0.0, [way_m, 0.0, 0.0]))
        for way_m in (0.0, 13.0)
    ]
    sky = np.isinf(images[0].distances_m)
    assert sky[:100].all()
    sky[95:] = False  # the end of the road
    assert np.array_equal(images[0].pixels[sky], images[1].pixels[sky])
    assert images[0].pixels[sky].std() > 1


def test_panes_mirror_more_at_a_grazing_angle():
    pane = Surface(albedo=0.1, contrast=0.0, mirror=0.08)
    walls = [quads([[x0, 2, 0], [x0 + 2, 2, 0], [x0 + 2, 2, 8], [x0, 2, 8]], pane) for x0 in (3, 19)]
    image = seen(kind="overcast", sun=(0, 1, 1), world=joined(ROAD, *walls), mounting=AHEAD)
    near, far = image.pixels[30:60, 50], image.pixels[80:90, 91]
    assert far.mean() > near.mean() + 20


def test_headlights_light_the_road_ahead_and_bodies_shade_it():
    screen = PlacedMesh(mesh=box([0.1, 3, 1.5], [12, 0, 0.75], PLAIN), instance_id=1)
    world = joined(ROAD, wall(25, y_m=(-9, 9), height_m=5))
    mounting = RigidTransform(AHEAD_FROM_CAMERA, np.array([3.7, 0.0, 1.8]))  # sees over the screen
    without, shaded = (
        seen(*placed, kind="night", sun=(0, 1, 1), world=world, mounting=mounting) for placed in ((), (screen,))
    )
    free = (shaded.instance_ids == 0) & (without.distances_m < 24)
    assert without.pixels[free].max() > 60
    assert without.pixels[0:40].max() < 20
    lost = (without.pixels.astype(int) - shaded.pixels > 10) & (shaded.instance_ids == 0)
    assert lost.sum() > 20
