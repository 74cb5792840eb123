"""Tasks that end the process that works on them, at their start, in their middle, or in the middle of their answer."""

import ctypes
import os
import signal
import sys
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


def squared_at_the_second_attempt(folder, number):
    if number == 3 and note(folder, "attempts") < 2:
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


def note_process(folder, number):
    note(folder, "processes")


def fail(number):
    if number == 3:
        raise ValueError("three")
    return number


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


class Pools:
    """Processes that a task starts and leaves open."""

    held: ClassVar[list[ProcessPoolExecutor]] = []


def square_in_a_pool(number):
    Pools.held.append(ProcessPoolExecutor(1, mp_context=get_context("fork")))
    return Pools.held[-1].submit(pow, number, 2).result()
