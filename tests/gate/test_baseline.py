"""Baselines: written with care, read for ever."""

import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from bench.errors import DataError, UsageError
from bench.gate import read_baseline, write_baseline
from bench.harness import manifest as manifests
from bench.methods import build_method
from tests.gate.factories import one, scored, sums
from tests.support.manifests import method_of_run

BASELINES = Path(__file__).parents[2] / "reports" / "baselines"


def test_a_baseline_is_read_as_it_was_written_and_replaces_no_run(tmp_path):
    run = scored({"crossing": {"tpr_all": sums([1 / 3, 0.1])}}, recordings={"drive-0": "0" * 16, "drive-1": "1" * 16})
    write_baseline(run, tmp_path / "baselines" / "demo")
    read = read_baseline(tmp_path / "baselines" / "demo")
    assert read.manifest == run.manifest
    pd.testing.assert_frame_equal(read.sums, run.sums, check_dtype=False, check_exact=True)
    assert sorted(path.name for path in (tmp_path / "baselines" / "demo").iterdir()) == ["manifest.json", "sums.csv"]
    lines = (tmp_path / "baselines" / "demo" / "sums.csv").read_text().splitlines()
    assert lines[2] == "category,crossing,drive-1,tpr_all,1.0,10.0"
    (tmp_path / "summary.json").touch()
    with pytest.raises(UsageError, match="expected a folder for a baseline, got that of a run"):
        write_baseline(run, tmp_path)


@pytest.mark.parametrize("folder", sorted(BASELINES.iterdir()), ids=lambda folder: folder.name)
def test_the_form_of_a_baseline_is_stable(folder, tmp_path):
    write_baseline(read_baseline(folder), tmp_path / "again")
    for name in ("sums.csv", "manifest.json"):
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes()


def own(**changes):
    return {"method": method_of_run("own", code_digest="1").model_copy(update=changes)}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"commit": "c0ffee+"},
            "were changed on top of commit c0ffee, so that nobody can repeat the run; commit",
        ),
        (own(), "code or files of method 'own' were in no commit, so that .* give the same `run` again, which then"),
        (own(commit="feed12+", uncommitted=("a.py", "b.pt")), "method 'own' were in no commit: a.py, b.pt, so that"),
        ({"failures": ("recording 'a': no lidar",)}, "a run with failures makes no baseline.*no lidar"),
        ({"commit": None}, ""),
        (own(commit="feed12"), ""),
    ],
)
def test_a_run_that_nobody_can_repeat_makes_no_baseline_unless_told(tmp_path, changes, told):
    run = scored({}, **changes)
    if told:
        with pytest.raises(UsageError, match=told):
            write_baseline(run, tmp_path / "b")
        assert not (tmp_path / "b").exists()
    if "failures" not in changes:
        write_baseline(run, tmp_path / "b", allow_dirty=bool(told))
        assert read_baseline(tmp_path / "b").manifest == run.manifest


def test_the_commit_of_an_installed_package_is_the_one_that_pip_noted(tmp_path, monkeypatch):
    info = tmp_path / "fisheye_bench-9.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: fisheye-bench\nVersion: 9\n")
    (info / "direct_url.json").write_text('{"url": "file:///x", "vcs_info": {"vcs": "git", "commit_id": "c0ffee"}}')
    monkeypatch.syspath_prepend(str(tmp_path))
    assert manifests.package_commit() != "c0ffee"  # another copy runs
    monkeypatch.setattr(manifests.bench, "__file__", str(tmp_path / "bench" / "__init__.py"))
    assert manifests.package_commit() == "c0ffee"


PLUG_IN = """
from bench.methods import Method


class Own(Method):
    name = "own"

    def segment(self, frame): ...
"""


def test_the_commit_of_a_plug_in_is_that_of_its_own_checkout_and_names_what_is_in_none(monkeypatch, tmp_path):
    name = "own_for_the_gate"
    (tmp_path / f"{name}.py").write_text(PLUG_IN)
    monkeypatch.syspath_prepend(str(tmp_path))
    git = ("git", "-C", str(tmp_path), "-c", "user.name=x", "-c", "user.email=x@x")

    def origin() -> tuple[str | None, tuple[str, ...]]:
        found = manifests.MethodOfRun.of(build_method(f"{name}:Own"))
        return found.commit, found.uncommitted

    for command in (("init", "-q"), ("add", "."), ("commit", "-qm", "x")):
        assert origin() == (None, (f"{name}.py",))
        subprocess.run([*git, *command], check=True)
    (tmp_path / "notes.txt").touch()
    clean, uncommitted = origin()
    assert re.fullmatch("[0-9a-f]{40}", clean)
    assert uncommitted == (), "what is neither its code nor a file of it does not count"
    for letter in "abcd":
        (tmp_path / f"{letter}.py").touch()
    assert origin() == (f"{clean}+", ("a.py", "b.py", "c.py"))
    sys.modules.pop(name)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sums.csv", r"sums\.csv: expected a table of sums"),
        ("manifest.json", r"expected a folder with sums\.csv and manifest\.json"),
    ],
)
def test_a_missing_file_of_a_baseline_is_named(tmp_path, name, message):
    write_baseline(one([0.5] * 6), tmp_path / "b")
    (tmp_path / "b" / name).unlink()
    with pytest.raises(DataError, match=message):
        read_baseline(tmp_path / "b")
