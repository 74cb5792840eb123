import numpy as np
import pytest

from bench.errors import ShapeError
from bench.geometry import RigidTransform, RoadPlane

# A camera that looks forward: its z is the vehicle's x, its x the vehicle's -y, its y the vehicle's -z.
FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def test_road_below_a_level_camera():
    road = RoadPlane.below(RigidTransform(FORWARD, np.array([3.7, 0.0, 0.66])))
    np.testing.assert_allclose(road.down, [0, 1, 0], atol=1e-15)
    assert road.height_m == pytest.approx(0.66)
    assert RoadPlane.below(RigidTransform(FORWARD, np.array([0, 0, 1.4])), ground_height_m=-0.1).height_m == 1.5


def test_distance_along_a_ray_30_degrees_down():
    road = RoadPlane(np.array([0.0, 1.0, 0.0]), 0.66)
    down30 = np.array([0.0, np.sin(np.pi / 6), np.cos(np.pi / 6)])
    assert road.distance_m(down30) == pytest.approx(1.32)
    assert np.isinf(road.distance_m(np.array([0.0, 0.0, 1.0])))
    assert np.isinf(road.distance_m(np.array([0.0, -1.0, 0.0])))
    assert np.isinf(road.distance_m(np.array([0.0, 1e-320, 1.0])))  # a hair below the horizon


@pytest.mark.parametrize(("down", "height_m"), [([0, 0, 0], 1.0), ([0, 1], 1.0), ([0, 1, 0], 0.0), ([0, 1, 0], -1.0)])
def test_impossible_roads_are_refused(down, height_m):
    with pytest.raises(ShapeError, match="RoadPlane"):
        RoadPlane(np.array(down, dtype=float), height_m)
