"""`compare` and `leaderboard`, on runs of the rendered data set."""

import base64
import re
import shutil

import cv2
import numpy as np
import pytest

from bench.methods.baselines import Nothing
from bench.methods.spherical.method import SphericalMethod
from tests.support.commands import call, output_of
from tests.support.runs import score


@pytest.fixture(scope="module")
def runs(tiny_card, tmp_path_factory):
    """The paper's method, and nothing."""
    folder = tmp_path_factory.mktemp("runs")
    for method in ("spherical", "nothing"):
        score(tiny_card, folder / method, method=method)
    return folder


def test_compare_ends_with_verdicts_files_and_titled_pictures(monkeypatch, runs, tmp_path):
    for kind in (Nothing, SphericalMethod):
        monkeypatch.setattr(kind, "segment", lambda *_: pytest.fail("a stored run calls its method"))
    shown = output_of("compare", runs / "spherical", runs / "nothing", "--out", tmp_path)
    found = re.search(
        r"(\d+) object-frames, detected by any pixel: (\d+) before, 0 after; 0 newly detected, (\d+) newly", shown
    )
    assert found[2] == found[3] != "0"
    assert "nothing against spherical, over everything. " in shown
    assert "Too few recordings: IoU, all" in shown, "three recordings prove nothing"
    assert "no picture" not in shown, "processed again, every picture shows what was stored"
    page = (tmp_path / "compare.html").read_text()
    pictures = re.findall(r'<img src="data:image/jpeg;base64,([^"]*)" alt="([^:"(]*)', page)
    assert [title.strip() for _, title in pictures] == ["newly missed", "newly missed", "fewer false positives"]
    assert page.count("<img ") == len(pictures)
    for content, _ in pictures:
        image = cv2.imdecode(np.frombuffer(base64.b64decode(content), np.uint8), cv2.IMREAD_COLOR)
        assert image.shape[1] > 1300, "both methods side by side"
        title = image[:60]
        assert (title < 100).any(), "letters"
    assert "<img" not in (tmp_path / "compare.md").read_text()
    assert str(tmp_path / "compare.html") in shown


def test_compare_writes_beside_the_runs_of_the_house_without_out(monkeypatch, runs, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert call(monkeypatch, "compare", runs / "spherical", runs / "nothing", "--no-pictures") == 0
    made = sorted(file.name for file in (tmp_path / "reports" / "runs" / "compare-spherical-nothing").iterdir())
    assert made == ["compare.csv", "compare.html", "compare.md"]


def test_leaderboard_lists_groups_and_damaged_runs(runs, tmp_path):
    shown = output_of("leaderboard", runs, "--out", tmp_path)
    assert shown.count("Detection") >= 1
    assert str(tmp_path / "leaderboard.md") in shown
    damaged = shutil.copytree(runs / "nothing", runs / "damaged") / "paper-v1" / "summary.json"
    damaged.write_text("{")
    assert "not ranked: damaged/paper-v1: " in output_of("leaderboard", runs, status=2)
