"""A tiny recording on disk."""

import pytest

from tests.support.tiny import write_recording


@pytest.fixture
def root(tmp_path):
    return write_recording(tmp_path / "drive")
