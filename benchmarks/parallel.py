"""Whole runs in one process and in several, in turns: how much of the cores arrives."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from tests.support.processes import group_lives


@dataclass(frozen=True, slots=True, kw_only=True)
class RunCost:
    """Cost of a whole command, from its start to its end.

    Attributes:
        seconds: on the clock.
        own_cpu_s: processor time of its first process.
        workers_cpu_s: processor time of the others.
        images: that were scored.
        peak_mb: largest resident size of a process that scored.
    """

    seconds: float
    own_cpu_s: float
    workers_cpu_s: float
    images: int
    peak_mb: float


COSTED = """
import atexit, json, os, resource, sys
from multiprocessing import forkserver
from pathlib import Path

if __name__ == "__main__":
    def tell():
        used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        own_s, others_s = (one.ru_utime + one.ru_stime for one in used)
        server = forkserver._forkserver._forkserver_pid  # it has waited for the workers, but nobody yet for it
        if server is not None:
            ticks = Path(f"/proc/{server}/stat").read_text().rpartition(")")[2].split()[11:15]
            others_s += sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")
        json.dump([own_s, others_s], open(sys.argv[1], "w"))

    atexit.register(tell)
    from bench.commands.app import main

    cost, sys.argv[1:] = sys.argv[1], sys.argv[2:]
    try:
        main()
    finally:
        sys.argv.insert(1, cost)
"""


def command(card: Path, out: Path, *options: object) -> list[str]:
    """A run that computes everything; what it cost is told in a file beside `out`."""
    script = out.with_name(f"{out.name}.py")
    script.write_text(COSTED)
    words = [out.with_suffix(".cost"), "run", card, "--out", out, "--no-pictures", *options]
    return [sys.executable, str(script), *map(str, words)]


def run_cost(card: Path, *options: object) -> RunCost:
    """Run the command in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        out, start = Path(folder) / "run", time.perf_counter()
        subprocess.run(command(card, out, *options), check=True, stdout=subprocess.DEVNULL)
        seconds = time.perf_counter() - start
        made = json.loads((out / "paper-v1" / "summary.json").read_text())["provenance"]
        own_s, workers_s = json.loads(out.with_suffix(".cost").read_text())
        return RunCost(
            seconds=seconds, own_cpu_s=own_s, workers_cpu_s=workers_s, images=made["images"],
            peak_mb=made["peak_memory_mb"],
        )  # fmt: skip


def best_costs(card: Path, *options: object, workers: int, rounds: int) -> tuple[RunCost, RunCost]:
    """The quickest of several runs in one process, and in `workers`; in turns, so that both meet the same machine."""
    costs: dict[int, list[RunCost]] = {1: [], workers: []}
    for _ in range(rounds):
        for count, found in costs.items():
            found.append(run_cost(card, *options, "--workers", count))
    one, several = (min(found, key=lambda cost: cost.seconds) for found in costs.values())
    return one, several


def efficiency_of_processor_time(one: RunCost, several: RunCost, *, workers: int) -> float:
    """Efficiency as it would be if every process had a core for itself, whatever else the machine does.

    All that the first process does counts as if the others waited for it, so it is rather too small.
    """
    return (one.own_cpu_s + one.workers_cpu_s) / workers / (several.own_cpu_s + several.workers_cpu_s / workers)


def two_at_once(card: Path, *options: object) -> float:
    """Two runs in one process each, side by side, over one alone: 1 where the machine gives each a whole core."""
    alone = run_cost(card, *options, "--workers", 1).seconds
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        pair = [
            subprocess.Popen(command(card, Path(folder) / str(k), *options, "--workers", 1), stdout=subprocess.DEVNULL)
            for k in range(2)
        ]
        assert [run.wait() for run in pair] == [0, 0]
        return alone / (time.perf_counter() - start)


def seconds_to_stop(card: Path, *options: object) -> float:
    """From an interrupt in the middle of a run with two workers to the end of the last of its processes."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        run = subprocess.Popen(
            command(card, out, *options, "--workers", 2), start_new_session=True, stdout=subprocess.DEVNULL
        )
        while not list(out.glob("units/*.unit")):
            assert run.poll() is None, "the run ended before it could be interrupted"
            time.sleep(0.05)
        start = time.perf_counter()
        os.killpg(run.pid, signal.SIGINT)
        run.wait()
        while group_lives(run.pid):
            time.sleep(0.01)
        return time.perf_counter() - start
