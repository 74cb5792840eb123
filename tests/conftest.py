"""A rendered data set and a cache that all tests share, and a list of the tests that take most processor time."""

import gc
import os
import resource
import shutil
import signal
from collections.abc import Callable, Generator, Iterator
from functools import cache
from pathlib import Path

import pytest
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


LIMIT_S = 2.0
ABOVE_THE_LIMIT = {  # tests that may take longer, and run with `make test` nevertheless
    "tests/commands/test_commands.py::test_report_writes_the_page_and_names_the_files",
    "tests/commands/test_commands.py::test_run_writes_the_report_and_ends_with_the_table",
    "tests/commands/test_evaluate.py::test_a_methods_masks_count_as_the_method_does",
    "tests/commands/test_new.py::test_a_new_data_set_validates_and_scores_as_it_is",
    "tests/commands/test_require_valid.py::test_clean_data_are_scored_and_the_run_says_so",
    "tests/commands/test_require_valid.py::test_errors_are_refused_before_anything_is_written",
    "tests/commands/test_sweep.py::test_each_value_is_the_run_with_it_in_a_folder_of_its_own",
    "tests/commands/test_validate.py::test_a_clean_data_set_exits_with_0",
    "tests/commands/test_verify.py::test_images_that_cannot_be_read_fail_again_and_caveats_are_those_of_the_data",
    "tests/harness/test_input_errors.py::test_a_run_with_errors_is_none_without",
    "tests/harness/test_stages.py::test_a_method_is_asked_once_for_any_number_of_protocols",
    "tests/methods/predictions/test_images.py::test_numbers_that_name_files_are_frame_numbers_unless_they_are_times",
    "tests/reporting/page/test_page.py::test_every_section_opens_with_a_sentence",
    "tests/validation/test_cameras.py::test_a_planted_fault_is_named",
    "tests/validation/test_faults.py::test_a_clean_recording_has_no_findings",
    "tests/validation/test_units.py::test_speed_and_yaw_rate_of_the_bus_are_tried_against_the_lidar",
}

RUNNING = pytest.StashKey[pytest.Item]()
STARTED_S = pytest.StashKey[float]()


def processor_time_s() -> float:
    """Processor time of this process and of those that it started and waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None]:
    item.config.stash[RUNNING] = item
    item.stash[STARTED_S] = processor_time_s()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef, request: pytest.FixtureRequest) -> Generator[None, object]:
    """Count what several tests share for itself, not for the test that asks first."""
    before = processor_time_s()
    try:
        return (yield)
    finally:
        if fixturedef.scope != "function":
            item, took = request.config.stash[RUNNING], processor_time_s() - before
            item.stash[STARTED_S] += took
            item.user_properties.append((f"fixture {fixturedef.argname} of ", took))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None]:
    try:
        return (yield)
    finally:
        item.user_properties.append(("", processor_time_s() - item.stash[STARTED_S]))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """List what takes most processor time, and the tests over the limit that nobody marked as slow."""
    reports = [*terminalreporter.getreports("passed"), *terminalreporter.getreports("failed")]
    costs = [
        (seconds, what, report)
        for report in reports
        if report.when == "call"
        for what, seconds in report.user_properties
    ]
    if len(costs) < 100 and not os.environ.get("CI"):  # who runs a file looks for something else
        return
    costs.sort(key=lambda cost: -cost[0])
    terminalreporter.section("ten slowest, processor time")
    for seconds, what, report in costs[:10]:
        terminalreporter.line(f"{seconds:6.2f} s  {what}{report.nodeid}")
    unmarked = [
        (seconds, report.nodeid)
        for seconds, what, report in costs
        if seconds > LIMIT_S
        and not (what or "slow" in report.keywords or report.nodeid.partition("[")[0] in ABOVE_THE_LIMIT)
    ]
    if unmarked:
        terminalreporter.section(f"above {LIMIT_S:g} s, neither marked slow nor listed in tests/conftest.py", red=True)
        for seconds, test in unmarked:
            terminalreporter.line(f"{seconds:6.2f} s  {test}", red=True)


def pytest_collection_finish() -> None:
    """Keep libraries and tests out of every later look for garbage, a tenth of the time of what runs here."""
    gc.freeze()


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
def _own_cache(shared: Path) -> Iterator[None]:
    """References are built once in a session, and nothing is left in the user's cache."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("FISHEYE_BENCH_CACHE", str(shared / "cache"))
        yield


@pytest.fixture(scope="session", autouse=True)
def _one_worker() -> Iterator[None]:
    """Commands that are called in this process start no others unless they are told to: that takes seconds."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("bench.commands.options.worker_processes", lambda count: local_executor(count or 1))
        yield


@pytest.fixture(scope="session", autouse=True)
def _one_tree_of_commands() -> Iterator[None]:
    """Commands that are called in this process build the tree of all commands once."""
    with pytest.MonkeyPatch.context() as patched:
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
    monkeypatch.setattr("bench.reporting.figures.Chart.drawing", lambda chart: Drawing(Markup(f"chart {chart.name}")))
    monkeypatch.setattr("bench.reporting.figures.write_picture", lambda *_, **__: ())
