"""Runs of the small data set with a method that gets into trouble."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from troubled import FOLDER, Troubled

from tests.support import runs
from tests.support.commands import called_here


def score(card: Path, out: Path, **options):
    return runs.score(card, out, **{"method": Troubled()} | options)


def command(card: Path, out: Path, *options: object) -> list[str]:
    words = ["run", card, "--out", out, "--method", "troubled:Troubled", "--no-pictures"]
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
