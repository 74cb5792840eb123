"""The functions that every image passes through, for `make perf`; no time is asserted here."""

import numpy as np
import pytest

from bench.cameras import ray_grid
from bench.flow import cell_mean, dense_flow
from bench.geometry import RigidTransform, RoadPlane, normalise
from bench.geometry.raster import rasterise
from bench.methods.spherical.constraints import deviations
from bench.methods.spherical.likelihood import PAPER_WEIGHTS, motion_likelihood
from bench.reference.regions import hull_polygon
from tests.support.lenses import LENSES

every_lens = pytest.mark.parametrize("name", sorted(LENSES))


@every_lens
def test_project_120000_points(benchmark, name):
    points = np.random.default_rng(0).normal(size=(120_000, 3))
    pixels, valid = benchmark(LENSES[name].project, points)
    assert pixels.shape == (120_000, 2)
    assert valid.any()


@every_lens
def test_unproject_307200_pixels(benchmark, name):
    camera = LENSES[name].scaled(640, 480)
    pixels = ray_grid(camera).pixels.reshape(-1, 2)
    rays, valid = benchmark(camera.unproject, pixels)
    assert rays.shape == (307_200, 3)
    assert valid.any()


def test_deviations_of_12288_cells(benchmark):
    camera = LENSES["radial_polynomial"]
    rays = ray_grid(camera, 5).rays_camera
    motion = RigidTransform.from_yaw(0.01, (0.01, 0.1, -0.3))
    road = RoadPlane(np.array([0.0, 0.94, 0.34]), 0.66)
    previous = normalise(rays + np.random.default_rng(0).normal(scale=0.01, size=rays.shape))
    found = benchmark(lambda: deviations(previous, rays, current_from_previous=motion, road=road))
    assert motion_likelihood(found, PAPER_WEIGHTS).max() > 0


@pytest.mark.parametrize("name", ["farneback", "dis"])
def test_dense_flow_at_640_x_480(benchmark, name):
    start = np.random.default_rng(0).integers(0, 255, (480, 640), dtype=np.uint8)
    assert benchmark(dense_flow(name), start, np.roll(start, 2, axis=1)).shape == (480, 640, 2)


def test_cell_mean_of_flow(benchmark):
    assert benchmark(cell_mean, np.zeros((480, 640, 2), np.float32), 5).shape == (96, 128, 2)


@pytest.mark.parametrize("ratio", [None, 0.15], ids=["convex", "concave"])
def test_polygon_of_3000_points(benchmark, ratio):
    pixels = np.random.default_rng(0).normal((320, 240), 60, (3000, 2))

    def polygon_and_pixels():
        polygon = hull_polygon(pixels, ratio=ratio, width=640, height=480)
        return rasterise(polygon, width=640, height=480)

    assert benchmark(polygon_and_pixels)[1].any()
