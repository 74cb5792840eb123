"""An executor gives every task back once, whatever becomes of the process that works on it."""

import os
import signal
import subprocess
import sys
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, suppress
from functools import partial
from pathlib import Path

import pytest
from distributed import LocalCluster

from bench.errors import DataError
from bench.execution import FailedTask, ProcessExecutor, SerialExecutor, dask_executor
from tests.execution import jobs
from tests.support.processes import PATIENCE_S, alive, group_lives, pids, until

pytestmark = pytest.mark.slow

NUMBERS = list(range(7))
SQUARES = {number: number * number for number in NUMBERS}
EXECUTORS = {"serial": SerialExecutor(), "one process": ProcessExecutor(workers=1), "two": ProcessExecutor(workers=2)}
every_executor = pytest.mark.parametrize("name", EXECUTORS)


@every_executor
def test_every_task_comes_back_once(name):
    done = list(EXECUTORS[name].compute(jobs.squared, NUMBERS))
    assert sorted(task for task, _ in done) == NUMBERS
    assert dict(done) == SQUARES
    assert list(EXECUTORS[name].compute(jobs.squared, [])) == []


@pytest.mark.parametrize("workers", [1, 2])
def test_a_pool_that_breaks_between_a_result_and_the_next_task_loses_none(monkeypatch, workers):
    pools = []

    class Pool:
        def __init__(self, _):
            self.submitted = 0
            pools.append(self)

        def submit(self, function, task):
            self.submitted += 1
            if self.submitted == workers + 1 and len(pools) < 3:
                raise BrokenProcessPool("a worker has ended")
            future = Future()
            future.set_result(function(task))
            return future

        def end(self):
            pass

    monkeypatch.setattr("bench.execution._Pool", Pool)
    done = list(ProcessExecutor(workers=workers).compute(jobs.squared, NUMBERS))
    assert sorted(task for task, _ in done) == NUMBERS
    assert dict(done) == SQUARES
    assert len(pools) == 3


@every_executor
def test_what_the_work_raises_is_raised(name):
    with pytest.raises(ValueError, match="three") as raised:
        list(EXECUTORS[name].compute(jobs.fail, NUMBERS))
    if name != "serial":
        assert "jobs.py" in str(raised.value.__cause__), "where in the worker it arose"


def test_a_task_that_leaves_does_not_end_this_process():
    with pytest.raises(RuntimeError, match=r"sys.exit\(7\)"):
        list(ProcessExecutor(workers=1).compute(jobs.leave, [1]))


def test_a_task_whose_process_is_killed_is_computed_again(tmp_path):
    done = dict(ProcessExecutor(workers=2).compute(partial(jobs.squared_at_the_second_attempt, tmp_path), NUMBERS))
    assert done == SQUARES
    assert len(set(pids(tmp_path / "attempts"))) == 2


@pytest.mark.parametrize("end", ["SIGSEGV", "status 7"])
def test_a_task_that_always_ends_its_process_fails_and_the_others_are_done(tmp_path, end):
    done = dict(ProcessExecutor(workers=2).compute(partial(jobs.squared_but_for_three, tmp_path, end), NUMBERS))
    failed = done.pop(3)
    assert isinstance(failed, FailedTask)
    assert failed.reason.startswith("its worker ended without a result, as when memory runs out or a library crashes")
    assert done == {number: square for number, square in SQUARES.items() if number != 3}
    assert len(set(pids(tmp_path / "attempts"))) == 2, "at the second attempt it is alone"


def test_closing_ends_the_processes_even_those_that_do_not_listen(tmp_path):
    here = tmp_path / "processes"
    executor = ProcessExecutor(workers=2)
    with closing(executor.compute(partial(_stay_after_the_first, tmp_path), [0, 1, 2])) as results:
        assert next(results) == (0, 0)
        until(lambda: len(pids(here)) == 2, "both processes at work")
    assert not any(alive(pid) for pid in pids(here))


def _stay_after_the_first(folder, number):
    return jobs.stay(folder, number) if number else 0


def test_processes_stay_from_one_call_to_the_next_only_inside_the_block(tmp_path):
    executor = ProcessExecutor(workers=2)
    with executor:
        first = {pid for _, pid in executor.compute(partial(jobs.wait_for_both, tmp_path), [1, 2])}
        second = {pid for _, pid in executor.compute(jobs.own_process, NUMBERS)}
        assert len(first) == 2
        assert second <= first
        assert all(alive(pid) for pid in first)
    assert not any(alive(pid) for pid in first)
    assert dict(SerialExecutor().compute(jobs.own_process, [1])) == {1: os.getpid()}


def test_processes_that_are_killed_while_they_have_nothing_to_do_are_replaced(tmp_path):
    executor = ProcessExecutor(workers=2)
    with executor:
        for _, pid in list(executor.compute(partial(jobs.wait_for_both, tmp_path), [1, 2])):
            os.kill(pid, signal.SIGKILL)
        assert dict(executor.compute(jobs.squared, NUMBERS)) == SQUARES


def test_a_pool_that_a_task_leaves_open_keeps_nobody_waiting(tmp_path):
    body = "assert dict(ProcessExecutor(workers=1).compute(jobs.square_in_a_pool, [3])) == {3: 9}"
    program = started(tmp_path, body)
    try:
        assert program.wait(PATIENCE_S) == 0
    finally:
        with suppress(ProcessLookupError):
            os.killpg(program.pid, signal.SIGKILL)
        program.communicate()


