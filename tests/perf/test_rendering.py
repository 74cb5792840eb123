"""One rendered image beside one flow of the same image, for `make perf`.

The ratio to one Farnebäck call stands in each benchmark's extra information; no time is asserted here.
"""

from pathlib import Path
from time import thread_time

import numpy as np
import pytest

from bench.flow import dense_flow
from bench.synthesis import read_scenario
from bench.synthesis.driving.host import mounted_camera, own_body
from bench.synthesis.imaging.film import moment
from bench.synthesis.imaging.renderer import ImageRenderer
from bench.synthesis.imaging.textures import texture_atlas
from bench.synthesis.stage import set_stage
from bench.threads import single_threaded

DEMO = Path(__file__).parents[2] / "datasets" / "demo.scenario.yaml"


@pytest.mark.parametrize("kind", ["sunny", "night"])
def test_render_one_image(benchmark, kind):
    scenario = read_scenario(DEMO)
    spec = scenario.recordings[0].model_copy(
        update={"light": scenario.recordings[0].light.model_copy(update={"kind": kind})}
    )
    stage, camera = set_stage(scenario, spec), mounted_camera(scenario.cameras[0])
    renderer = ImageRenderer(
        camera, own_body=own_body(), world=stage.world, atlas=texture_atlas(scenario.seed), light=stage.light,
        sensor=scenario.cameras[0].sensor,
    )  # fmt: skip
    half_ns = round(stage.light.shutter_ms * 5e5)

    def render(time_ns):
        shutter = moment(stage, time_ns - half_ns), moment(stage, time_ns + half_ns)
        return renderer.render(moment(stage, time_ns), shutter=shutter, rng=np.random.default_rng(0)).pixels

    times_ns = stage.image_times_ns.tolist()
    with single_threaded():
        start, end = render(times_ns[1]), render(times_ns[0])
        flow_s, render_s = [], []
        for _ in range(7):  # in turns, and by the thread's own clock: a busy machine slows both alike
            flow_s.append(_thread_s(lambda: dense_flow("farneback")(start, end)))
            render_s.append(_thread_s(lambda: render(times_ns[2])))
        benchmark.extra_info["ratio_to_flow"] = round(float(np.median(render_s) / np.median(flow_s)), 2)
        assert benchmark(render, times_ns[2]).shape == start.shape


def _thread_s(work):
    begin = thread_time()
    work()
    return thread_time() - begin
