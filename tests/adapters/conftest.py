"""The real sample of aiMotive."""

from pathlib import Path

import pytest

from bench.recordings import load_card, open_dataset


@pytest.fixture
def real():
    (handle,) = open_dataset(load_card(Path(__file__).parents[2] / "datasets/aimotive-sample.yaml"))
    return handle.open()
