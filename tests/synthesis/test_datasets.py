"""The rendered data sets hold what they are meant to hold; told from their geometry, before anything is rendered."""

from __future__ import annotations

from collections import Counter
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from bench.recordings import load_card
from bench.synthesis import Scenario, read_scenario
from bench.synthesis.bodies import BODIES, make_body
from bench.synthesis.scenario import named_rng
from bench.synthesis.scene import plan_trajectories
from bench.synthesis.world.plan import drawn_plan
from tests.synthesis.composition import object_frames

DATASETS = Path(__file__).parents[2] / "datasets"
# Object-frames by row of the paper's table.
PUBLISHED = {"crossing": 3848, "overtaking": 2757, "preceding": 789, "approaching": 224, "static_ego": 475}


@pytest.fixture(scope="module")
def paper() -> Scenario:
    return read_scenario(DATASETS / "paper.scenario.yaml")


@pytest.fixture(scope="module")
def range_maps() -> Scenario:
    return read_scenario(DATASETS / "range-maps.scenario.yaml")


@pytest.fixture(scope="module")
def development() -> Scenario:
    return read_scenario(DATASETS / "development.scenario.yaml")


@pytest.fixture(scope="module")
def training() -> Scenario:
    return read_scenario(DATASETS / "training.scenario.yaml")


def test_both_cards_of_the_paper_read_the_same_recordings() -> None:
    recorded, exact = (load_card(DATASETS / f"{name}.yaml") for name in ("paper", "paper-exact"))
    assert (recorded.root, recorded.scenario) == (exact.root, exact.scenario)
    assert exact.content.options == {"ego_motion": "exact", "calibration": "exact"}


def test_paper_has_5000_images_in_at_least_100_recordings(paper: Scenario) -> None:
    assert [camera.name for camera in paper.cameras] == ["front"]
    assert (paper.cameras[0].width, paper.cameras[0].height, paper.frame_rate_hz) == (640, 480, 15.0)
    assert len(paper.recordings) >= 100
    assert sum(spec.frames for spec in paper.recordings) == 5000


def test_ego_vehicle_of_the_paper_drives_0_to_50_kmh(paper: Scenario) -> None:
    speeds_kmh = np.concatenate(
        [
            3.6 * np.abs((trajectories := plan_trajectories(paper, spec)).ego.signals(trajectories.image_times_ns)[0])
            for spec in paper.recordings
        ]
    )
    assert speeds_kmh.min() == 0.0
    assert 45.0 < speeds_kmh.max() <= 50.0
    # Every bin of 10 km/h is driven in.
    assert (np.histogram(speeds_kmh, bins=[0, 10, 20, 30, 40, 50])[0] >= 100).all()


def test_composition_of_the_paper_is_about_that_of_its_table(paper: Scenario) -> None:
    found = object_frames(paper, every=8)
    total: Counter[str] = sum(found.values(), Counter())
    assert total.total() == pytest.approx(sum(PUBLISHED.values()), rel=0.15)
    for category, published in PUBLISHED.items():
        assert total[category] >= 200, category
        assert total[category] == pytest.approx(published, rel=0.2), category
        assert sum(1 for counts in found.values() if counts[category]) >= 7, f"{category} in too few recordings"


def test_only_vehicles_overtake_in_the_paper(paper: Scenario) -> None:
    for spec in paper.recordings:
        if spec.name.startswith(("avenue", "fast-lane", "queue", "passed-in")):
            assert {BODIES[actor.kind][0] for actor in spec.actors} == {"vehicle"}, spec.name


def test_paper_has_every_light_place_and_special_case(paper: Scenario) -> None:
    lights = Counter(spec.light.kind for spec in paper.recordings)
    assert lights.keys() == {"sunny", "overcast", "low_sun", "night"}
    assert 0.04 <= lights["night"] / len(paper.recordings) <= 0.2
    assert {spec.street.kind for spec in paper.recordings} == {"street", "car_park", "avenue"}
    assert any(spec.host.gear == "reverse" for spec in paper.recordings)
    assert any(any(spec.host.yaw_rate_degps) for spec in paper.recordings)
    kinds = Counter(actor.kind for spec in paper.recordings for actor in spec.actors)
    assert kinds["dog"] >= 4
    standing = [a for spec in paper.recordings for a in spec.actors if a.speed_mps == 0.0]
    assert sum(BODIES[actor.kind][0] == "pedestrian" for actor in standing) >= 8


def test_development_shares_no_seed_lens_or_drive_with_what_is_scored(
    development: Scenario, paper: Scenario, range_maps: Scenario
) -> None:
    """Every body, street and light follows from the seed and the recording's name; both are others."""
    own = development.cameras[0]
    names = {spec.name for spec in development.recordings}
    drives = [spec.model_dump(exclude={"name", "about", "frames"}) for spec in development.recordings]
    for scored in (read_scenario(DATASETS / "demo.scenario.yaml"), paper, range_maps):
        assert development.seed != scored.seed
        assert not names & {spec.name for spec in scored.recordings}
        assert not any(s.model_dump(exclude={"name", "about", "frames"}) in drives for s in scored.recordings)
        for camera in scored.cameras:
            assert own.model != camera.model
            assert own.position_m != camera.position_m
            assert own.pitch_down_deg != camera.pitch_down_deg


