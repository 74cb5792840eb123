"""A stored run of the tiny data set, its page, and a real browser."""

from pathlib import Path

import pytest

from bench.reporting.run_page import write_page
from tests.conftest import made_once
from tests.support.browser import headless_chromium
from tests.support.runs import score


@pytest.fixture(scope="session")
def tiny_page(shared, tiny_card) -> Path:
    """The page of a run of the tiny data set, with its pictures."""

    def make(run: Path) -> None:
        score(tiny_card, run, settings={"threshold": 5e-4})
        _, problems = write_page(run)
        assert problems == ()

    return made_once(shared, "tiny-run", make) / "paper-v1" / "index.html"


@pytest.fixture(scope="session")
def tiny_run(tiny_page) -> Path:
    """That run; tests that change it copy it first."""
    return tiny_page.parents[1]


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    """Headless chromium."""
    opened = headless_chromium(tmp_path_factory.mktemp("chromium"))
    yield opened
    opened.quit()
