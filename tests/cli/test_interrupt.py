"""A run that is interrupted, told to end or killed leaves no process behind and goes on where it stopped."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bench.evaluation import load_protocol
from bench.harness import run_benchmark
from bench.recordings import load_card
from tests.harness.processes import PATIENCE_S, alive, pids, until
from tests.harness.test_resume import bytes_of
from tests.harness.troubled import FOLDER, Troubled

ENDINGS = {
    "interrupted": (signal.SIGINT, 130, "interrupted; what is done is in"),
    "told to end": (signal.SIGTERM, 143, "ended; what is done is in"),
    "killed": (signal.SIGKILL, -signal.SIGKILL, ""),
}


@pytest.fixture
def trouble(tmp_path, monkeypatch):
    """Where files make trouble."""
    folder = tmp_path / "trouble"
    folder.mkdir()
    monkeypatch.setenv(FOLDER, str(folder))
    return folder


def start(card: Path, out: Path, workers: int) -> subprocess.Popen:
    """A run at a terminal of its own: an interrupt reaches all its processes, as Ctrl-C does."""
    words = ["run", card, "--out", out, "--method", "tests.harness.troubled:Troubled", "--no-pictures", "--no-cache"]
    return subprocess.Popen(
        [sys.executable, "-m", "bench", *map(str, words), "--workers", str(workers)],
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2]), "COLUMNS": "1000"},
        start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("how", ENDINGS)
def test_a_run_that_is_stopped_leaves_no_process_and_goes_on(tiny_card, tmp_path, trouble, how, workers):
    number, status, told = ENDINGS[how]
    options = {"method": Troubled(), "protocol": load_protocol("paper-v1")}
    card = load_card(str(tiny_card))
    run_benchmark(card, out=tmp_path / "calm", **options)
    out, here = tmp_path / "run", trouble / "standing.wait-noted"
    (trouble / "standing.wait").touch()
    run = start(tiny_card, out, workers)
    try:
        until(lambda: bool(pids(here)) and len(list((out / "units").glob("*.json"))) == 2, "two units of three stored")
        if how == "interrupted":
            os.killpg(run.pid, number)
        else:
            run.send_signal(number)
        shown, complaints = run.communicate(timeout=PATIENCE_S)
    finally:
        run.kill()
    assert run.returncode == status
    assert told in shown
    assert "Traceback" not in complaints
    until(lambda: not any(alive(pid) for pid in pids(here)), "no worker")
    assert not (out / "summary.json").exists()
    (trouble / "standing.wait").unlink()
    again = run_benchmark(card, out=out, **options)
    assert (again.provenance.work.units_computed, again.provenance.work.units_reused) == (1, 2)
    assert bytes_of(out) == bytes_of(tmp_path / "calm")
