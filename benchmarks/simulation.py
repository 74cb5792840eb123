"""Cost of the simulated world: one image, one revolution of the lidar, beside one Farnebäck call on such images."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.flow import dense_flow
from bench.geometry import RigidTransform
from bench.synthesis import read_scenario
from bench.synthesis.ego import mounted_camera, own_body
from bench.synthesis.imaging.faces import texture_atlas
from bench.synthesis.imaging.renderer import ImageRenderer, moment
from bench.synthesis.scanner import LidarScanner
from bench.synthesis.scene import build_scene
from benchmarks.turns import best_seconds

DEMO = Path(__file__).parents[1] / "datasets" / "demo.scenario.yaml"
LIGHTS = ("sunny", "overcast", "night")


@dataclass(frozen=True, slots=True, kw_only=True)
class Prepared:
    """The first drive of the demo in some light.

    Attributes:
        render: the image of a number.
        scan: the revolution of a number.
    """

    render: Callable[[int], np.ndarray]
    scan: Callable[[int], object]


def prepared(light: str) -> Prepared:
    """Set the scene."""
    scenario = read_scenario(DEMO)
    spec = scenario.recordings[0].model_copy(
        update={"light": scenario.recordings[0].light.model_copy(update={"kind": light})}
    )
    scene, camera = build_scene(scenario, spec), mounted_camera(scenario.cameras[0])
    renderer = ImageRenderer(
        camera, own_body=own_body(), world=scene.world, atlas=texture_atlas(scenario.seed), light=scene.light,
        sensor=scenario.cameras[0].sensor,
    )  # fmt: skip
    scanner = LidarScanner(
        scenario.lidar, vehicle_from_lidar=RigidTransform.from_yaw(0.0, scenario.lidar.position_m), world=scene.world,
        own_body=own_body(), actors=scene.actors, ego=scene.ego,
    )  # fmt: skip
    half_ns = round(scene.light.kind.shutter_ms * 5e5)

    def render(number: int) -> np.ndarray:
        time_ns = int(scene.image_times_ns[number])
        middle = moment(scene, time_ns)
        shutter = middle, moment(scene, time_ns + half_ns)
        return renderer.render(middle, shutter=shutter, rng=np.random.default_rng(0)).pixels

    def scan(number: int) -> object:
        time_ns = int(scene.sweep_times_ns[number])
        return scanner.scan(time_ns, timestamp_ns=time_ns, rng=np.random.default_rng(0))

    return Prepared(render=render, scan=scan)


def seconds(lights: tuple[str, ...] = LIGHTS, *, rounds: int = 7) -> dict[str, float]:
    """Of each piece of work, in turns."""
    stages = {light: prepared(light) for light in lights}
    first = stages[lights[0]]
    start, end = first.render(1), first.render(0)
    works: dict[str, Callable[[], object]] = {"Farnebäck": lambda: dense_flow("farneback")(start, end)}
    works |= {f"an image, {light}": lambda one=one: one.render(2) for light, one in stages.items()}
    return best_seconds(works | {"a revolution of the lidar": lambda: first.scan(2)}, rounds=rounds)
