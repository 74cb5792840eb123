"""Drives that are made once for all tests, and a copy that a test may damage."""

import shutil
from pathlib import Path

import pytest

from bench.synthesis import synthesize
from tests.conftest import made_once
from tests.support.drive import MARGIN_M, write_drive


@pytest.fixture(scope="session")
def clean(shared):
    return made_once(shared, "clean", lambda folder: write_drive(folder / "drive", MARGIN_M)) / "drive"


@pytest.fixture
def root(clean, tmp_path):
    return shutil.copytree(clean, tmp_path / "drive")


@pytest.fixture(scope="session")
def turning(shared):
    """A rendered turn on an empty street."""
    scenario = Path(__file__).with_name("turning.scenario.yaml")
    return made_once(shared, "turning", lambda folder: synthesize(scenario, folder, workers=1)) / "turning"
