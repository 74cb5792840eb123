"""What goes wrong while a run goes on costs at most the part that it happened to, and says so."""

import os
import shutil
import signal
import subprocess
import threading
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from bench.errors import DataError
from bench.evaluation import load_protocol
from bench.execution import ProcessExecutor, SerialExecutor
from bench.harness import provenance, read_run, read_tables
from bench.harness.cache import CacheFolder
from bench.harness.tasks import UnitTask
from bench.methods import build_method
from tests.support.processes import PATIENCE_S, files_of, pids, until
from tests.support.runs import bytes_of
from tests.support.troubled_runs import call, calm, command, environment, score

pytestmark = pytest.mark.slow

__all__ = ["calm"]

PAPER = load_protocol("paper-v1")
UNITS = 3


def calm_result(card: Path, out: Path) -> dict[str, bytes]:
    score(card, out)
    return bytes_of(out)


def test_processes_give_the_bytes_of_one_after_the_other(tiny_card, tmp_path):
    method = build_method("spherical", {})
    score(tiny_card, tmp_path / "one", method=method)
    score(tiny_card, tmp_path / "two", method=method, executor=ProcessExecutor(workers=2))
    assert bytes_of(tmp_path / "two") == bytes_of(tmp_path / "one")


def test_a_worker_that_is_killed_in_the_middle_of_a_unit_costs_nothing_but_time(tiny_card, calm, tmp_path, trouble):
    expected = bytes_of(calm)
    waits = trouble / "crossing.wait"
    waits.touch()
    here = trouble / "crossing.wait-noted"
    killed: list[int] = []

    def kill() -> None:
        until(lambda: bool(pids(here)), "a worker in the middle of a unit")
        killed.append(pids(here)[0])
        waits.unlink()
        os.kill(killed[0], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    summary = score(tiny_card, tmp_path / "run", executor=ProcessExecutor(workers=2))
    killer.join()
    assert killed
    assert killed[0] != os.getpid()
    assert summary.failures == ()
    assert bytes_of(tmp_path / "run") == expected


def test_a_unit_that_crashes_the_interpreter_is_named_and_the_rest_is_done(tiny_card, calm, tmp_path, trouble):
    out = tmp_path / "run"
    expected = bytes_of(calm)
    (trouble / "standing.abort").touch()
    ended = call(tiny_card, out, "--workers", 2)
    assert ended.returncode == 2
    assert "failed: recording 'standing', camera 'front', images 1 to 4" in ended.stdout
    assert "its process ended without a result, as when memory runs out or a library crashes, 3 times" in ended.stdout
    assert len(set(pids(trouble / "standing.abort-noted"))) == 3
    summary = read_run(out).summary
    assert (len(summary.failures), summary.provenance.work.units_computed) == (1, UNITS - 1)
    assert {row["recording"] for row in read_tables(out)[1].to_pylist()} == {"crossing", "overtaking"}
    (trouble / "standing.abort").unlink()
    again = score(tiny_card, out)
    assert (again.provenance.work.units_computed, again.provenance.work.units_reused) == (1, UNITS - 1)
    assert bytes_of(out) == expected


@pytest.mark.parametrize("workers", [1, 2])
def test_a_unit_that_wants_more_memory_than_there_is_is_named(tiny_card, tmp_path, trouble, workers):
    (trouble / "standing.want_memory").touch()
    executor = SerialExecutor() if workers == 1 else ProcessExecutor(workers=workers)
    summary = score(tiny_card, tmp_path / "run", executor=executor)
    assert len(summary.failures) == 1
    assert "'standing'" in summary.failures[0]
    assert "memory" in summary.failures[0]
    assert summary.images.images == 8


def sizes(run: Path) -> list[int]:
    """The file of each unit, the smallest first."""
    return sorted(file.stat().st_size for file in (run / "units").glob("*.unit"))


@pytest.mark.parametrize("workers", [1, 2])
def test_a_full_disk_ends_a_run_clearly_and_what_is_stored_stays(tiny_card, calm, tmp_path, trouble, workers):
    expected = bytes_of(calm)
    *_, most = sizes(calm)
    out = tmp_path / "run"
    with files_of(most - 1):
        ended = call(tiny_card, out, "--workers", workers)
    assert ended.returncode == 2
    assert "expected a writable path, got File too large" in ended.stderr
    assert "free some disk space" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert not [file for file in out.rglob(".*") if file.is_file()], "nothing half-written stays"
    assert not (out / "summary.json").exists()
    stored = len(list((out / "units").glob("*.unit")))
    work = score(tiny_card, out).provenance.work
    assert (work.units_computed, work.units_reused) == (UNITS - stored, stored)
    assert bytes_of(out) == expected


def test_a_disk_that_is_full_at_the_end_is_no_bug_either(tiny_card, calm, tmp_path, trouble):
    expected = bytes_of(calm)
    *_, most = sizes(calm)
    joined = max((calm / f"{name}.parquet").stat().st_size for name in ("objects", "frames", "masks"))
    assert joined > most
    out = tmp_path / "run"
    with files_of(max(most, joined - 1)):
        ended = call(tiny_card, out, "--workers", 1)
    assert ended.returncode == 2
    assert "free some disk space" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert not (out / "summary.json").exists()
    assert score(tiny_card, out).provenance.work.units_reused == UNITS
    assert bytes_of(out) == expected


@pytest.mark.parametrize("limit", [0, 3000])
def test_a_disk_that_is_full_for_the_cache_costs_nothing_but_time(tiny_card, tmp_path, monkeypatch, capfd, limit):
    method = build_method("spherical", {})
    score(tiny_card, tmp_path / "calm", method=method)
    put = CacheFolder.put

    def put_on_a_full_disk(self, step, digest, arrays):
        with files_of(limit):
            put(self, step, digest, arrays)

    with monkeypatch.context() as patched:
        patched.setattr(CacheFolder, "put", put_on_a_full_disk)
        score(tiny_card, tmp_path / "run", method=method, cache=tmp_path / "cache")
    assert capfd.readouterr().err == ""
    assert bytes_of(tmp_path / "run") == bytes_of(tmp_path / "calm")
    assert not [file for file in (tmp_path / "cache").rglob(".*") if file.is_file()]
    again = score(tiny_card, tmp_path / "again", method=method, cache=tmp_path / "cache")
    assert again.provenance.work.steps_found.get("flow", 0) == 0, "what did not fit was not kept"
    assert bytes_of(tmp_path / "again") == bytes_of(tmp_path / "calm")


@pytest.mark.parametrize("name", ["objects", "frames"])
@pytest.mark.parametrize("damage", ["cut", "empty", "garbage", "gone"])
def test_a_damaged_table_of_a_run_is_one_clear_line_and_can_be_made_again(
    tiny_card, calm, tmp_path, trouble, name, damage
):
    out = tmp_path / "run"
    expected = bytes_of(shutil.copytree(calm, out))
    file = out / f"{name}.parquet"
    content = file.read_bytes()
    if damage == "gone":
        file.unlink()
    else:
        file.write_bytes({"cut": content[: len(content) // 2], "empty": b"", "garbage": content[::-1]}[damage])
    with pytest.raises(DataError, match=f"{name}.parquet"):
        read_tables(out)
    again = score(tiny_card, out)
    assert again.provenance.work.units_reused == UNITS
    assert bytes_of(out) == expected


class Disappearing(SerialExecutor):
    """An executor during which a recording disappears when everything is planned."""

    def __init__(self, folder: Path):
        super().__init__()
        object.__setattr__(self, "folder", folder)

    def compute(self, function, tasks):
        if tasks and isinstance(tasks[0], UnitTask) and self.folder.exists():  # before the first units
            shutil.rmtree(self.folder)
        yield from super().compute(function, tasks)


@pytest.mark.parametrize("recording", ["crossing", "standing"], ids=["closed", "still open"])
def test_a_recording_that_disappears_is_named_and_the_rest_is_done(own_card, tmp_path, trouble, recording):
    folder = own_card.parent / "data" / "tiny" / recording
    out, kept = tmp_path / "run", tmp_path / "elsewhere"
    expected = calm_result(own_card, tmp_path / "calm")
    shutil.copytree(folder, kept)
    summary = score(own_card, out, executor=Disappearing(folder))
    assert summary.failures
    assert all(recording in failure for failure in summary.failures)
    assert summary.images.evaluated == 8
    shutil.copytree(kept, folder)
    again = score(own_card, out)
    assert (again.failures, again.provenance.work.units_reused) == ((), UNITS - 1)
    assert bytes_of(out) == expected


def test_a_second_run_in_a_folder_is_refused_and_does_not_harm_the_first(tiny_card, calm, tmp_path, trouble):
    expected = bytes_of(calm)
    out, waits = tmp_path / "run", trouble / "standing.wait"
    waits.touch()
    first = subprocess.Popen(command(tiny_card, out, "--workers", 2), env=environment(), stdout=subprocess.DEVNULL)
    try:
        until(lambda: bool(pids(trouble / "standing.wait-noted")), "the first run in the middle of a unit")
        for options in ([], ["--shard", "1/2"]):
            second = call(tiny_card, out, "--workers", 1, *options)
            assert second.returncode == 2
            assert f"{out}: expected a folder that no other run uses, got one in use by another run" in second.stderr
    finally:
        waits.unlink()
        assert first.wait(PATIENCE_S) == 0
    assert bytes_of(out) == expected


def test_parts_share_a_folder(tiny_card, calm, tmp_path, trouble):
    expected = bytes_of(calm)
    out, waits = tmp_path / "run", trouble / "standing.wait"  # the third unit, so of the first part
    waits.touch()
    first = subprocess.Popen(
        command(tiny_card, out, "--workers", 1, "--shard", "1/2"), env=environment(), stdout=subprocess.DEVNULL
    )
    try:
        until(lambda: bool(pids(trouble / "standing.wait-noted")), "the first part in the middle of a unit")
        assert call(tiny_card, out, "--workers", 1, "--shard", "2/2").returncode == 0
        whole = call(tiny_card, out, "--workers", 1)
        assert (whole.returncode, "in use by another run" in whole.stderr) == (2, True)
    finally:
        waits.unlink()
        assert first.wait(PATIENCE_S) == 0
    ended = call(tiny_card, out, "--workers", 1)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert f"found done {UNITS}" in ended.stdout
    assert bytes_of(out) == expected


def set_times(folder: Path, seconds: int) -> None:
    for file in folder.rglob("*"):
        os.utime(file, (seconds, seconds))


def test_clocks_decide_nothing(own_card, tmp_path, monkeypatch):
    """Neither times of files nor the hour; not even where the clock is set back while a run goes on."""
    method = build_method("spherical", {})
    score(own_card, tmp_path / "calm", method=method)
    expected, out, cache = bytes_of(tmp_path / "calm"), tmp_path / "run", tmp_path / "cache"
    hours = iter(range(10_000_000, 0, -1))

    class SetBack(datetime):
        @classmethod
        def now(cls, tz=None):
            return datetime.fromtimestamp(3600 * next(hours), tz)

    monkeypatch.setattr(time, "time", lambda: 3600.0 * next(hours))
    monkeypatch.setattr(time, "time_ns", lambda: 3_600_000_000_000 * next(hours))
    monkeypatch.setattr(provenance, "datetime", SetBack)
    for year, reused in ((2100, 0), (1990, UNITS), (1970, UNITS)):
        then = int(datetime(year, 1, 2, tzinfo=UTC).timestamp())
        set_times(own_card.parent, then)
        if out.exists():
            set_times(out, then)
            set_times(cache, then)
        made = score(own_card, out, method=method, cache=cache).provenance
        assert bytes_of(out) == expected
        assert made.work.units_reused == reused
        assert made.seconds >= 0.0
        assert all(seconds >= 0.0 for seconds in made.stage_seconds.values())
