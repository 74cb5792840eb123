"""One rendered image, and one revolution of the lidar, for `make perf`; no time is asserted here."""

import pytest

from bench.threads import single_threaded
from tests.perf.staging import LIGHTS, staged


@pytest.mark.parametrize("light", LIGHTS)
def test_render_one_image(benchmark, light):
    stage = staged(light)
    with single_threaded():
        assert benchmark(stage.render, 2).shape == (480, 640)


def test_scan_one_revolution(benchmark):
    stage = staged(LIGHTS[0])
    with single_threaded():
        assert len(benchmark(stage.scan, 2).points_lidar) > 1000
