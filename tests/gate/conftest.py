"""A rendered data set on which regressions show, and runs of it."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from bench.evaluation import load_protocol
from bench.methods import Method, build_method
from bench.recordings import load_card
from bench.synthesis import synthesize
from tests.conftest import made_once
from tests.support.runs import run_one

Run = Callable[[Method, Path], Path]


@pytest.fixture(scope="session")
def gated_card(shared: Path) -> Path:
    def make(folder: Path) -> None:
        folder.mkdir()
        for name in ("gated.scenario.yaml", "gated.yaml"):
            shutil.copy(Path(__file__).with_name(name), folder)
        synthesize(folder / "gated.scenario.yaml", folder / "data" / "gated", workers=1)

    return made_once(shared, "gated", make) / "gated.yaml"


def run(card: Path, out: Path, method: Method | None = None) -> Path:
    chosen = method or build_method("spherical")
    run_one(card=load_card(str(card)), method=chosen, protocol=load_protocol("paper-v1"), out=out)
    return out


@pytest.fixture(scope="session")
def good_run(gated_card: Path, shared: Path) -> Path:
    return made_once(shared, "good-run", lambda folder: run(gated_card, folder))
