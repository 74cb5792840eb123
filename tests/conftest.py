"""A rendered data set and a cache that all tests share, and what spares them time."""

import gc
import os
import shutil
import signal
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest
from _pytest.terminal import TerminalReporter
from hypothesis import settings
from markupsafe import Markup
from typer.main import get_command

from bench.atomic import folder_lock
from bench.execution import local_executor
from bench.reporting.document import Drawing
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


LONG_S = 2.0  # of processor time, of this process and those that it waited for
LONG = Path(__file__).with_name("long_tests.txt")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Measure the processor time of a test, which other work on the machine leaves as it is."""
    before = sum(os.times()[:4])
    yield
    item.user_properties.append(("processor_s", sum(os.times()[:4]) - before))


def pytest_terminal_summary(terminalreporter: TerminalReporter) -> None:
    """List tests that take long and are neither marked as slow nor named in `long_tests.txt`."""
    spent = {
        report.nodeid: dict(report.user_properties).get("processor_s", 0.0)
        for report in terminalreporter.getreports("passed")
        if report.when == "call" and "slow" not in report.keywords
    }
    named = LONG.read_text().splitlines()
    new = {test: spent_s for test, spent_s in spent.items() if spent_s > LONG_S and test.partition("[")[0] not in named}
    for test, spent_s in sorted(new.items(), key=lambda entry: -entry[1]):
        hint = f"split it, mark it as slow or name it in {LONG.name}"
        terminalreporter.write_line(f"{spent_s:.1f} s of processor time ({hint}): {test}")


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of this session that all its processes share; what lies in it is read only."""
    own = tmp_path_factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "shared"
    folder.mkdir(exist_ok=True)
    return folder


def made_once(shared: Path, name: str, make: Callable[[Path], object]) -> Path:
    """A folder that the first process that asks for it makes; the others wait."""
    folder, done = shared / name, shared / f"{name}.done"
    with folder_lock(shared):
        if not done.exists():
            make(folder)
            done.touch()
    return folder


@pytest.fixture(scope="session", autouse=True)
def _settings_of_the_session(shared: Path) -> Iterator[None]:
    """References are built once, outside of the user's cache; commands are given at a desk, and start no processes."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("FISHEYE_BENCH_CACHE", str(shared / "cache"))
        patched.delenv("GITHUB_STEP_SUMMARY", raising=False)
        patched.setattr("bench.commands.options.worker_processes", lambda count: local_executor(count or 1))
        patched.setattr("typer.main.get_command", cache(get_command))
        yield


@pytest.fixture(scope="session")
def tiny_card(shared: Path) -> Path:
    """The card of a rendered data set; tests that change files copy it first."""

    def make(folder: Path) -> None:
        folder.mkdir()
        for name in ("tiny.yaml", "tiny.scenario.yaml"):
            shutil.copy(DATASETS / name, folder)
        synthesize(folder / "tiny.scenario.yaml", folder / "data" / "tiny", workers=1)

    return made_once(shared, "datasets", make) / "tiny.yaml"


@pytest.fixture
def without_charts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages of this test show no chart, which takes most of their time."""
    monkeypatch.setattr("bench.reporting.figures.drawing", lambda name, *_: Drawing(Markup(f"chart {name}")))
    monkeypatch.setattr("bench.reporting.figures.write_picture", lambda *_, **__: ())