def test_a_dask_cluster_computes_the_same(monkeypatch):
    with LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0") as cluster:
        executor = dask_executor(cluster.scheduler_address)
        assert executor.workers == 1
        assert dict(executor.compute(jobs.squared, NUMBERS)) == SQUARES
        with pytest.raises(ValueError, match="three"):
            list(executor.compute(jobs.fail, NUMBERS))
    with pytest.raises(
        DataError, match=r"expected a Dask scheduler, got none within .*start one with `dask scheduler`"
    ):
        dask_executor("tcp://127.0.0.1:1")


def test_every_library_keeps_to_one_thread():
    for _, (threads, variable) in ProcessExecutor(workers=2).compute(jobs.threads, NUMBERS):
        assert set(threads) == {1}
        assert variable == "1"


START = """
import os, sys, time
from functools import partial
from pathlib import Path

from bench.execution import ProcessExecutor
from tests.execution import jobs

here = Path(sys.argv[1])
if __name__ == "__main__":
"""


def started(folder: Path, body: str, **environment: str) -> subprocess.Popen:
    """A program at a terminal of its own: an interrupt of its group reaches all its processes."""
    program = folder / "program.py"
    program.write_text(START + "".join(f"    {line}\n" for line in body.strip().splitlines()))
    path = os.pathsep.join([str(folder), str(Path(__file__).parents[2])])
    return subprocess.Popen(
        [sys.executable, str(program), str(folder)], env=os.environ | {"PYTHONPATH": path} | environment, cwd=folder,
        start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def assert_ends_well(program: subprocess.Popen) -> None:
    """It must say nothing and leave no process."""
    shown, complaints = program.communicate(timeout=PATIENCE_S)
    assert (program.returncode, shown, complaints) == (0, "", "")
    until(lambda: not group_lives(program.pid), "no process")


def test_workers_have_the_environment_folder_and_import_path_of_the_process_that_starts_them(tmp_path):
    body = """
os.environ["COME"] = "here"
(here / "inner").mkdir()
os.chdir(here / "inner")
sys.path.append("/nowhere")
before = dict(os.environ)
(_, (environment, folder, path)), = ProcessExecutor(workers=1).compute(jobs.surroundings, [1])
assert dict(os.environ) == before
environment["LD_LIBRARY_PATH"] = before["LD_LIBRARY_PATH"]  # OpenCV adds to it
assert environment == before | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
assert (folder, path) == (os.getcwd(), sys.path), path
"""
    assert_ends_well(started(tmp_path, body, OMP_NUM_THREADS="2"))


def test_no_file_of_the_working_folder_stands_in_for_a_library(tmp_path):
    elsewhere = tmp_path / "elsewhere"
    (elsewhere / "bench").mkdir(parents=True)
    for file in ("numpy.py", "bench/__init__.py", "statistics.py", "pickle.py", "multiprocessing.py"):
        (elsewhere / file).write_text("from pathlib import Path\nPath(__file__).with_suffix('.taken').touch()\n")
    body = """
os.chdir(here / "elsewhere")
assert dict(ProcessExecutor(workers=1).compute(jobs.squared, [3])) == {3: 9}
assert not list(here.rglob("*.taken"))
"""
    assert_ends_well(started(tmp_path, body))


INTERRUPTED = {  # what is computed, and how many processes have noted themselves then
    "starting": ("stay", 0),
    "working": ("stay", 2),
    "idle": ("note_process", 3),
}


@pytest.mark.parametrize("when", INTERRUPTED)
def test_an_interrupt_is_told_by_nobody_but_the_process_that_starts_them(tmp_path, when):
    job, at_work = INTERRUPTED[when]
    body = f"""
try:
    (here / "begun").touch()
    with ProcessExecutor(workers=2) as executor:
        list(executor.compute(partial(jobs.{job}, here), [1, 2]))
        jobs.stay(here, 3)
except KeyboardInterrupt:
    print("interrupted")
"""
    program = started(tmp_path, body)
    try:
        until(lambda: (tmp_path / "begun").exists() and len(pids(tmp_path / "processes")) == at_work, "the moment")
        os.killpg(program.pid, signal.SIGINT)
        assert program.communicate(timeout=PATIENCE_S) == ("interrupted\n", "")
    finally:
        program.kill()
    until(lambda: not group_lives(program.pid), "no process")


def test_results_that_nobody_asks_for_do_not_keep_a_program_alive(tmp_path):
    body = "results = ProcessExecutor(workers=2).compute(jobs.squared, [3, 4, 5])\nassert next(results)[1] in (9, 16)"
    assert_ends_well(started(tmp_path, body))


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_no_process_stays_when_the_one_that_started_them_ends(tmp_path, number):
    program = started(tmp_path, "list(ProcessExecutor(workers=2).compute(partial(jobs.stay, here), [1, 2]))")
    try:
        until(lambda: len(pids(tmp_path / "processes")) == 2, "both processes at work")
    finally:
        program.send_signal(number)
        program.communicate(timeout=PATIENCE_S)
    until(lambda: not group_lives(program.pid), "no process")
