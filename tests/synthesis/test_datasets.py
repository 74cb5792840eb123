"""Shipped scenarios: what the paper's holds, and that what is trained or tried on is never scored."""

import re
from collections import Counter
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from bench.recordings import load_card
from bench.synthesis import read_scenario
from bench.synthesis.bodies import BODIES, make_body
from bench.synthesis.ego import mounted_camera
from bench.synthesis.scenario import named_rng
from bench.synthesis.scene import plan_trajectories
from bench.synthesis.world.plan import drawn_plan

ROOT = Path(__file__).parents[2]
LIGHTS = {"sunny", "overcast", "low_sun", "night"}


@cache
def scenario(name):
    return read_scenario(ROOT / "datasets" / f"{name}.scenario.yaml")


def test_both_cards_of_the_paper_read_the_same_recordings():
    recorded, exact = (load_card(ROOT / "datasets" / f"{name}.yaml") for name in ("paper", "paper-exact"))
    assert (recorded.root, recorded.scenario) == (exact.root, exact.scenario)
    assert exact.content.options == {"ego_motion": "exact", "calibration": "exact"}


def test_paper_has_5000_images_at_0_to_50_kmh_in_at_least_100_recordings():
    paper = scenario("paper")
    (camera,) = paper.cameras
    assert (camera.name, camera.width, camera.height, paper.frame_rate_hz) == ("front", 640, 480, 15.0)
    assert len(paper.recordings) >= 100
    assert sum(spec.frames for spec in paper.recordings) == 5000
    trajectories = [plan_trajectories(paper, spec) for spec in paper.recordings]
    speeds_kmh = 3.6 * np.abs(np.concatenate([one.ego.signals(one.image_times_ns)[0] for one in trajectories]))
    assert speeds_kmh.min() == 0.0
    assert 45.0 < speeds_kmh.max() <= 50.0
    assert (np.histogram(speeds_kmh, bins=[0, 10, 20, 30, 40, 50])[0] >= 100).all()


def test_composition_of_the_paper_is_about_that_of_its_table():
    """Of the scored run: recordings, object-frames, and those of the paper, row by row."""
    table = (ROOT / "reports" / "paper" / "table.md").read_text()
    rows = re.findall(r"paper: (\d+) \| (\d+) \| (\d+) \|", table)
    published, recordings, cases = np.array(rows[:5], dtype=int).T
    assert published.tolist() == [3848, 2757, 789, 224, 475]
    assert cases == pytest.approx(published, rel=0.2)
    assert cases.sum() == pytest.approx(published.sum(), rel=0.15)
    assert (recordings >= 7).all()


def test_paper_has_every_light_place_and_special_case():
    specs = scenario("paper").recordings
    lights = Counter(spec.light.kind for spec in specs)
    assert lights.keys() == LIGHTS
    assert 0.04 <= lights["night"] / len(specs) <= 0.2
    assert {spec.street.kind for spec in specs} == {"street", "car_park", "avenue"}
    assert reverses_and_turns(specs)
    actors = [actor for spec in specs for actor in spec.actors]
    assert sum(actor.kind == "dog" for actor in actors) >= 4
    assert sum(BODIES[actor.kind][0] == "pedestrian" and actor.speed_mps == (0.0,) for actor in actors) >= 8
    overtaken = [spec for spec in specs if spec.name.startswith(("avenue", "fast-lane", "queue", "passed-in"))]
    assert {BODIES[actor.kind][0] for spec in overtaken for actor in spec.actors} == {"vehicle"}


def reverses_and_turns(specs):
    return any(s.host.gear == "reverse" for s in specs) and any(any(s.host.yaw_rate_degps) for s in specs)


def test_development_covers_every_light_on_dry_and_wet_roads():
    specs = scenario("development").recordings
    assert len(specs) >= 60
    assert {(spec.light.kind, spec.street.wet) for spec in specs} == set(product(LIGHTS, (False, True)))
    assert reverses_and_turns(specs)


