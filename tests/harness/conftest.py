"""A rendered data set that a test may damage."""

import shutil
from pathlib import Path

import pytest


@pytest.fixture
def own_card(tiny_card: Path, tmp_path: Path) -> Path:
    """The card of a copy of the small data set."""
    folder = shutil.copytree(tiny_card.parent, tmp_path / "datasets")
    return folder / tiny_card.name
