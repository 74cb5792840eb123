"""`history` on runs of a method in a repository, whose file changes from commit to commit."""

import csv
import json
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from bench.harness import read_run
from tests.support.commands import called_here

METHOD = """
import numpy as np

from bench.methods import Method
from bench.records.segmentation import Segmentation


class Own(Method):
    name = "own"
    history = 1

    def segment(self, frame):
        before, now = (image.astype(int) for image in frame.images[-2:])
        return Segmentation(mask=np.abs(now - before) > THRESHOLD, cell_size_px=1)


THRESHOLD = {threshold}
"""
OWNER = {"GIT_AUTHOR_NAME": "a", "GIT_AUTHOR_EMAIL": "a@b", "GIT_COMMITTER_NAME": "a", "GIT_COMMITTER_EMAIL": "a@b"}


def git(repository: Path, *words: str, day: int = 1) -> str:
    dated = dict.fromkeys(("GIT_AUTHOR_DATE", "GIT_COMMITTER_DATE"), f"2026-02-0{day}T12:00:00+00:00")
    environment = os.environ | OWNER | dated
    words = ("git", "-C", str(repository), *words)
    return subprocess.run(words, check=True, capture_output=True, text=True, env=environment).stdout.strip()


@pytest.fixture(scope="module")
def repository(tiny_card, tmp_path_factory) -> tuple[Path, list[str]]:
    """Two commits and a changed file, scored in another order, and nothing of the package."""
    folder = tmp_path_factory.mktemp("repository")
    git(folder, "init", "--quiet")
    commits = []
    for day, threshold in ((1, 30), (2, 60)):
        (folder / "mine.py").write_text(METHOD.format(threshold=threshold))
        git(folder, "add", "mine.py")
        git(folder, "commit", "--quiet", "-m", "threshold", day=day)
        commits.append(git(folder, "rev-parse", "HEAD"))
    (folder / "mine.py").write_text(METHOD.format(threshold=90))
    score(folder, tiny_card, "changed")
    for name, commit in (("newer", commits[1]), ("older", commits[0])):
        git(folder, "checkout", "--quiet", "--force", commit)
        score(folder, tiny_card, name)
    return folder, commits


def score(folder: Path, card: Path, name: str) -> None:
    """In a process of its own: this one would know the method's module already."""
    words = [
        "-m",
        "bench",
        "run",
        card,
        "--method",
        "mine:Own",
        "--out",
        f"runs/{name}",
        "--no-pictures",
        "--workers",
        1,
    ]
    subprocess.run([sys.executable, *map(str, words)], check=True, cwd=folder, capture_output=True)


def test_the_commit_of_a_users_method_is_that_of_its_own_repository(repository):
    folder, commits = repository
    found = {name: read_run(folder / "runs" / name) for name in ("older", "newer", "changed")}
    assert {name: one.commit for name, one in found.items()} == {
        "older": commits[0], "newer": commits[1], "changed": f"{commits[1]}+",
    }  # fmt: skip
    assert len({one.manifest.method.code_digest for one in found.values()}) == 3


def test_runs_stand_by_the_time_of_their_commits_and_changes_are_those_of_compare(repository, tmp_path):
    folder, (first, second) = repository
    done = called_here("history", folder / "runs", "--out", tmp_path / "out", folder=folder)
    assert (done.returncode, done.stderr) == (0, "")
    names = [first[:8], second[:8], f"{second[:8]}+"]
    shown = [done.stdout.index(f"\n{name} ") for name in names]
    assert shown == sorted(shown)
    assert "own on tiny, all recordings, paper-v1" in done.stdout
    for before, after in pairwise(names):
        assert f"{before} to {after}" in done.stdout
    rows = list(csv.DictReader((tmp_path / "out" / "history.csv").open()))
    assert [row["run"] for row in rows if row["metric"] == "iou"] == ["older", "newer", "changed"]
    assert [row["time_utc"][:10] for row in rows if row["metric"] == "iou"] == [
        "2026-02-01",
        "2026-02-02",
        "2026-02-02",
    ]
    words = (
        "compare",
        folder / "runs" / "older",
        folder / "runs" / "newer",
        "--no-pictures",
        "--out",
        tmp_path / "pair",
    )
    assert called_here(*words, folder=tmp_path).returncode == 0
    compared = json.loads((tmp_path / "pair" / "compare.json").read_text())["comparisons"][0]["rows"]
    for row in (row for row in rows if row["run"] == "newer"):
        (pair,) = [
            one for one in compared
            if one["row"] in ("all_moving", "frames") and one["metric"] == row["metric"]
        ]  # fmt: skip
        assert (row["verdict"], float(row["difference"])) == (pair["verdict"], pair["difference"])
    assert "too few recordings" in {row["verdict"] for row in rows}, "three of them prove nothing"
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".html", ".md", ".csv", ".tex", ".png", ".svg"}


def test_elsewhere_the_runs_own_times_count(repository, tmp_path):
    folder, _ = repository
    done = called_here("history", folder / "runs", "--out", tmp_path / "out", folder=tmp_path)
    assert done.returncode == 0
    rows = list(csv.DictReader((tmp_path / "out" / "history.csv").open()))
    times = [row["time_utc"] for row in rows]
    assert times == sorted(times)
    assert not any(time.startswith("2026-02-0") for time in times)


def test_a_damaged_run_is_named_and_one_in_one_file_is_left_out_with_the_remedy(repository, tmp_path):
    folder, _ = repository
    place = tmp_path / "sent" / "theirs.run.zip"
    place.parent.mkdir()
    assert called_here("bundle", folder / "runs" / "newer", "--out", place).returncode == 0
    (tmp_path / "sent" / "broken").mkdir()
    (tmp_path / "sent" / "broken" / "summary.json").write_text("{")
    done = called_here("history", folder / "runs", tmp_path / "sent")
    command = f"fisheye-bench unbundle {place} --out {place.with_name('theirs')}"
    assert done.returncode == 2
    assert f"not listed: {place} is a run in one file; unpack it: {command}" in done.stdout
    assert "damaged: broken: " in done.stdout
