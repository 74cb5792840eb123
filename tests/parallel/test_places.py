"""A place to compute gives every task back once, whatever becomes of the process that works on it."""

import os
import signal
from contextlib import closing
from functools import partial
from multiprocessing.process import BaseProcess

import pytest

from bench.parallel import Lost, Processes, in_turn, starting, staying
from tests.parallel import jobs
from tests.processes import alive, pids, until

NUMBERS = list(range(7))
SQUARES = {number: number * number for number in NUMBERS}
PLACES = {"in turn": in_turn, "one process": Processes(workers=1), "two": Processes(workers=2)}
BOUND_S = 2.0  # from an interrupt to the end
every_place = pytest.mark.parametrize("name", PLACES)


@pytest.fixture(params=["forked", "spawned"], autouse=True)
def _how_they_start(request, monkeypatch):
    if request.param == "forked" and not starting.FORKS:
        pytest.skip("processes are spawned on this system")
    monkeypatch.setattr(starting, "FORKS", request.param == "forked")


@every_place
def test_every_task_comes_back_once(name):
    done = list(PLACES[name](jobs.squared, NUMBERS))
    assert sorted(task for task, _ in done) == NUMBERS
    assert dict(done) == SQUARES


@every_place
def test_no_task_is_no_work(name):
    assert list(PLACES[name](jobs.squared, [])) == []


@every_place
def test_what_the_work_raises_is_raised(name):
    with pytest.raises(ValueError, match="three"):
        list(PLACES[name](jobs.fail, NUMBERS))


def test_an_exception_tells_where_in_the_worker_it_arose():
    with pytest.raises(ValueError, match="three") as raised:
        list(Processes(workers=2)(jobs.fail, NUMBERS))
    assert "jobs.py" in "".join(raised.value.__notes__)


@pytest.mark.parametrize("work", [jobs.fail_unsendably, jobs.answer_unsendably])
def test_what_cannot_travel_is_told(work):
    with pytest.raises((RuntimeError, TypeError)) as raised:
        list(Processes(workers=1)(work, [1]))
    told = f"{raised.value} {raised.value.__notes__ if hasattr(raised.value, '__notes__') else ''}"
    assert "Unsendable" in told or "pickle" in told


def test_a_task_whose_process_is_killed_is_given_to_another(tmp_path):
    done = dict(Processes(workers=2)(partial(jobs.squared_at_the_third_attempt, tmp_path), NUMBERS))
    assert done == SQUARES
    assert len(set(pids(tmp_path / "attempts"))) == 3


@pytest.mark.parametrize("end", ["SIGSEGV", "status 7"])
def test_a_task_that_always_ends_its_process_is_lost_and_the_others_are_done(tmp_path, end):
    done = dict(Processes(workers=2)(partial(jobs.squared_but_for_three, tmp_path, end), NUMBERS))
    lost = done.pop(3)
    assert isinstance(lost, Lost)
    assert end in lost.reason
    assert lost.reason.endswith("3 times")
    assert done == {number: square for number, square in SQUARES.items() if number != 3}
    assert len(set(pids(tmp_path / "attempts"))) == 3


def test_a_process_that_is_killed_while_it_answers_harms_no_other_answer(tmp_path):
    numbers = [1, 2, 3, 4]
    done = dict(Processes(workers=2)(partial(jobs.large_answer_that_may_be_cut, tmp_path), numbers))
    assert {number: content[:1] for number, content in done.items()} == {n: bytes([n]) for n in numbers}
    assert {len(content) for content in done.values()} == {20_000_000}


def test_closing_ends_the_processes_even_those_that_do_not_listen(tmp_path):
    here = tmp_path / "processes"
    place = Processes(workers=2)
    with closing(place(partial(_stay_after_the_first, tmp_path), [0, 1, 2])) as results:
        assert next(results) == (0, 0)
        until(lambda: len(pids(here)) == 2, "both processes at work")
    assert not any(alive(pid) for pid in pids(here))


def test_closing_never_waits_for_one_process_after_the_other(tmp_path, monkeypatch):
    """However many do not listen, and however busy the machine is: what is asked for at most is within the bound."""
    asked_s: list[float] = []

    def join(process, timeout=None):
        if timeout is not None:
            asked_s.append(timeout)
        joined(process, timeout)

    joined = BaseProcess.join
    monkeypatch.setattr(BaseProcess, "join", join)
    here = tmp_path / "processes"
    with closing(Processes(workers=4)(partial(_stay_after_the_first, tmp_path), [0, 1, 2, 3])) as results:
        assert next(results) == (0, 0)
        until(lambda: len(pids(here)) == 3, "three processes at work")
    assert len(asked_s) == 4
    assert sum(asked_s) < BOUND_S
    assert not any(alive(pid) for pid in pids(here))


def _stay_after_the_first(folder, number):
    return jobs.stay(folder, number) if number else 0


def test_processes_stay_from_one_call_to_the_next_only_inside_the_block(tmp_path):
    place = Processes(workers=2)
    with staying(place):
        first = {pid for _, pid in place(partial(jobs.wait_for_both, tmp_path), [1, 2])}
        second = {pid for _, pid in place(jobs.own_process, NUMBERS)}
        assert len(first) == 2
        assert second <= first
        assert all(alive(pid) for pid in first)
    assert not any(alive(pid) for pid in first)
    with staying(in_turn):
        assert dict(in_turn(jobs.own_process, [1])) == {1: os.getpid()}


def test_processes_that_are_killed_while_they_have_nothing_to_do_are_replaced(tmp_path):
    place = Processes(workers=2)
    with staying(place):
        for _, pid in list(place(partial(jobs.wait_for_both, tmp_path), [1, 2])):
            os.kill(pid, signal.SIGKILL)
        assert dict(place(jobs.squared, NUMBERS)) == SQUARES


def test_every_library_keeps_to_one_thread():
    for _, (threads, variable) in Processes(workers=2)(jobs.threads, NUMBERS):
        assert set(threads) == {1}
        assert variable == "1"


def test_garbage_is_looked_for_while_they_work():
    assert all(enabled for _, enabled in Processes(workers=2)(jobs.looks_for_garbage, NUMBERS))


def test_the_work_travels_once_to_each_process(tmp_path):
    work = jobs.Heavy(tmp_path / "travelled")
    assert len(list(Processes(workers=2)(work, NUMBERS))) == len(NUMBERS)
    assert 1 <= len(work.file.read_text()) <= 2
