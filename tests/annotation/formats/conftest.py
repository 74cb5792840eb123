"""The drive that labels of these tests are of."""

import pytest

from tests.annotation.formats import street


@pytest.fixture
def drive(tmp_path):
    return street.recording(tmp_path / "drive")
