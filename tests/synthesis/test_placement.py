from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import shapely

from bench.errors import DataError
from bench.synthesis import read_scenario
from bench.synthesis.ego import OUTLINE_M
from bench.synthesis.scene import (
    box_outline,
    box_size,
    first_clash,
    footprints,
    plan_trajectories,
    swept_ground,
    watched_times,
)
from tests.synthesis.conftest import MINIATURE

HEAD = MINIATURE.split("recordings:\n")[0]
SERIES = """
series:
  - name: drive
    count: 6
    frames: 10
    host: {speed_kmh: [{uniform: [5, 9]}]}
    actors:
      - {name: fixed, kind: adult, position_m: [8, 2]}
      - name: drawn
        kind: PLACED
        position_m: [{uniform: [FROM, 9]}, 2]
"""


def fails(scenario_file: Path, text: str) -> tuple[int, str, str]:
    """Line, what stands in it, and message of the fault."""
    scenario_file.write_text(text)
    with pytest.raises(DataError) as caught:
        read_scenario(scenario_file)
    found = re.match(rf"{re.escape(str(scenario_file))}:(\d+): ", str(caught.value))
    assert found is not None, str(caught.value)
    return int(found[1]), text.splitlines()[int(found[1]) - 1], str(caught.value)


def test_body_inside_another_is_told_with_line_names_and_time(scenario_file: Path) -> None:
    # The walker at 1.4 m/s and the car meet in the car's lane after half a second.
    text = MINIATURE.replace("position_m: [8, -1]", "position_m: [10, 2]").replace("frames: 2", "frames: 12", 1)
    _, line, message = fails(scenario_file, text)
    assert "name: car" in line
    assert "'car' inside 'walker'" in message
    assert " s" in message


def test_bodies_that_meet_only_later_are_found(scenario_file: Path) -> None:
    near = MINIATURE.replace("position_m: [8, -1]", "position_m: [5, -2.5]")
    scenario_file.write_text(near)
    read_scenario(scenario_file)
    _, line, message = fails(scenario_file, near.replace("frames: 2", "frames: 30", 1))
    assert "walker" in line
    assert "'walker' inside the ego vehicle" in message


def test_body_inside_the_ego_vehicle(scenario_file: Path) -> None:
    _, line, message = fails(scenario_file, MINIATURE.replace("position_m: [8, -1]", "position_m: [2, 0.5]"))
    assert "walker" in line
    assert "inside the ego vehicle" in message


def test_camera_inside_an_actor(scenario_file: Path) -> None:
    # A camera on a stalk three metres before the bumper, where the walker is.
    text = MINIATURE.replace("position_m: [3.7, 0.0, 0.66]", "position_m: [6.5, 0.0, 0.66]").replace(
        "position_m: [8, -1]", "position_m: [6.5, 0]"
    )
    _, line, message = fails(scenario_file, text)
    assert "walker" in line
    assert "the camera 'front' inside 'walker'" in message


@pytest.mark.parametrize(
    ("place", "told"),
    [("[3.7, 0.0, -0.1]", "under the road"), ("[1.5, 0.0, 0.6]", "inside the ego vehicle's own body")],
)
def test_camera_in_an_impossible_place(scenario_file: Path, place: str, told: str) -> None:
    _, line, message = fails(scenario_file, MINIATURE.replace("[3.7, 0.0, 0.66]", place))
    assert "position_m" in line
    assert place in line
    assert told in message


def test_series_is_drawn_again_until_everybody_has_a_place(scenario_file: Path) -> None:
    scenario_file.write_text(HEAD + SERIES.replace("FROM", "6").replace("PLACED", "adult"))
    scenario = read_scenario(scenario_file)
    assert [spec.name for spec in scenario.recordings] == [f"drive-0{k}" for k in range(1, 7)]
    assert all(first_clash(scenario, spec) is None for spec in scenario.recordings)
    apart = [abs(spec.actors[1].position_m[0] - spec.actors[0].position_m[0]) for spec in scenario.recordings]
    assert min(apart) > 0.5
    assert read_scenario(scenario_file) == scenario


def test_series_without_room_is_told_with_line_and_what_collides(scenario_file: Path) -> None:
    _, line, message = fails(scenario_file, HEAD + SERIES.replace("FROM", "7").replace("PLACED", "car"))
    assert "name: drawn" in line
    assert "'drawn' inside 'fixed'" in message
    assert "space for all bodies in recording 1 of 6" in message


@pytest.mark.parametrize(
    ("right", "wrong", "at", "told"),
    [
        ("kind: PLACED", "kind: adlut", "kind: adlut", "adult"),
        ("uniform: [5, 9]", "uniform: [-9, -5]", "speed_kmh", "greater than or equal to 0"),
        ("uniform: [FROM, 9]", "uniform: [6]", "uniform: [6]", "two numbers"),
        ("count: 6", "count: 0", "count: 0", "1"),
        ("frames: 10", "freams: 10", "freams", "no such key"),
        ("kind: PLACED", "kind: {choice: [adlut]}", "choice: [adlut]", "adult"),
    ],
)
def test_faults_of_a_series_are_told_with_their_line(
    scenario_file: Path, right: str, wrong: str, at: str, told: str
) -> None:
    assert right in SERIES
    text = HEAD + SERIES.replace(right, wrong).replace("FROM", "6").replace("PLACED", "adult")
    _, line, message = fails(scenario_file, text)
    assert at in line
    assert told in message


def test_swept_ground_holds_every_footprint(scenario_file: Path) -> None:
    scenario = read_scenario(scenario_file)
    spec = scenario.recordings[0]
    trajectories = plan_trajectories(scenario, spec)
    sizes = [box_size(actor.kind) for actor in spec.actors]
    grounds = swept_ground(trajectories, sizes)
    assert len(grounds) == 1 + len(spec.actors)
    fine = np.arange(watched_times(trajectories)[0], watched_times(trajectories)[-1], 7_000_000, dtype=np.int64)
    rows = [footprints(trajectories.ego.at(fine), OUTLINE_M)]
    rows += [footprints(way.at(fine), box_outline(size)) for way, size in zip(trajectories.actors, sizes, strict=True)]
    for ground, row in zip(grounds, rows, strict=True):
        assert shapely.contains(ground, row).all()


def test_footprint_is_the_outline_where_the_body_is(scenario_file: Path) -> None:
    scenario = read_scenario(scenario_file)
    trajectories = plan_trajectories(scenario, scenario.recordings[0])
    walker = footprints(trajectories.actors[0].at([0]), box_outline(np.array([0.8, 0.5, 1.7])))[0]
    # Walks to the left from (8, -1): its length lies across the ego vehicle's lane.
    assert shapely.bounds(walker) == pytest.approx([7.75, -1.4, 8.25, -0.6])
