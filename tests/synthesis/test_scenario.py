from __future__ import annotations

from pathlib import Path

import pytest

from bench.errors import DataError
from bench.recordings import load_card
from bench.synthesis import read_scenario
from tests.synthesis.conftest import MINIATURE

DATASETS = Path(__file__).parents[2] / "datasets"

WRONG = {
    "unknown kind": ("kind: adult", "kind: adlut", "recordings.0.actors.0.kind", "adult"),
    "negative speed": ("speed_mps: 1.4", "speed_mps: -1.4", "recordings.0.actors.0.speed_mps", "-1.4"),
    "negative ego speed": ("speed_kmh: [5]", "speed_kmh: [-5]", "recordings.1.host.speed_kmh.0", "-5"),
    "unknown key": ("gear: reverse", "gaer: reverse", "recordings.1.host.gaer", "no such key"),
    "unknown camera model": ("radial_polynomial", "radial_polynom", "cameras.0", "radial_polynomial"),
    "profile of another length": ("times_s: [0, 0.1]", "times_s: [0, 0.1, 0.2]", "recordings.0.host", "speed_kmh"),
    "times backwards": ("times_s: [0, 0.1]", "times_s: [0, -0.1]", "recordings.0.host", "increase"),
    "name twice": ("name: reversing", "name: crossing", "recordings", "crossing"),
    "name outside the folder": ("name: reversing", "name: ../reversing", "recordings.1.name", "../reversing"),
    "not a number": ("seed: 7", "seed: .nan", "seed", "nan"),
}


@pytest.mark.parametrize(("right", "wrong", "field", "told"), WRONG.values(), ids=WRONG.keys())
def test_fault_is_told_with_file_line_and_field(
    scenario_file: Path, right: str, wrong: str, field: str, told: str
) -> None:
    assert right in MINIATURE
    text = MINIATURE.replace(right, wrong, 1)
    scenario_file.write_text(text)
    with pytest.raises(DataError) as caught:
        read_scenario(scenario_file)
    message = str(caught.value)
    assert str(scenario_file) in message
    assert field in message
    assert told in message


def test_line_is_that_of_the_field(scenario_file: Path) -> None:
    scenario_file.write_text(MINIATURE.replace("gear: reverse", "gear: sideways"))
    line = next(k for k, text in enumerate(scenario_file.read_text().splitlines(), 1) if "sideways" in text)
    with pytest.raises(DataError, match=rf"yaml:{line}: recordings\.1\.host\.gear"):
        read_scenario(scenario_file)


@pytest.mark.parametrize("text", ["", "- 1", "a: [", "\x00"])
def test_other_files_are_refused(scenario_file: Path, text: str) -> None:
    scenario_file.write_text(text)
    with pytest.raises(DataError, match="miniature"):
        read_scenario(scenario_file)


def test_missing_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"none\.yaml"):
        read_scenario(tmp_path / "none.yaml")


def test_demo_is_a_scenario_with_a_card() -> None:
    card = load_card(DATASETS / "demo.yaml")
    assert card.scenario is not None
    scenario = read_scenario(card.scenario)
    assert 12 <= len(scenario.recordings) <= 20
    assert scenario.name == card.name
    assert scenario.licence == card.content.licence