def test_development_covers_every_row_and_every_light_on_dry_and_wet_roads(development: Scenario) -> None:
    assert len(development.recordings) >= 60
    found = object_frames(development, every=24)  # the middle of each
    for category in PUBLISHED:
        assert sum(1 for counts in found.values() if counts[category]) >= 6, category
    assert sum(1 for counts in found.values() if not counts) >= 4
    seen = {(spec.light.kind, spec.street.wet) for spec in development.recordings}
    assert seen == set(product(("sunny", "overcast", "low_sun", "night"), (False, True)))
    assert any(spec.host.gear == "reverse" for spec in development.recordings)
    assert any(any(spec.host.yaw_rate_degps) for spec in development.recordings)


def test_range_maps_have_four_cameras_and_few_enough_images(range_maps: Scenario) -> None:
    assert {camera.name for camera in range_maps.cameras} == {"front", "rear", "left", "right"}
    assert 2000 <= sum(spec.frames for spec in range_maps.recordings) <= 2500


def test_range_maps_reach_20_m_in_every_direction_for_every_class(range_maps: Scenario) -> None:
    for object_class in ("pedestrian", "cyclist", "vehicle"):
        for direction, lateral in (("lateral", True), ("longitudinal", False)):
            specs = [s for s in range_maps.recordings if s.name.startswith(f"{object_class}-{direction}")]
            places, relative = _seen_from_the_ego_vehicle(range_maps, specs)
            sideways = np.abs(relative[:, 1]) > np.abs(relative[:, 0])
            assert (sideways if lateral else ~sideways).mean() > 0.95, (object_class, direction)
            cells = np.unique(np.floor(places), axis=0)
            assert len(cells) > 250, (object_class, direction)
            for axis in (0, 1):
                assert places[:, axis].max() > 14, (object_class, direction, axis)
                assert places[:, axis].min() < -14, (object_class, direction, axis)


def _seen_from_the_ego_vehicle(scenario: Scenario, specs: list) -> tuple[np.ndarray, np.ndarray]:
    """Places and velocities of all actors in the ego vehicle's frame, at every image."""
    places, velocities = [], []
    for spec in specs:
        trajectories = plan_trajectories(scenario, spec)
        ego = trajectories.ego.at(trajectories.image_times_ns)
        for way in trajectories.actors:
            away = way.at(trajectories.image_times_ns).positions_m - ego.positions_m
            places.append(np.einsum("nji,nj->ni", ego.rotations, away)[:, :2])
            velocities.append(np.gradient(places[-1], trajectories.image_times_ns / 1e9, axis=0))
    return np.concatenate(places), np.concatenate(velocities)


def test_training_has_enough_short_drives_and_holds_some_out(training: Scenario) -> None:
    assert len(training.recordings) >= 300
    assert {spec.frames for spec in training.recordings} == {4}
    assert len({(camera.model, camera.width, camera.height, camera.position_m) for camera in training.cameras}) == 6
    assert any(camera.rolling_shutter for camera in training.cameras)
    assert {spec.light.kind for spec in training.recordings} == {"sunny", "overcast", "low_sun", "night"}
    held_out = load_card(DATASETS / "training.yaml").content.splits["validation"]
    names = {spec.name for spec in training.recordings}
    assert len(held_out) >= 40
    assert set(held_out) < names
    assert {name.rpartition("-")[0] for name in held_out} == {name.rpartition("-")[0] for name in names}


def test_training_shares_nothing_drawn_with_what_is_scored(
    training: Scenario, paper: Scenario, range_maps: Scenario, development: Scenario
) -> None:
    demo, tiny = (read_scenario(DATASETS / f"{name}.scenario.yaml") for name in ("demo", "tiny"))
    for drawn in (_names, _lenses, _mountings, _body_colours, _street_plans):
        learned = drawn(training)
        for other in (paper, range_maps, development, demo, tiny):
            assert other.seed != training.seed
            assert not learned & drawn(other), f"{drawn.__name__} of {other.name}"


def _names(scenario: Scenario) -> set[str]:
    return {spec.name for spec in scenario.recordings}


def _lenses(scenario: Scenario) -> set[str]:
    return {f"{camera.model} {sorted(camera.parameters.items())}" for camera in scenario.cameras}


def _mountings(scenario: Scenario) -> set[tuple[object, ...]]:
    return {(camera.position_m, camera.yaw_deg, camera.pitch_down_deg) for camera in scenario.cameras}


def _body_colours(scenario: Scenario) -> set[bytes]:
    """Of the first body of some drives: all surfaces that it is made of."""
    chosen = [(spec, spec.actors[0]) for spec in scenario.recordings[::16] if spec.actors]
    bodies = [make_body(one.kind, named_rng(scenario.seed, spec.name, "actor", one.name)) for spec, one in chosen]
    return {np.unique(body.mesh.surfaces, axis=0).tobytes() for body in bodies}


def _street_plans(scenario: Scenario) -> set[str]:
    """Of some drives, as they are drawn for the renderer."""
    chosen = scenario.recordings[::16]
    worlds = [named_rng(scenario.seed, spec.name, "world").spawn(1)[0] for spec in chosen]
    return {repr(drawn_plan(spec.street, rng)) for spec, rng in zip(chosen, worlds, strict=True)}
