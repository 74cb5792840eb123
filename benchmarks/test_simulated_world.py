"""Cost of what begins every rendering and every run: reading a scenario, making bodies, building a world; `make perf`.

No time is asserted here.
"""

from pathlib import Path

import pytest

from bench.synthesis import read_scenario
from bench.synthesis.bodies import BODIES, make_body
from bench.synthesis.scenario import named_rng
from bench.synthesis.scene import box_size, plan_trajectories, swept_ground
from bench.synthesis.world import build_world

DATASETS = Path(__file__).parents[1] / "datasets"
MOST_TRIANGLES = 40_000


@pytest.fixture(scope="module")
def paper():
    return read_scenario(DATASETS / "paper.scenario.yaml")


@pytest.mark.parametrize("name", ["demo", "paper", "range-maps"])
def test_read_scenario(benchmark, name):
    box_size.cache_clear()  # the first read makes a body of every kind
    assert benchmark(read_scenario, DATASETS / f"{name}.scenario.yaml").recordings


@pytest.mark.parametrize("kind", BODIES)
def test_make_a_body(benchmark, kind):
    assert len(benchmark(lambda: make_body(kind, named_rng(0, kind))).mesh.corners_m) > 500


@pytest.mark.parametrize("name", ["zebra-01", "stepping-out-02", "avenue-03", "car-park-01", "backing-out-01"])
def test_build_a_world(benchmark, paper, name):
    spec = next(spec for spec in paper.recordings if spec.name == name)
    keep_clear = swept_ground(plan_trajectories(paper, spec), [box_size(actor.kind) for actor in spec.actors])
    world = benchmark(lambda: build_world(spec.street, named_rng(paper.seed, name, "world"), keep_clear))
    benchmark.extra_info["triangles"] = len(world.mesh.corners_m)
    assert len(world.mesh.corners_m) <= MOST_TRIANGLES
