"""A rendered data set that a test may damage, and a method that gets into trouble on it."""

import shutil
from pathlib import Path

import pytest
from troubled import FOLDER


@pytest.fixture
def own_card(tiny_card: Path, tmp_path: Path) -> Path:
    """The card of a copy of the small data set."""
    folder = shutil.copytree(tiny_card.parent, tmp_path / "datasets")
    return folder / tiny_card.name


@pytest.fixture
def trouble(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where files make trouble."""
    folder = tmp_path / "trouble"
    folder.mkdir()
    monkeypatch.setenv(FOLDER, str(folder))
    return folder
