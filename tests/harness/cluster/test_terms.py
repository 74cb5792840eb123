"""What a worker must have in common with a run, and what it says when it has not."""

import sys
from dataclasses import replace
from importlib import invalidate_caches

import pytest

from bench.harness.cache import CacheFolder
from bench.harness.work import Terms
from bench.methods import build_method

METHOD = """
class Mine:
    name, history, colour = "mine", 1, False

    def settings(self):
        return {}

    def segment(self, frame):
        raise NotImplementedError
"""


@pytest.fixture
def terms(tmp_path, monkeypatch) -> Terms:
    (tmp_path / "data").mkdir()
    monkeypatch.chdir(tmp_path)
    return Terms.of(build_method("nothing"), reads=(tmp_path / "data",), cache=CacheFolder(folder=tmp_path / "cache"))


def test_a_worker_that_has_all_of_it(terms):
    assert terms.breach() is None


def test_relative_paths_count_from_where_the_run_was_started(terms, tmp_path, monkeypatch):
    relative = Terms.of(build_method("nothing"), reads=(tmp_path / "data",), cache=None)
    assert relative.reads == terms.reads
    monkeypatch.chdir("/")
    assert relative.breach() is None


def test_another_library(terms):
    other = replace(terms, versions={**terms.versions, "numpy": "1.0"})
    assert "it has numpy " in str(other.breach())
    assert ", not 1.0; install the same on all machines" in str(other.breach())


def test_other_code(terms):
    assert "it has other code of fisheye-bench" in str(replace(terms, code="0" * 64).breach())


def test_data_that_is_not_there(terms, tmp_path):
    (tmp_path / "data").rmdir()
    assert terms.breach() == (
        f"it does not see {tmp_path}/data; data must be there under the same path on all machines"
    )


def test_a_working_directory_that_is_not_there(terms, tmp_path):
    other = replace(terms, folder=tmp_path / "elsewhere")
    assert "start the run in a folder that is there on all machines" in str(other.breach())


def test_a_cache_folder_that_is_something_else(terms, tmp_path):
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache" / "letter.txt").touch()
    assert "wanted an empty folder or a cache" in str(terms.breach())


def test_a_worker_that_still_has_the_former_code_of_a_method(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    file = tmp_path / "mine_on_a_cluster.py"
    file.write_text(METHOD)
    method = build_method("mine_on_a_cluster:Mine")
    assert Terms.of(method, reads=(), cache=None).breach() is None
    file.write_text(METHOD + "# changed\n")
    changed = Terms.of(method, reads=(), cache=None).breach()
    assert changed is not None
    assert "other code of the method mine_on_a_cluster:Mine; start the workers again" in changed


def test_a_method_that_cannot_be_imported(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "mine_alone.py").write_text(METHOD)
    terms = Terms.of(build_method("mine_alone:Mine"), reads=(), cache=None)
    (tmp_path / "mine_alone.py").unlink()
    del sys.modules["mine_alone"]
    invalidate_caches()
    assert "it cannot import the method mine_alone:Mine" in str(terms.breach())
