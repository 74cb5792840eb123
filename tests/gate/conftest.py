"""A rendered data set on which regressions show, and runs of it."""

import shutil
from pathlib import Path

import pytest

from bench.methods import Method
from bench.synthesis import synthesize
from tests.conftest import made_once
from tests.support.runs import score


@pytest.fixture(scope="session")
def gated_card(shared: Path) -> Path:
    def make(folder: Path) -> None:
        folder.mkdir()
        for name in ("gated.scenario.yaml", "gated.yaml"):
            shutil.copy(Path(__file__).with_name(name), folder)
        synthesize(folder / "gated.scenario.yaml", folder / "data" / "gated", workers=1)

    return made_once(shared, "gated", make) / "gated.yaml"


def run(card: Path, out: Path, method: Method | str = "spherical") -> Path:
    score(card, out, method=method)
    return out


@pytest.fixture(scope="session")
def good_run(gated_card: Path, shared: Path) -> Path:
    return made_once(shared, "good-run", lambda folder: run(gated_card, folder))