def test_range_maps_reach_20_m_in_every_direction_for_every_class():
    maps = scenario("range-maps")
    assert {camera.name for camera in maps.cameras} == {"front", "rear", "left", "right"}
    for camera in maps.cameras:  # sees a part of the ego vehicle at its lower edge
        body = mounted_camera(camera).ego_body
        assert 0.05 < body.mean() < 0.32
        assert body[400:].mean() > 5 * body[:240].mean()
        assert not body[200:280, 300:340].any()
    assert 2000 <= sum(spec.frames for spec in maps.recordings) <= 2500
    for object_class, direction in product(("pedestrian", "cyclist", "vehicle"), ("lateral", "longitudinal")):
        specs = [spec for spec in maps.recordings if spec.name.startswith(f"{object_class}-{direction}")]
        places, velocities = (np.concatenate(part) for part in zip(*(_seen(maps, s) for s in specs), strict=True))
        sideways = np.abs(velocities[:, 1]) > np.abs(velocities[:, 0])
        assert (sideways == (direction == "lateral")).mean() > 0.95
        assert len(np.unique(np.floor(places), axis=0)) > 250
        assert (places.max(axis=0) > 14).all()
        assert (places.min(axis=0) < -14).all()


def _seen(maps, spec):
    """Places and velocities of all actors in the ego vehicle's frame, at every image."""
    trajectories = plan_trajectories(maps, spec)
    times_ns = trajectories.image_times_ns
    ego = trajectories.ego.at(times_ns)
    away = [path.at(times_ns).positions_m - ego.positions_m for path in trajectories.actors]
    places = [np.einsum("nji,nj->ni", ego.rotations, one)[:, :2] for one in away]
    return np.concatenate(places), np.concatenate([np.gradient(one, times_ns / 1e9, axis=0) for one in places])


def test_training_has_enough_short_drives_and_holds_some_out():
    training = scenario("training")
    assert len(training.recordings) >= 300
    assert {spec.frames for spec in training.recordings} == {4}
    assert len({(camera.model, camera.width, camera.height, camera.position_m) for camera in training.cameras}) == 8
    assert any(camera.rolling_shutter for camera in training.cameras)
    assert {spec.light.kind for spec in training.recordings} == LIGHTS
    held_out = load_card(ROOT / "datasets" / "training.yaml").content.splits["validation"]
    names = {spec.name for spec in training.recordings}
    assert len(held_out) >= 40
    assert set(held_out) < names
    assert {name.rpartition("-")[0] for name in held_out} == {name.rpartition("-")[0] for name in names}


def _body_colours(drives):
    """Of the first body of some drives: all surfaces that it is made of."""
    chosen = [(spec, spec.actors[0]) for spec in drives.recordings[::16] if spec.actors]
    bodies = [make_body(one.kind, named_rng(drives.seed, spec.name, "actor", one.name)) for spec, one in chosen]
    return {np.unique(body.mesh.surfaces, axis=0).tobytes() for body in bodies}


def _street_plans(drives, *, seeded=True):
    """Of some drives, as they are drawn for the renderer, or as any other seed draws them."""
    chosen = drives.recordings[::16]
    seeds = [named_rng(drives.seed, spec.name, "world").spawn(1)[0] if seeded else 0 for spec in chosen]
    return {repr(drawn_plan(spec.street, np.random.default_rng(k))) for spec, k in zip(chosen, seeds, strict=True)}


DRAWN = {
    "names": lambda drives: {spec.name for spec in drives.recordings},
    "drives": lambda drives: {spec.model_dump_json(exclude={"name", "about", "frames"}) for spec in drives.recordings},
    "lenses": lambda drives: {f"{camera.model} {sorted(camera.parameters.items())}" for camera in drives.cameras},
    "mountings": lambda drives: {(c.position_m, c.yaw_deg, c.pitch_down_deg) for c in drives.cameras},
    "body colours": _body_colours,
    "street plans": _street_plans,
}
SCORED = ("paper", "range-maps", "roads", "demo")


@pytest.mark.parametrize("drawn", DRAWN)
@pytest.mark.parametrize(("name", "others"), [("training", (*SCORED, "development", "tiny")), ("development", SCORED)])
def test_nothing_drawn_for_training_or_development_is_scored(drawn, name, others):
    own = DRAWN[drawn](scenario(name))
    for other in map(scenario, others):
        assert other.seed != scenario(name).seed
        shared = own & DRAWN[drawn](other)
        if other.name == "development":  # not scored, so a straight avenue that any seed draws may be in both
            shared -= _street_plans(other, seeded=False)
        assert not shared, other.name
