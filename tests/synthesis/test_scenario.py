"""Scenario files: what is told of a fault, draws of a series, and bodies that overlap."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import DataError
from bench.synthesis import read_scenario
from bench.synthesis.ego import OUTLINE_M
from bench.synthesis.scenario import DrawError, Sampler, SeriesSpec
from bench.synthesis.scene import (
    MovingOutline,
    box_outline,
    box_size,
    first_clash,
    plan_trajectories,
    swept_ground,
    watched_times,
)
from tests.synthesis.conftest import MINIATURE

HEAD = MINIATURE.split("recordings:\n")[0]
SERIES = (
    HEAD
    + """
series:
  - name: drive
    count: 6
    frames: 10
    host: {speed_kmh: [{uniform: [5, 9]}]}
    actors:
      - {name: fixed, kind: adult, position_m: [8, 2]}
      - {name: drawn, kind: adult, position_m: [{uniform: [6, 9]}, 2]}
"""
)
PLACE = "[3.7, 0.0, 0.66]"
WRONG = [
    ({"kind: adult": "kind: adlut"}, "recordings.0.actors.0.kind", "adult"),
    ({"speed_mps: 1.4": "speed_mps: -1.4"}, "recordings.0.actors.0.speed_mps.0", "-1.4"),
    ({"gear: reverse": "gaer: reverse"}, "recordings.1.host.gaer", "no such key"),
    ({"radial_polynomial": "radial_polynom"}, "cameras.0", "radial_polynomial"),
    ({"times_s: [0, 0.1]": "times_s: [0, 0.1, 0.2]"}, "recordings.0.host", "each of the 3 of times_s"),
    ({"times_s: [0, 0.1]": "times_s: [0, -0.1]"}, "recordings.0.host", "increase"),
    ({"name: reversing": "name: crossing"}, "recordings", "crossing"),
    ({"name: reversing": "name: ../reversing"}, "recordings.1.name", "../reversing"),
    ({"seed: 7": "seed: .nan"}, "seed", "nan"),
    # The walker at 1.4 m/s and the car meet in the car's lane; a little later the walker is before the bumper.
    ({"[8, -1]": "[10, 2]", "frames: 2": "frames: 12"}, "recordings.0.actors.1", "'car' inside 'walker' at -0.07 s"),
    ({"[8, -1]": "[5, -2.5]", "frames: 2": "frames: 30"}, "recordings.0.actors.0", "'walker' inside the ego vehicle"),
    ({"[8, -1]": "[2, 0.5]"}, "recordings.0.actors.0", "inside the ego vehicle"),
    # A camera on a stalk three metres before the bumper, where the walker is.
    ({PLACE: "[6.5, 0.0, 0.66]", "[8, -1]": "[6.5, 0]"}, "recordings.0.actors.0", "'front' inside 'walker'"),
    ({PLACE: "[3.7, 0.0, -0.1]"}, "cameras.0.position_m", "under the road"),
    ({PLACE: "[1.5, 0.0, 0.6]"}, "cameras.0.position_m", "inside the ego vehicle's own body"),
]
WRONG_SERIES = [
    ({"drawn, kind: adult": "drawn, kind: adlut"}, "series.0.actors.1.kind", "adult"),
    ({"uniform: [5, 9]": "uniform: [-9, -5]"}, "series.0.host.speed_kmh.0", "greater than or equal to 0"),
    ({"uniform: [6, 9]": "uniform: [6]"}, "series.0.actors.1.position_m.0", "two numbers"),
    ({"count: 6": "count: 0"}, "series.0.count", "1"),
    ({"frames: 10": "cameras: [front, roof]"}, "series.0.cameras", "some of front"),
    ({"frames: 10": "freams: 10"}, "series.0.freams", "no such key"),
    ({"drawn, kind: adult": "drawn, kind: car"}, "series.0.actors.1", "space for all bodies in recording 1 of 6"),
    ({"drawn, kind: adult": "drawn, kind: car"}, "series.0.actors.1", "'drawn' inside 'fixed'"),
]


@pytest.mark.parametrize(
    ("right", "changes", "field", "told"),
    [*((MINIATURE, *wrong) for wrong in WRONG), *((SERIES, *wrong) for wrong in WRONG_SERIES)],
)
def test_fault_is_told_with_file_and_field(scenario_file, right, changes, field, told):
    text = right
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new, 1)
    scenario_file.write_text(text)
    with pytest.raises(DataError) as caught:
        read_scenario(scenario_file)
    assert str(caught.value).startswith(f"{scenario_file}: ")
    assert f"{field}: " in str(caught.value)
    assert told in str(caught.value)


def test_bodies_that_would_meet_only_later_are_no_fault(scenario_file):
    scenario_file.write_text(MINIATURE.replace("[8, -1]", "[5, -2.5]"))
    read_scenario(scenario_file)


@pytest.mark.parametrize("text", [None, "", "- 1", "a: [", "\x00"])
def test_other_files_are_refused(tmp_path, text):
    if text is not None:
        (tmp_path / "other.yaml").write_text(text)
    with pytest.raises(DataError, match=r"other\.yaml"):
        read_scenario(tmp_path / "other.yaml")


TEMPLATE = {
    "name": "passing",
    "count": 12,
    "frames": {"choice": [20, 40]},
    "values": {"speed": {"uniform": [10, 20]}, "bend": {"choice": [0.02, -0.05]}},
    "host": {
        "speed_kmh": [{"value": "speed"}],
        "yaw_rate_degps": [{"product": [{"value": "speed"}, {"value": "bend"}, 15.9155]}],
    },
    "street": {"curvature_per_m": {"value": "bend"}},
    "actors": [
        {"name": "car", "kind": "car", "position_m": [{"uniform": [9, 11]}, {"steps": [2.0, 4.2]}]},
        {
            "name": "walker",
            "repeat": {"choice": [2, 3]},
            "kind": {"choice": ["adult", "child"]},
            "position_m": [{"sum": [{"each": [5, 7, 9]}, {"uniform": [0, 1]}]}, -3],
        },
    ],
}


def series(**changes):
    return SeriesSpec.model_validate({**TEMPLATE, **changes})


def sampler(index=0, **values):
    return Sampler(seed=7, series="s", index=index, count=5, values=values)


def test_same_seed_gives_the_same_recordings_in_any_order():
    forwards = [series().recording(k, seed=1)[0] for k in range(12)]
    backwards = [series().recording(k, seed=1)[0] for k in reversed(range(12))]
    assert forwards == backwards[::-1]
    assert len({str(one["host"]) for one in forwards}) == 12
    assert series().recording(0, seed=2)[0]["host"] != forwards[0]["host"]
    again = series().recording(3, seed=1, attempt=1)[0]
    assert again["name"] == forwards[3]["name"] == "passing-04"
    assert again["host"] != forwards[3]["host"]


def test_a_draw_depends_on_its_own_line_alone():
    before = series().recording(3, seed=1)[0]
    others = [{"name": "new", "kind": "van", "position_m": [{"uniform": [20, 30]}, 0]}]
    after = series(count=13, actors=TEMPLATE["actors"] + others).recording(3, seed=1)[0]
    assert after["host"] == before["host"]
    assert after["actors"][1:-1] == before["actors"][1:]
    assert after["actors"][0]["position_m"][0] == before["actors"][0]["position_m"][0]


def test_named_values_are_drawn_once_steps_are_even_and_repeats_know_where_they_come_from():
    counts, steps = set(), []
    for k in range(12):
        one, origins = series().recording(k, seed=1)
        speed_mps, curvature = one["host"]["speed_kmh"][0] / 3.6, one["street"]["curvature_per_m"]
        assert np.radians(one["host"]["yaw_rate_degps"][0]) == pytest.approx(speed_mps * curvature, rel=1e-4)
        steps.append(one["actors"][0]["position_m"][1])
        names = [actor["name"] for actor in one["actors"]]
        assert names == ["car", *(f"walker-{n}" for n in range(1, len(names)))]
        assert origins == [0] + [1] * (len(names) - 1)
        places = [actor["position_m"][0] for actor in one["actors"][1:]]
        assert np.all(np.diff(places) > 0.9)
        counts.add(len(names))
    assert counts == {3, 4}
    assert steps == pytest.approx(np.linspace(2.0, 4.2, 12), abs=1e-3)


@given(low=st.floats(-100, 100), width=st.floats(0, 100), path=st.text(max_size=5))
def test_uniform_stays_within_its_ends(low, width, path):
    value = sampler().drawn({"uniform": [low, low + width]}, path)
    assert low - 1e-4 <= value <= low + width + 1e-4


@pytest.mark.parametrize(
    ("node", "told"),
    [
        ({"uniform": [1]}, "two numbers"),
        ({"uniform": 3}, "two numbers"),
        ({"uniform": ["a", "b"]}, "a number"),
        ({"choice": []}, "at least one"),
        ({"value": "sped"}, "speed"),
        ({"sum": [1, "x"]}, "a number"),
        ({"each": [1, 2]}, "repeats"),
        ({"product": [True, 2]}, "a number"),
    ],
)
def test_what_is_no_draw_is_told_with_its_place(node, told):
    with pytest.raises(DrawError, match=told) as caught:
        sampler(speed=3).drawn({"host": [node]}, "here")
    assert caught.value.path.startswith("here.host.0")


def test_values_cannot_hold_themselves():
    with pytest.raises(DrawError, match="name under values"):
        sampler(a={"sum": [{"value": "b"}, 1]}, b={"value": "a"}).drawn({"value": "a"}, "x")


@pytest.mark.parametrize("repeat", [-1, 41, 1.5, True, "two"])
def test_repeat_is_a_sensible_number(repeat):
    with pytest.raises(DrawError, match="whole number"):
        series(actors=[{"name": "x", "repeat": repeat}]).recording(0, seed=1)


def test_series_is_drawn_again_until_everybody_has_a_place(scenario_file):
    scenario_file.write_text(SERIES)
    scenario = read_scenario(scenario_file)
    assert [spec.name for spec in scenario.recordings] == [f"drive-0{k}" for k in range(1, 7)]
    assert all(first_clash(scenario, spec) is None for spec in scenario.recordings)
    apart = [abs(spec.actors[1].position_m[0] - spec.actors[0].position_m[0]) for spec in scenario.recordings]
    assert min(apart) > 0.5
    assert read_scenario(scenario_file) == scenario


def test_swept_ground_holds_every_footprint(scenario_file):
    scenario = read_scenario(scenario_file)
    spec = scenario.recordings[0]
    trajectories = plan_trajectories(scenario, spec)
    sizes = [box_size(actor.kind) for actor in spec.actors]
    grounds = swept_ground(trajectories, sizes)
    assert len(grounds) == 1 + len(spec.actors)
    fine = np.arange(watched_times(trajectories)[0], watched_times(trajectories)[-1], 7_000_000, dtype=np.int64)
    outlines_m = [OUTLINE_M, *map(box_outline, sizes)]
    for ground, path, outline_m in zip(grounds, (trajectories.ego, *trajectories.actors), outlines_m, strict=True):
        footprints = MovingOutline(poses=path.at(fine), outline_m=outline_m).footprints()
        assert shapely.contains(ground, footprints).all()
    outline_m = box_outline(np.array([0.8, 0.5, 1.7]))
    (walker,) = MovingOutline(poses=trajectories.actors[0].at([0]), outline_m=outline_m).footprints()
    # Walks to the left from (8, -1): its length lies across the ego vehicle's lane.
    assert shapely.bounds(walker) == pytest.approx([7.75, -1.4, 8.25, -0.6])
