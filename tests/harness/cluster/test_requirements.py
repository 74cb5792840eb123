"""What a worker must have in common with a run, and what it says when it has not."""

import os
import pickle
import subprocess
import sys
from dataclasses import replace
from importlib import invalidate_caches
from pathlib import Path

import pytest

from bench.harness.cache import CacheFolder
from bench.harness.cluster import WorkerRequirements
from bench.methods import build_method

pytestmark = pytest.mark.slow

METHOD = """
from bench.methods import Method


class Mine(Method):
    name = "mine"

    def segment(self, frame):
        raise NotImplementedError
"""


@pytest.fixture
def requirements(tmp_path, monkeypatch) -> WorkerRequirements:
    (tmp_path / "data").mkdir()
    monkeypatch.chdir(tmp_path)
    return WorkerRequirements.of(
        build_method("nothing"), reads=(tmp_path / "data",), cache=CacheFolder(folder=tmp_path / "cache")
    )


def test_a_worker_that_has_all_of_it(requirements):
    assert requirements.unmet() is None


def test_relative_paths_count_from_where_the_run_was_started(requirements, tmp_path, monkeypatch):
    relative = WorkerRequirements.of(build_method("nothing"), reads=(tmp_path / "data",), cache=None)
    assert relative.reads == requirements.reads
    monkeypatch.chdir("/")
    assert relative.unmet() is None


def test_another_library(requirements):
    other = replace(requirements, versions={**requirements.versions, "numpy": "1.0"})
    assert "it has numpy " in str(other.unmet())
    assert ", not 1.0; install the same on all machines" in str(other.unmet())


def test_other_code(requirements):
    assert "it has other code of fisheye-bench" in str(replace(requirements, code="0" * 64).unmet())


def test_data_that_is_not_there(requirements, tmp_path):
    (tmp_path / "data").rmdir()
    assert requirements.unmet() == (
        f"it does not see {tmp_path}/data; data must be there under the same path on all machines"
    )


def test_a_working_directory_that_is_not_there(requirements, tmp_path):
    other = replace(requirements, folder=tmp_path / "elsewhere")
    assert "start the run in a folder that is there on all machines" in str(other.unmet())


def test_a_cache_folder_that_is_something_else(requirements, tmp_path):
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache" / "letter.txt").touch()
    assert "expected an empty folder or a cache" in str(requirements.unmet())


TERMS = """
import pickle, sys
from bench.harness.cluster import WorkerRequirements
from bench.methods import build_method
requirements = WorkerRequirements.of(build_method("mine_on_a_cluster:Mine"), reads=(), cache=None)
sys.stdout.buffer.write(pickle.dumps(requirements))
"""


def terms_of_a_new_run(folder: Path) -> WorkerRequirements:
    """As another process takes them."""
    path = f"{folder}{os.pathsep}{Path(__file__).parents[3]}"
    done = subprocess.run(
        [sys.executable, "-c", TERMS], capture_output=True, env=os.environ | {"PYTHONPATH": path}, check=True
    )
    requirements = pickle.loads(done.stdout)
    assert isinstance(requirements, WorkerRequirements)
    return requirements


@pytest.mark.parametrize("changed", ["mine_on_a_cluster.py", "mine_helper.py"])
def test_a_worker_that_still_has_the_former_code_of_a_method(tmp_path, monkeypatch, changed):
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in ("mine_on_a_cluster", "mine_helper"):
        sys.modules.pop(name, None)
    (tmp_path / "mine_on_a_cluster.py").write_text(f"import mine_helper\n{METHOD}")
    (tmp_path / "mine_helper.py").write_text("")
    invalidate_caches()
    assert terms_of_a_new_run(tmp_path).unmet() is None
    with (tmp_path / changed).open("a") as file:
        file.write("# changed\n")
    unmet = terms_of_a_new_run(tmp_path).unmet()
    assert unmet is not None
    assert "it has other code of the method mine_on_a_cluster:Mine" in unmet
    assert f"{changed}: expected the code that the run began with" in unmet
    assert "start the workers again" in unmet


def test_a_method_that_cannot_be_imported(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "mine_alone.py").write_text(METHOD)
    requirements = WorkerRequirements.of(build_method("mine_alone:Mine"), reads=(), cache=None)
    (tmp_path / "mine_alone.py").unlink()
    del sys.modules["mine_alone"]
    invalidate_caches()
    assert "it cannot import the method mine_alone:Mine" in str(requirements.unmet())
