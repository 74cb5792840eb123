"""Fixtures of these tests: those of all tests, and a small drive to plant mistakes into."""

import pytest

from tests.conftest import _settings_of_the_session, made_once, shared, tiny_card  # noqa: F401
from tests.support.drive import MARGIN_M, write_drive


@pytest.fixture(scope="session")
def clean(shared):  # noqa: F811
    return made_once(shared, "clean", lambda folder: write_drive(folder / "drive", MARGIN_M)) / "drive"
