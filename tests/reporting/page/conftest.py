"""A stored run of the tiny data set, its page, and a real browser."""

from pathlib import Path

import pytest

from bench.evaluation import load_protocol
from bench.methods import build_method
from bench.recordings import load_card
from bench.reporting.page.build import write_page
from tests.reporting.page.hostile import hostile_run
from tests.support.browser import headless_chromium
from tests.support.runs import run_one


@pytest.fixture(scope="session")
def tiny_run(tiny_card, tmp_path_factory) -> Path:
    """A run of the tiny data set; tests that change it copy it first."""
    run = tmp_path_factory.mktemp("runs") / "tiny-run"
    method = build_method("spherical", {"threshold": 5e-4})
    run_one(card=load_card(tiny_card), method=method, protocol=load_protocol("paper-v1"), out=run)
    return run


@pytest.fixture(scope="session")
def tiny_page(tiny_run) -> Path:
    """The page of that run, with its pictures."""
    page = write_page(tiny_run)
    assert page.problems == ()
    return page.file


@pytest.fixture(scope="session")
def hostile_page(tiny_run, tmp_path_factory) -> Path:
    """A page of names that would break a careless one; without pictures."""
    return write_page(hostile_run(tiny_run, tmp_path_factory.mktemp("hostile")), pictures=False).file


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    """Headless chromium."""
    opened = headless_chromium(tmp_path_factory.mktemp("chromium"))
    yield opened
    opened.quit()
