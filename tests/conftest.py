"""A small rendered data set that the tests of the upper packages share."""

import gc
import os
import shutil
import signal
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import settings
from typer.main import get_command

from bench.execution import local_executor
from bench.synthesis import synthesize

# CI repeats itself; at a desk every run tries new examples.
settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("desk", deadline=None)  # how long an example takes says more of the machine than of the code
settings.load_profile("ci" if os.environ.get("CI") else "desk")

DATASETS = Path(__file__).parents[1] / "datasets"

# A shell starts background jobs with SIGINT ignored, and so would be all processes that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    """Keep libraries and tests out of every later look for garbage, a tenth of the time of what runs here."""
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Commands that keep steps for later runs keep them here."""
    before = os.environ.get("FISHEYE_BENCH_CACHE")
    os.environ["FISHEYE_BENCH_CACHE"] = str(tmp_path_factory.mktemp("cache") / "steps")
    yield
    if before is None:
        del os.environ["FISHEYE_BENCH_CACHE"]
    else:
        os.environ["FISHEYE_BENCH_CACHE"] = before


@pytest.fixture(scope="session", autouse=True)
def _one_worker() -> Iterator[None]:
    """Commands that are called in this process start no others unless they are told to: that takes seconds."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("bench.cli.request.usable_cores", lambda: 1)
        patched.setattr("bench.cli.request.ProcessExecutor", lambda *, workers: local_executor(workers))
        yield


@pytest.fixture(scope="session", autouse=True)
def _one_tree_of_commands() -> Iterator[None]:
    """Commands that are called in this process build the tree of all commands once."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("typer.main.get_command", cache(get_command))
        yield


@pytest.fixture(scope="session")
def tiny_card(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The card of a rendered data set; tests that change files copy it first."""
    folder = tmp_path_factory.mktemp("datasets")
    for name in ("tiny.yaml", "tiny.scenario.yaml"):
        shutil.copy(DATASETS / name, folder)
    synthesize(folder / "tiny.scenario.yaml", folder / "data" / "tiny", workers=1)
    return folder / "tiny.yaml"
