"""Tasks that end the process that works on them, at their start, in their middle, or in the middle of their answer."""

import ctypes
import os
import signal
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import ClassVar

import cv2
import scipy.linalg
from threadpoolctl import threadpool_info


def squared(number):
    return number * number


def note(folder, name):
    """Tell of an attempt; how many there have been."""
    with (folder / name).open("a") as file:
        file.write(f"{os.getpid()}\n")
    return len((folder / name).read_text().splitlines())


def squared_at_the_third_attempt(folder, number):
    if number == 3 and note(folder, "attempts") < 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def segfault():
    ctypes.string_at(0)


def leave(_):
    sys.exit(7)


ENDS = {"SIGSEGV": segfault, "status 7": lambda: os._exit(7)}


def squared_but_for_three(folder, end, number):
    if number == 3:
        note(folder, "attempts")
        ENDS[end]()
    return number * number


def large_answer_that_may_be_cut(folder, number):
    """At the first attempt the process is killed at about the time at which it answers."""
    content = bytes([number]) * 20_000_000
    if note(folder, f"{number}") == 1:
        delay_s = 0.002 * number
        threading.Thread(target=lambda: (time.sleep(delay_s), os.kill(os.getpid(), signal.SIGKILL))).start()
    return content


def killed_beside_others(folder, number):
    """Two of the tasks end their process at the first attempt; others must not be computed beside the second."""
    (folder / f"{number}-at-work").touch()
    try:
        if number in {1, 3} and note(folder, f"{number}") == 1:
            (folder / f"{number}-at-work").unlink()
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.2)
        return "alone" if number in {1, 3} and len(list(folder.glob("*-at-work"))) == 1 else "beside others"
    finally:
        (folder / f"{number}-at-work").unlink()


def want_memory(_):
    return bytes(1 << 60)


def note_process(folder, number):
    note(folder, "processes")


def answer_without_end(folder, number):
    note(folder, "processes")
    return Endless()


class Endless:
    """A result that nobody has ever read to its end."""

    def __reduce__(self):
        return time.sleep, (3600,)


def fail(number):
    if number == 3:
        raise ValueError("three")
    return number


class UnsendableError(Exception):
    def __init__(self, one, two):
        super().__init__(f"{one} and {two}: cannot be made of one argument")


def fail_unsendably(number):
    raise UnsendableError(1, 2)


def answer_unsendably(number):
    return threading.Lock()


def stay(folder, number):
    """Work until somebody ends the process; SIGTERM does not."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    note(folder, "processes")
    while True:
        time.sleep(0.1)


def own_process(_):
    return os.getpid()


def surroundings(_):
    return dict(os.environ), str(Path.cwd()), sys.path


def wait_for_both(folder, number):
    """Which process; so that none can do both tasks of two."""
    note(folder, "here")
    while len((folder / "here").read_text().splitlines()) < 2:
        time.sleep(0.01)
    return os.getpid()


def threads(_):
    """Threads of every library of this process."""
    scipy.linalg.inv([[2.0]])
    return [cv2.getNumThreads(), *(pool["num_threads"] for pool in threadpool_info())], os.environ["OMP_NUM_THREADS"]


class Heavy:
    """Work that counts how often it travelled."""

    def __init__(self, file: Path):
        self.file = file

    def __setstate__(self, state):
        self.__dict__.update(state)
        with self.file.open("a") as file:
            file.write(".")

    def __call__(self, number):
        return number


class Pools:
    """Processes that a task starts and leaves open."""

    held: ClassVar[list[ProcessPoolExecutor]] = []


def square_in_a_pool(end, number):
    Pools.held.append(ProcessPoolExecutor(1, mp_context=get_context("fork")))
    squared = Pools.held[-1].submit(pow, number, 2).result()
    if end:
        os._exit(0)
    return squared
