"""The same inputs give the same result, whatever else was computed before, beside it, or in other processes."""

import subprocess

import pytest
from remembering import Remembering

from bench.errors import UsageError
from bench.execution import ProcessExecutor, SerialExecutor
from tests.support.runs import bytes_of
from tests.support.processes import PATIENCE_S
from tests.support.troubled_runs import command, environment, score

pytestmark = pytest.mark.slow


def test_what_a_method_remembers_ends_with_its_unit(tiny_card, tmp_path):
    """Whatever the number of processes, in a run that is resumed, and with an object that was used before."""
    method = Remembering()
    score(tiny_card, tmp_path / "one", method=method)
    expected = bytes_of(tmp_path / "one")
    assert method._background is None
    for workers in (2, 3):
        score(tiny_card, tmp_path / str(workers), method=method, executor=ProcessExecutor(workers=workers))
        assert bytes_of(tmp_path / str(workers)) == expected
    for number in range(3):
        units = sorted((tmp_path / "one/units").iterdir())
        units[number].unlink()
        summary = score(tiny_card, tmp_path / "one", method=method, executor=SerialExecutor())
        assert summary.provenance.work.units_computed == 1
        assert bytes_of(tmp_path / "one") == expected


def test_a_method_that_cannot_be_copied_is_refused_before_anything_is_written(tiny_card, tmp_path):
    method = Remembering()
    method.open_file = (tmp_path / "log").open("w")
    with method.open_file, pytest.raises(UsageError, match=r"object of Remembering that can be copied.*TypeError"):
        score(tiny_card, tmp_path / "run", method=method)
    assert not (tmp_path / "run").exists()


def test_a_method_that_ends_its_process_does_not_end_the_command_as_a_success(tiny_card, tmp_path):
    words = command(tiny_card, tmp_path / "run", "--method", "leaving:Leaving", "--workers", 1)
    ended = subprocess.run(words, env=environment(), capture_output=True, text=True, timeout=PATIENCE_S)
    assert ended.returncode == 2, ended.stdout
    assert "its process ended without a result" in ended.stderr
    assert not (tmp_path / "run/summary.json").exists()
