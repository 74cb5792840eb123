"""A run that is interrupted, told to end or killed leaves no process behind and goes on where it stopped."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from troubled import Troubled

from bench.evaluation.protocol import load_protocol
from bench.recordings import load_card
from tests.harness.conftest import trouble
from tests.support.commands import called_here
from tests.support.processes import PATIENCE_S, alive, group_lives, pids, until
from tests.support.runs import bytes_of, run_one
from tests.support.troubled_runs import calm, environment

pytestmark = pytest.mark.slow

__all__ = ["calm", "trouble"]

ROOT = Path(__file__).parents[2]
TROUBLED = ("--method", "troubled:Troubled")
ENDINGS = {
    "interrupted": (signal.SIGINT, 130, "interrupted; what is done is in"),
    "told to end": (signal.SIGTERM, 143, "ended; what is done is in"),
    "killed": (signal.SIGKILL, -signal.SIGKILL, ""),
}


def start(command: str, source: Path, *options: object) -> subprocess.Popen:
    """A command at a terminal of its own: an interrupt reaches all its processes, as Ctrl-C does."""
    return subprocess.Popen(
        [sys.executable, "-m", "bench", command, str(source), *map(str, options)],
        env=environment(),
        start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def ended(process: subprocess.Popen, when, moment: str, *, number: int = signal.SIGINT) -> tuple[int, str, str]:
    """Status and outputs of a process that is sent a signal at a moment; Ctrl-C reaches all that it started."""
    try:
        until(when, moment)
        (os.killpg if number == signal.SIGINT else os.kill)(process.pid, number)
        shown, complaints = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    assert "Traceback" not in complaints
    return process.returncode, shown, complaints


@pytest.fixture
def waiting(trouble):
    """The file while which a method stays in the middle of a recording, and the one in which its workers note that."""
    (trouble / "standing.wait").touch()
    return trouble / "standing.wait", trouble / "standing.wait-noted"


def no_worker(noted: Path) -> None:
    until(lambda: not any(alive(pid) for pid in pids(noted)), "no worker")


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("how", ENDINGS)
def test_a_run_that_is_stopped_leaves_no_process_and_goes_on(tiny_card, calm, tmp_path, waiting, how, workers):
    number, status, told = ENDINGS[how]
    (wait, noted), out = waiting, tmp_path / "run"
    run = start("run", tiny_card, *TROUBLED, "--out", out, "--no-pictures", "--workers", workers)
    stored = lambda: bool(pids(noted)) and len(list(out.glob("answers/*/*.parquet"))) == 2  # noqa: E731
    returned, shown, _ = ended(run, stored, "two units of three stored", number=number)
    assert returned == status
    assert told in shown
    no_worker(noted)
    assert not (out / "paper-v1" / "summary.json").exists()
    wait.unlink()
    again = run_one(card=load_card(tiny_card), out=out, method=Troubled(), protocol=load_protocol("paper-v1"))
    assert again.provenance.images_asked == 4
    assert bytes_of(out) == bytes_of(calm)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_sweep_that_is_interrupted_goes_on(tiny_card, tmp_path, waiting, workers):
    (wait, noted), out = waiting, tmp_path / "out"
    words = ("sweep", tiny_card, *TROUBLED, "--input-error", "speed_scale_percent=0,5", "--workers", workers)
    stored = lambda: bool(pids(noted)) and len(list(out.glob("*/answers/*/*.parquet"))) == 2  # noqa: E731
    status, shown, _ = ended(start(*words, "--out", out), stored, "two tasks of three stored")
    assert status == 130
    assert f"interrupted; what is done is in {out}, and the same command goes on from there" in shown
    no_worker(noted)
    wait.unlink()
    again = called_here(*words, "--out", out)
    assert again.returncode == 0
    assert "16 images answered, the others were there" in again.stdout


def test_an_audit_begins_again_and_says_so(tiny_card, tmp_path, waiting):
    running = start("audit", tiny_card, *TROUBLED, "--workers", 2, "--out", tmp_path / "out")
    status, shown, _ = ended(running, lambda: bool(pids(waiting[1])), "an image in the middle")
    assert status == 130
    assert "interrupted; nothing of the audit is stored, and the same command begins it again" in shown
    no_worker(waiting[1])
    assert not list((tmp_path / "out").iterdir())


def test_rendering_says_how_it_goes_on(tmp_path):
    out = tmp_path / "out"
    rendering = start("synthesize", ROOT / "datasets/demo.scenario.yaml", "--out", out, "--workers", 2)
    status, shown, complaints = ended(
        rendering, lambda: any((out / ".unfinished").glob("*")), "a recording in the middle"
    )
    assert (status, complaints) == (130, "")
    assert f"interrupted; the recordings that are done are in {out}" in shown
    until(lambda: not group_lives(rendering.pid), "no process")


def test_processes_of_a_run_that_is_refused_end_with_it(tmp_path):
    run = start("run", tmp_path / "none.yaml", "--workers", 2)
    shown, complaints = run.communicate(timeout=PATIENCE_S)
    assert (run.returncode, shown, complaints.count("\n")) == (2, "", 1)
    assert "none.yaml" in complaints
    until(lambda: not group_lives(run.pid), "no process")
