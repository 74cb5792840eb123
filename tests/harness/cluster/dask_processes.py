"""A Dask scheduler and workers as a user starts them from the command line."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic, sleep

METHODS = Path(__file__).with_name("methods")  # methods that workers import
PATIENCE_S = 900  # until something that should happen is taken for something that never does
SETTINGS = {
    "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1",
    "DASK_DISTRIBUTED__DIAGNOSTICS__NVML": "False",
}


@dataclass(kw_only=True)
class DaskProcesses:
    """A scheduler, its workers, and the folder of their logs."""

    folder: Path
    address: str
    scheduler: subprocess.Popen[bytes]
    python_path: str
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def add_worker(self, *words: str, python_path: str | None = None, cwd: Path | None = None) -> None:
        """Start a worker with its nanny; it comes in when it comes in."""
        number = len(self.workers)
        command = ["worker", self.address, "--nthreads", "1", "--no-dashboard", *words]
        paths = [self.python_path if python_path is None else python_path, os.environ.get("PYTHONPATH", "")]
        environment = {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
        log = self.folder / f"worker-{number}.log"
        local = ["--local-directory", str(self.folder / f"worker-{number}")]
        self.workers.append(_started([*command, *local], log=log, environment=environment, cwd=cwd or self.folder))


@contextmanager
def dask_processes(folder: Path, *, workers: int, python_path: Path) -> Iterator[DaskProcesses]:
    """Run a scheduler on a free port and workers until the block ends."""
    file = folder / "scheduler.json"
    words = ["scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    scheduler = _started(words, log=folder / "scheduler.log", environment={}, cwd=folder)
    cluster = DaskProcesses(folder=folder, address="", scheduler=scheduler, python_path=str(python_path))
    try:
        wait_until(lambda: file.exists() or scheduler.poll() is not None)
        assert scheduler.poll() is None, (folder / "scheduler.log").read_text()
        wait_until(lambda: "tcp://" in (folder / "scheduler.log").read_text())
        cluster.address = next(
            word for word in (folder / "scheduler.log").read_text().split() if word.startswith("tcp://")
        )
        for _ in range(workers):
            cluster.add_worker()
        yield cluster
    finally:
        for process in (*cluster.workers, scheduler):
            with_group(process, signal.SIGKILL)
            process.wait()


def with_group(process: subprocess.Popen[bytes], number: signal.Signals) -> None:
    """Signal a process and all that it started."""
    try:
        os.killpg(process.pid, number)
    except ProcessLookupError:
        return


def wait_until(happened) -> None:
    """Wait for something that is bound to happen."""
    until_s = monotonic() + PATIENCE_S
    while not happened():
        assert monotonic() < until_s, "it never happened"
        sleep(0.05)


def _started(words: list[str], *, log: Path, environment: Mapping[str, str], cwd: Path) -> subprocess.Popen[bytes]:
    """A process group of its own, so that all of it can be ended."""
    program = Path(sys.executable).with_name("dask")
    with log.open("wb") as output:
        return subprocess.Popen(
            [program, *words],
            env={**os.environ, **SETTINGS, **environment},
            cwd=cwd,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )


def command(*words: object, folder: Path) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, "-m", "bench", *map(str, words)]
    return subprocess.run(program, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S)


def in_background(*words: object, folder: Path) -> subprocess.Popen[str]:
    paths = [str(METHODS), os.environ.get("PYTHONPATH", "")]
    return subprocess.Popen(
        [sys.executable, "-m", "bench", *map(str, words)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
