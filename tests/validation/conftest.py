"""A clean drive, written once for all tests, and a copy of it that a test may damage."""

import shutil

import pytest

from tests.validation import drive


@pytest.fixture(scope="session")
def clean(tmp_path_factory):
    return drive.write_drive(tmp_path_factory.mktemp("clean") / "drive")


@pytest.fixture
def root(clean, tmp_path):
    return shutil.copytree(clean, tmp_path / "drive")
