"""Processes start from a fork server that has loaded for all, and are what spawned ones are; none stays behind."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bench.parallel import Processes, starting
from tests.parallel import jobs
from tests.processes import PATIENCE_S, alive, group_lives, pids, until

ROOT = Path(__file__).parents[2]
SPAWNED = "from bench.parallel import starting; starting.FORKS = False"
START = """
import json, os, signal, sys, time
from functools import partial
from pathlib import Path

from bench.cli.early import LOADED
from bench.parallel import Lost, Processes, starting, staying
from tests.parallel import jobs
from tests.processes import alive, pids, until

here = Path(sys.argv[1])
"""
forked = pytest.mark.skipif(not starting.FORKS, reason="processes are spawned on this system")


def started(folder: Path, body: str, *, head: str = "", **environment: str) -> subprocess.Popen:
    """A program with a terminal of its own, that is, an interrupt of its group reaches all its processes."""
    program = folder / "program.py"
    indented = body.strip().replace("\n", "\n    ")
    program.write_text(f'{START}{head}\nif __name__ == "__main__":\n    {indented}\n')
    path = os.pathsep.join([str(folder), str(ROOT)])
    return subprocess.Popen(
        [sys.executable, str(program), str(folder)], env=os.environ | {"PYTHONPATH": path} | environment, cwd=folder,
        start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def shown_by(folder: Path, body: str, **options: str) -> str:
    """What a program shows; it must end well, say nothing else, and leave no process."""
    program = started(folder, body, **options)
    shown, complaints = program.communicate(timeout=PATIENCE_S)
    assert (program.returncode, complaints) == (0, "")
    until(lambda: not group_lives(program.pid), "no process")
    return shown


@forked
def test_what_they_load_is_loaded_once_for_all(tmp_path):
    ran = """
place = Processes(workers=2, loads=["tests.parallel.loaded"])
with place.started(), staying(place):
    until(lambda: len(pids(here / "loaded")) == 1, "loaded, without a task")
    for _ in range(2):
        known = {pid for _, pid in place(partial(jobs.wait_for_both, here), [1, 2])}
        (here / "here").unlink()
        for pid in known:
            os.kill(pid, signal.SIGKILL)
    print(os.getpid(), *known, *{parent for _, parent in place(jobs.parent_process, [1, 2])})
"""
    own, *workers, parent = map(int, shown_by(tmp_path, ran, LOADED=str(tmp_path)).split())
    assert pids(tmp_path / "loaded") == [parent]
    assert len({own, *workers, parent}) == 4


def test_spawned_ones_load_before_there_is_a_task(tmp_path):
    ran = """
place = Processes(workers=2, loads=["tests.parallel.loaded"])
with place.started():
    until(lambda: len(pids(here / "loaded")) == 2, "both loaded, without a task")
    with staying(place):
        computed = {pid for _, pid in place(partial(jobs.wait_for_both, here), [1, 2])}
    assert computed == set(pids(here / "loaded"))
    assert not any(alive(pid) for pid in computed)
with place.started():
    until(lambda: len(pids(here / "loaded")) == 4, "two more")
"""
    shown_by(tmp_path, ran, head=SPAWNED, LOADED=str(tmp_path))


@forked
def test_what_the_first_did_not_load_each_loads_itself(tmp_path):
    ran = """
assert len(list(Processes(workers=1)(jobs.squared, [1]))) == 1
place = Processes(workers=2, loads=["tests.parallel.loaded"])
with place.started(), staying(place):
    assert {pid for _, pid in place(partial(jobs.wait_for_both, here), [1, 2])} == set(pids(here / "loaded"))
"""
    shown_by(tmp_path, ran, LOADED=str(tmp_path))


@pytest.mark.parametrize("head", [pytest.param("", marks=forked), SPAWNED], ids=["forked", "spawned"])
def test_they_are_where_the_one_is_that_starts_them(tmp_path, head):
    """Its environment, folder and import path, as they are then; and it keeps its own."""
    ran = """
os.environ["GONE"] = "here"
before = dict(os.environ)
with Processes(workers=1, loads=LOADED).started():
    assert dict(os.environ) == before
    del os.environ["GONE"]
    os.environ["COME"] = "here"
    (here / "inner").mkdir()
    os.chdir(here / "inner")
    sys.path.append("/nowhere")
    (_, (environment, folder, path)), = Processes(workers=1)(jobs.surroundings, [1])
    assert environment == os.environ | dict.fromkeys(starting.THREAD_VARIABLES, "1")
    assert (folder, path) == (os.getcwd(), sys.path)
"""
    shown_by(tmp_path, ran, head=head, OMP_NUM_THREADS="2")


@forked
def test_no_file_of_the_working_folder_stands_in_for_a_library(tmp_path):
    elsewhere = tmp_path / "elsewhere"
    (elsewhere / "bench").mkdir(parents=True)
    for file in ("numpy.py", "bench/__init__.py", "statistics.py"):
        (elsewhere / file).write_text("from pathlib import Path\nPath(__file__).with_suffix('.taken').touch()\n")
    ran = """
