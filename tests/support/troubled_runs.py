"""Runs of the small data set with a method that gets into trouble."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from troubled import FOLDER, Troubled

from bench.harness.cache import CacheFolder
from bench.recordings import load_card
from tests.support.commands import called_here
from tests.support.runs import PAPER, run_one


def score(card: Path, out: Path, *, method=None, cache=None, **options):
    kept = None if cache is None else CacheFolder(folder=cache)
    return run_one(
        card=load_card(str(card)), method=method or Troubled(), protocol=PAPER, out=out, cache=kept, **options
    )


def command(card: Path, out: Path, *options: object) -> list[str]:
    words = ["run", card, "--out", out, "--method", "troubled:Troubled", "--no-pictures", "--no-cache"]
    return [sys.executable, "-m", "bench", *map(str, [*words, *options])]


def call(card: Path, out: Path, *options: object) -> subprocess.CompletedProcess[str]:
    """The same command in this process; its workers are processes of their own."""
    _, _, _, *words = command(card, out, *options)
    return called_here(*words)


def environment() -> dict[str, str]:
    root = Path(__file__).parents[2]
    return os.environ | {"PYTHONPATH": f"{root / 'tests/plug_ins'}{os.pathsep}{root}", "COLUMNS": "1000"}


@pytest.fixture(scope="module")
def calm(tiny_card, tmp_path_factory) -> Path:
    """A run of the small data set on which nothing happens."""
    folder = tmp_path_factory.mktemp("calm")
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(FOLDER, str(folder))
        score(tiny_card, folder / "run")
    return folder / "run"
