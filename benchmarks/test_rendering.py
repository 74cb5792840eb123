"""One rendered image, and one revolution of the lidar, for `make perf`; no time is asserted here.

What an image takes in one Farnebäck call on such images stands in its benchmark's extra information.
"""

import pytest

from bench.threads import single_threaded
from benchmarks.simulation import LIGHTS, prepared, seconds

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("light", LIGHTS)
def test_render_one_image(benchmark, light):
    stage, best = prepared(light), seconds((light,))
    benchmark.extra_info["ratio_to_flow"] = round(best[f"an image, {light}"] / best["Farnebäck"], 2)
    with single_threaded():
        assert benchmark(stage.render, 2).shape == (480, 640)


def test_scan_one_revolution(benchmark):
    stage = prepared(LIGHTS[0])
    with single_threaded():
        assert len(benchmark(stage.scan, 2).points_lidar) > 1000
