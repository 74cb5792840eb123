"""Commands of these tests are given at a desk."""

import pytest


@pytest.fixture(autouse=True)
def _at_a_desk(monkeypatch):
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)
