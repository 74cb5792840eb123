"""Whatever happens to processes, memory and disk: what is stored is whole, and the same command ends the run."""

import os
import random
import signal
import subprocess
import time
from contextlib import suppress

import pytest

from bench.execution import ProcessExecutor, SerialExecutor
from tests.support.processes import PATIENCE_S, files_of, pids, until
from tests.support.runs import bytes_of
from tests.support.troubled_runs import call, calm, command, environment, score  # noqa: F401

pytestmark = pytest.mark.slow


def test_a_task_that_always_ends_its_worker_is_named_and_the_rest_is_done(tiny_card, calm, tmp_path, trouble):  # noqa: F811
    out = tmp_path / "run"
    (trouble / "standing.abort").touch()
    summary = score(tiny_card, out, executor=ProcessExecutor(workers=2))
    (failure,) = summary.failures
    assert failure.startswith(
        "method 'troubled', recording 'standing', camera 'front', images 1 to 4: its worker ended"
    )
    assert summary.images.evaluated == 8
    (trouble / "standing.abort").unlink()
    again = score(tiny_card, out)
    assert (again.failures, again.provenance.images_asked) == ((), 4)
    assert bytes_of(out) == bytes_of(calm)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_task_that_wants_more_memory_than_there_is_is_named(tiny_card, tmp_path, trouble, workers):
    (trouble / "standing.want_memory").touch()
    executor = SerialExecutor() if workers == 1 else ProcessExecutor(workers=workers)
    summary = score(tiny_card, tmp_path / "run", executor=executor)
    (failure,) = summary.failures
    assert "'standing'" in failure
    assert "memory" in failure
    assert summary.images.images == 8


@pytest.mark.parametrize("workers", [1, 2])
def test_a_full_disk_ends_a_run_clearly_and_what_is_stored_stays(tiny_card, calm, tmp_path, trouble, workers):  # noqa: F811
    sizes = sorted(file.stat().st_size for file in (calm / "answers").rglob("*.parquet"))
    out = tmp_path / "run"
    with files_of(sizes[-1] - 1):
        ended = call(tiny_card, out, "--workers", workers)
    assert ended.returncode == 2
    assert "File too large" in ended.stderr
    assert "free some disk space" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert not [file for file in out.rglob(".*") if file.is_file()], "nothing half-written stays"
    assert not list(out.rglob("summary.json"))
    score(tiny_card, out)
    assert bytes_of(out) == bytes_of(calm)


def test_runs_that_are_killed_at_any_time_end_as_an_undisturbed_one(tiny_card, calm, tmp_path, trouble):  # noqa: F811
    """The program, or one of its workers, at random times; then the same command."""
    draw, out = random.Random(2020), tmp_path / "run"
    for _ in range(6):
        program = subprocess.Popen(
            command(tiny_card, out, "--workers", 2), env=environment(), stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        time.sleep(draw.uniform(0.5, 6.0))
        children = subprocess.run(["pgrep", "-P", str(program.pid)], capture_output=True, text=True).stdout.split()
        victim = draw.choice([program.pid, *map(int, children)])
        with suppress(ProcessLookupError):
            os.kill(victim, signal.SIGKILL)
        program.wait(PATIENCE_S)
    assert call(tiny_card, out, "--workers", 2).returncode == 0
    assert bytes_of(out) == bytes_of(calm)


def test_a_second_run_in_a_folder_is_refused_and_does_not_harm_the_first(tiny_card, calm, tmp_path, trouble):  # noqa: F811
    out, waits = tmp_path / "run", trouble / "standing.wait"
    waits.touch()
    first = subprocess.Popen(command(tiny_card, out, "--workers", 2), env=environment(), stdout=subprocess.DEVNULL)
    try:
        until(lambda: bool(pids(trouble / "standing.wait-noted")), "the first run in the middle of a task")
        for options in ([], ["--shard", "1/2"]):
            second = call(tiny_card, out, "--workers", 1, *options)
            assert second.returncode == 2
            assert f"{out}: expected a folder that no other run uses, got one in use by another run" in second.stderr
    finally:
        waits.unlink()
        assert first.wait(PATIENCE_S) == 0
    assert bytes_of(out) == bytes_of(calm)