os.chdir(here / "elsewhere")
with Processes(workers=1, loads=LOADED).started():
    assert dict(Processes(workers=1)(jobs.squared, [3])) == {3: 9}
assert not list(here.rglob("*.taken"))
"""
    shown_by(tmp_path, ran)


@forked
def test_the_fork_server_of_a_run_has_no_thread_but_that_of_an_allocator(tmp_path):
    ran = """
with Processes(workers=1, loads=[*LOADED, "tests.parallel.loaded"]).started():
    until((here / "threads").exists, "all loaded")
    assert dict(Processes(workers=1)(jobs.squared, [3])) == {3: 9}
"""
    shown_by(tmp_path, ran, LOADED=str(tmp_path), OMP_NUM_THREADS="2", OPENBLAS_NUM_THREADS="2")
    assert (tmp_path / "threads").read_text().split() in (["python"], ["jemalloc_bg_thd", "python"])


CRASHES = {
    "raises": ("raise RuntimeError('not today')", "RuntimeError: not today"),
    "is not there": ("import nothing_of_that_name", "ModuleNotFoundError"),
    "leaves": ("import os\nos._exit(3)", ""),
}


@pytest.mark.parametrize("how", CRASHES)
def test_a_module_that_does_not_load_is_told(tmp_path, how):
    content, told = CRASHES[how]
    (tmp_path / "crashing.py").write_text(content)
    ran = """
place = Processes(workers=1, loads=["crashing"])
with place.started():
    (_, lost), = place(jobs.squared, [1])
print(lost.reason)
"""
    program = started(tmp_path, ran)
    shown, complaints = program.communicate(timeout=PATIENCE_S)
    assert program.returncode == 0
    assert f"status {3 if how == 'leaves' else 1}, 3 times" in shown
    assert told in complaints
    until(lambda: not group_lives(program.pid), "no process")


@forked
def test_when_the_fork_server_is_killed_they_end_and_others_do_their_tasks(tmp_path):
    ran = """
place = Processes(workers=2)
results = place(partial(jobs.squared_after_the_parent_was_killed, here), [1, 2, 3])
assert dict(results) == {1: 1, 2: 4, 3: 9}
until(lambda: not any(alive(pid) for pid in pids(here / "at work")), "the former ones ended")
assert len(set(pids(here / "at work"))) == 2
"""
    shown_by(tmp_path, ran)


SLOW = "import time\nfrom pathlib import Path\nPath(__file__).with_suffix('.begun').touch()\ntime.sleep(1.0)\n"


@pytest.mark.parametrize("head", [pytest.param("", marks=forked), SPAWNED], ids=["forked", "spawned"])
@pytest.mark.parametrize("then", ["time.sleep(60)", "list(place(jobs.squared, [1]))"], ids=["elsewhere", "waiting"])
def test_an_interrupt_while_they_load_is_told_by_nobody_but_the_one_that_starts_them(tmp_path, head, then):
    (tmp_path / "slow.py").write_text(SLOW)
    ran = f"""
place = Processes(workers=2, loads=["slow"])
try:
    with place.started():
        {then}
        time.sleep(60)
except KeyboardInterrupt:
    print("interrupted")
"""
    program = started(tmp_path, ran, head=head)
    try:
        until(lambda: (tmp_path / "slow.begun").exists(), "in the middle of loading")
        os.killpg(program.pid, signal.SIGINT)
        assert program.communicate(timeout=PATIENCE_S) == ("interrupted\n", "")
    finally:
        program.kill()
    until(lambda: not group_lives(program.pid), "no process")


@pytest.mark.parametrize("head", [pytest.param("", marks=forked), SPAWNED], ids=["forked", "spawned"])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_none_stays_when_the_one_that_started_them_ends(tmp_path, head, number):
    program = started(tmp_path, "list(Processes(workers=2)(partial(jobs.stay, here), [1, 2]))", head=head)
    here = tmp_path / "processes"
    try:
        until(lambda: len(pids(here)) == 2, "both processes at work")
    finally:
        program.send_signal(number)
        program.communicate(timeout=PATIENCE_S)
    until(lambda: not any(alive(pid) for pid in pids(here)), "the processes ended")
    until(lambda: not group_lives(program.pid), "no process")


@forked
def test_where_nothing_can_be_forked_they_are_spawned(monkeypatch):
    def refuse() -> None:
        raise PermissionError("no sockets here")

    monkeypatch.setattr(starting.forkserver, "ensure_running", refuse)
    ((_, parent),) = Processes(workers=1)(jobs.parent_process, [1])
    assert parent == os.getpid()
