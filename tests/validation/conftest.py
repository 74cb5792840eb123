"""A clean drive, written once for all tests, and a copy of it that a test may damage."""

import shutil
from pathlib import Path

import pytest

from bench.synthesis import synthesize
from tests.validation import drive


@pytest.fixture(scope="session")
def clean(tmp_path_factory):
    return drive.write_drive(tmp_path_factory.mktemp("clean") / "drive")


@pytest.fixture
def root(clean, tmp_path):
    return shutil.copytree(clean, tmp_path / "drive")


@pytest.fixture(scope="session")
def turning(tmp_path_factory):
    """A rendered turn on an empty street."""
    folder = tmp_path_factory.mktemp("drives")
    synthesize(Path(__file__).with_name("turning.scenario.yaml"), folder / "data", workers=1)
    return folder / "data" / "turning"
