"""The same inputs give the same result, whatever else was computed before, beside it, or in other processes."""

import os
import py_compile
import subprocess
import sys
from importlib import import_module, invalidate_caches, reload
from types import ModuleType

import pytest
from remembering import Remembering

from bench.errors import DataError, UsageError
from bench.execution import ProcessExecutor, SerialExecutor
from bench.harness import read_run
from bench.harness.digests import MethodCode
from tests.support.commands import called_here
from tests.support.processes import PATIENCE_S
from tests.support.runs import ALL, NONE, bytes_of
from tests.support.troubled_runs import call, command, environment, score

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
        units = sorted(file for file in (tmp_path / "one/units").iterdir() if not file.name.startswith("parts-"))
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


def test_a_setting_that_the_method_forgets_to_report_decides_what_is_found_done(tiny_card, tmp_path):
    run = tmp_path / "run"
    options = ("--method", "forgetful:Forgetful", "--workers", 1)

    def computed(*words):
        done = call(tiny_card, run, *options, *words)
        return done.returncode or read_run(run).summary.provenance.work.units_computed

    assert computed("--set", "level=50") == ALL
    bright = bytes_of(run)
    assert computed("--set", "level=50") == NONE
    assert "level = 200, was 50" in call(tiny_card, run, *options, "--set", "level=200").stderr
    again = call(tiny_card, run, *options, "--set", "level=200", "--overwrite")
    assert "units computed 3, found done 0; computed again since these changed: settings (3)" in again.stdout
    assert bytes_of(run)["objects.parquet"] != bright["objects.parquet"]


def test_a_unit_that_is_gone_is_computed_again_and_told(tiny_card, tmp_path):
    run = tmp_path / "run"
    first = call(tiny_card, run, "--workers", 1)
    assert "units computed 3, found done 0" in first.stdout
    assert "stored result" not in first.stdout
    next((run / "units").glob("*.unit")).unlink()
    again = call(tiny_card, run, "--workers", 1)
    assert "units computed 1, found done 2; without a stored result: 1" in again.stdout


def test_a_setting_that_the_method_forgets_to_report_decides_which_cached_steps_are_found(tiny_card, tmp_path):
    def rows(level: int, out: str) -> bytes:
        options = ("--method", "forgetful:Forgetful", "--set", f"level={level}", "--workers", "1")
        words = ["run", str(tiny_card), *options, "--cache", str(tmp_path / "cache"), "--out", str(tmp_path / out)]
        assert called_here(*words, "--no-pictures").returncode == 0
        return bytes_of(tmp_path / out)["objects.parquet"]

    bright = rows(50, "first")
    assert rows(200, "second") != bright
    assert rows(50, "third") == bright
    assert read_run(tmp_path / "third").summary.provenance.work.steps_computed == {}


def test_a_run_without_a_scored_image_is_no_success(tiny_card, tmp_path):
    done = call(tiny_card, tmp_path / "run", "--method", "forgetful:Forgetful", "--set", "level=-1", "--workers", 1)
    assert done.returncode == 2
    assert "failed: no image was scored; it is too dark (12)" in done.stdout
    assert read_run(tmp_path / "run").summary.images.skipped == 12


CELL = """
import numpy as np
from bench.methods import Method, Segmentation

LEVEL = 100

class Bright(Method):
    name = "bright"

    def segment(self, frame):
        return Segmentation(cell_size_px=1, mask=frame.images[-1] > LEVEL)
"""


