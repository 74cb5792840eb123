from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.synthesis.scenario import DrawError, Sampler, SeriesSpec

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


def series(**changes: object) -> SeriesSpec:
    return SeriesSpec.model_validate({**TEMPLATE, **changes})


def sampler(index: int = 0, **values: object) -> Sampler:
    return Sampler(seed=7, series="s", index=index, count=5, values=values)


def test_same_seed_gives_the_same_recordings_in_any_order() -> None:
    forwards = [series().recording(k, seed=1)[0] for k in range(12)]
    backwards = [series().recording(k, seed=1)[0] for k in reversed(range(12))]
    assert forwards == backwards[::-1]
    assert len({str(one["host"]) for one in forwards}) == 12
    assert series().recording(0, seed=2)[0]["host"] != forwards[0]["host"]


def test_another_attempt_is_another_recording_of_the_same_name() -> None:
    first, second = (series().recording(3, seed=1, attempt=k)[0] for k in (0, 1))
    assert first["name"] == second["name"] == "passing-04"
    assert first["host"] != second["host"]


def test_a_draw_depends_on_its_own_line_alone() -> None:
    before = series().recording(3, seed=1)[0]
    others = [{"name": "new", "kind": "van", "position_m": [{"uniform": [20, 30]}, 0]}]
    after = series(count=13, actors=TEMPLATE["actors"] + others).recording(3, seed=1)[0]  # type: ignore[operator]
    assert after["host"] == before["host"]
    assert after["actors"][1:-1] == before["actors"][1:]
    assert after["actors"][0]["position_m"][0] == before["actors"][0]["position_m"][0]


def test_named_values_are_drawn_once() -> None:
    for k in range(12):
        one = series().recording(k, seed=1)[0]
        speed_mps, curvature = one["host"]["speed_kmh"][0] / 3.6, one["street"]["curvature_per_m"]
        yaw_radps = np.radians(one["host"]["yaw_rate_degps"][0])
        assert yaw_radps == pytest.approx(speed_mps * curvature, rel=1e-4)


def test_repeats_are_numbered_and_know_where_they_come_from() -> None:
    counts = set()
    for k in range(12):
        one, origins = series().recording(k, seed=1)
        names = [actor["name"] for actor in one["actors"]]
        assert names == ["car", *(f"walker-{n}" for n in range(1, len(names)))]
        assert origins == [0] + [1] * (len(names) - 1)
        places = [actor["position_m"][0] for actor in one["actors"][1:]]
        assert np.all(np.diff(places) > 0.9)
        counts.add(len(names))
    assert counts == {3, 4}


def test_steps_go_evenly_from_the_first_to_the_last() -> None:
    places = [series().recording(k, seed=1)[0]["actors"][0]["position_m"][1] for k in range(12)]
    assert places == pytest.approx(np.linspace(2.0, 4.2, 12), abs=1e-3)


@given(low=st.floats(-100, 100), width=st.floats(0, 100), path=st.text(max_size=5))
def test_uniform_stays_within_its_ends(low: float, width: float, path: str) -> None:
    value = sampler().drawn({"uniform": [low, low + width]}, path)
    assert low - 1e-4 <= value <= low + width + 1e-4


def test_every_choice_comes_about_equally_often() -> None:
    select = [sampler(k).drawn({"choice": ["a", "b", "c"]}, "x") for k in range(3000)]
    assert all(900 < select.count(name) < 1100 for name in "abc")


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
def test_what_is_no_draw_is_told_with_its_place(node: object, told: str) -> None:
    with pytest.raises(DrawError, match=told) as caught:
        sampler(speed=3).drawn({"host": [node]}, "here")
    assert caught.value.path.startswith("here.host.0")


def test_values_cannot_hold_themselves() -> None:
    with pytest.raises(DrawError, match="name under values"):
        sampler(a={"sum": [{"value": "b"}, 1]}, b={"value": "a"}).drawn({"value": "a"}, "x")


@pytest.mark.parametrize("repeat", [-1, 41, 1.5, True, "two"])
def test_repeat_is_a_sensible_number(repeat: object) -> None:
    with pytest.raises(DrawError, match="whole number"):
        series(actors=[{"name": "x", "repeat": repeat}]).recording(0, seed=1)