@pytest.fixture
def cells(monkeypatch):
    """A notebook: a module without a file, in which code is executed."""
    notebook = ModuleType("notebook")
    monkeypatch.setitem(sys.modules, "notebook", notebook)
    return lambda code: exec(code, vars(notebook)) or notebook


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module of a method in a file, as a user writes it."""
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "brightness.py").write_text(CELL)
    monkeypatch.syspath_prepend(tmp_path / "own")
    yield import_module("brightness")
    del sys.modules["brightness"]


def test_what_changes_in_a_notebook_is_computed_again(tiny_card, tmp_path, cells):
    """A class that is defined anew under its name, and a global that it reads."""
    found = []
    for code in (CELL, CELL.replace(">", "<"), "LEVEL = 50"):
        score(tiny_card, tmp_path / "run", method=cells(code).Bright())
        found.append(bytes_of(tmp_path / "run")["frames.parquet"])
    assert len(set(found)) == 3
    with pytest.raises(UsageError, match=r"can import, got notebook\.Bright, which this process defined or changed"):
        score(tiny_card, tmp_path / "two", method=cells("").Bright(), executor=ProcessExecutor(workers=2))


@pytest.mark.parametrize("name", ["LEVEL", "Bright.segment"])
def test_what_a_notebook_changes_in_a_module_is_computed_again(tiny_card, tmp_path, module, cells, monkeypatch, name):
    def computed() -> int:
        return score(tiny_card, tmp_path / "run", method=module.Bright()).provenance.work.units_computed

    assert [computed(), computed()] == [ALL, NONE]
    with monkeypatch.context() as patched:
        other = cells(CELL).Bright.segment if "." in name else 50
        patched.setattr(module.Bright if "." in name else module, name.rpartition(".")[2], other)
        assert [computed(), computed()] == [ALL, ALL]
    assert computed() == ALL, "the stored units are those of the changed module"
    assert computed() == NONE


def test_stale_bytecode_is_refused(tiny_card, tmp_path):
    """Of a source with the same size and time: Python runs the older state and nobody sees it."""
    source = tmp_path / "brightness.py"
    source.write_text(CELL)
    py_compile.compile(str(source))
    state = source.stat()
    source.write_text(CELL.replace("100", "200"))
    os.utime(source, ns=(state.st_atime_ns, state.st_mtime_ns))
    words = command(tiny_card, tmp_path / "run", "--method", "brightness:Bright", "--workers", 1)
    own = environment()
    own["PYTHONPATH"] = f"{tmp_path}{os.pathsep}{own['PYTHONPATH']}"
    ended = subprocess.run(words, env=own, capture_output=True, text=True, timeout=PATIENCE_S)
    assert ended.returncode == 2
    assert "brightness.py: expected bytecode of this source, got that of another one" in ended.stderr
    assert not (tmp_path / "run").exists()


def test_a_source_that_was_edited_since_its_import_is_not_taken_for_its_new_state(tiny_card, tmp_path, module):
    """What the older state answers is never found done; imported again, the module is what its source says."""
    run, source = tmp_path / "run", tmp_path / "own" / "brightness.py"

    def computed() -> int:
        return score(tiny_card, run, method=module.Bright()).provenance.work.units_computed

    source.write_text(CELL.replace("> LEVEL", "> LEVEL + 50"))
    assert [computed(), computed()] == [ALL, ALL]
    older = bytes_of(run)["frames.parquet"]
    reload(module)
    assert [computed(), computed()] == [ALL, NONE]
    assert bytes_of(run)["frames.parquet"] != older
    source.write_text(f"# where lines stand changes nothing\n{source.read_text()}")
    assert MethodCode.of(reload(module).Bright()).unidentified == ""
    source.write_text("def half(:")
    with pytest.raises(DataError, match=r"brightness\.py: expected the file as it was when the run began"):
        computed()


DYNAMIC = """
from importlib import import_module
from bench.methods import Method

class Dynamic(Method):
    name = "dynamic"

    def __init__(self, *, way="by_setting"):
        self.way = way
        self.held = import_module(f"_{way}"[1:]).answer

    def settings(self):
        return {"way": self.way}

    def segment(self, frame):
        raise NotImplementedError
"""


@pytest.mark.parametrize("way", ["by_setting", "by_other"])
def test_a_module_that_a_method_imports_when_it_is_built_counts(tmp_path, monkeypatch, way):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "dynamic.py").write_text(DYNAMIC)
    digests = set()
    for number in range(2):
        (tmp_path / f"{way}.py").write_text(f"def answer():\n    return {number}  # {'x' * number}\n")
        invalidate_caches()
        method = import_module("dynamic").Dynamic(way=way)
        digests.add(MethodCode.of(method).digest)
        del sys.modules[way], sys.modules["dynamic"]
    assert len(digests) == 2
