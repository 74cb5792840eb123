"""`compare` and `leaderboard`, on runs of the rendered data set."""

import base64
import re
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from bench.evaluation import load_protocol
from bench.methods import build_method
from bench.methods.baselines import Nothing
from bench.methods.spherical.method import SphericalMethod
from bench.recordings import load_card
from tests.support.commands import call, error_line
from tests.support.runs import run_one


@pytest.fixture(scope="module")
def runs(tiny_card, tmp_path_factory):
    """The paper's method, nothing, and the paper's method by another protocol."""
    folder = tmp_path_factory.mktemp("runs")
    for name, method, protocol in (
        ("spherical", "spherical", "paper-v1"),
        ("nothing", "nothing", "paper-v1"),
        ("extended", "nothing", "extended-v1"),
    ):
        run_one(
            card=load_card(tiny_card),
            method=build_method(method),
            protocol=load_protocol(protocol),
            out=folder / name,
        )
    return folder


def test_compare_ends_with_verdicts_files_and_titled_pictures(monkeypatch, capsys, runs, tmp_path):
    for kind in (Nothing, SphericalMethod):
        monkeypatch.setattr(kind, "segment", lambda *_: pytest.fail("a stored run calls its method"))
    assert call(monkeypatch, "compare", runs / "spherical", runs / "nothing", "--out", tmp_path) == 0
    shown = capsys.readouterr().out
    found = re.search(
        r"(\d+) object-frames, detected by any pixel: (\d+) before, 0 after; 0 newly detected, (\d+) newly", shown
    )
    assert found[2] == found[3] != "0"
    assert "nothing against spherical, over everything: " in shown
    assert "too few recordings: IoU, all" in shown, "three recordings prove nothing"
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


def test_a_picture_that_would_not_show_what_was_scored_is_not_drawn(monkeypatch, capsys, runs, tmp_path):
    """The code of the reference has changed since the runs."""
    from bench.harness import frames

    build = frames.ReferenceBuilder.build

    def changed(self, image):
        reference = build(self, image)
        return replace(reference, ignored=~reference.ignored & (reference.labels == 0) & reference.valid)

    monkeypatch.setattr(frames.ReferenceBuilder, "build", changed)
    assert call(monkeypatch, "compare", runs / "spherical", runs / "nothing", "--out", tmp_path) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "no picture: recording" in shown
    assert "code or data changed since, so that a picture would not show what was scored" in shown
    assert "<img" not in (tmp_path / "compare.html").read_text()


def test_compare_refuses_what_does_not_compare_in_one_line(monkeypatch, capsys, runs, tmp_path):
    words = ("compare", runs / "spherical", runs / "extended", "--out", tmp_path / "out")
    assert "do not compare: protocol extended-v1" in error_line(monkeypatch, capsys, *words)
    assert not (tmp_path / "out").exists()


def test_compare_writes_beside_the_runs_of_the_house_without_out(monkeypatch, runs, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert call(monkeypatch, "compare", runs / "spherical", runs / "nothing", "--no-pictures") == 0
    made = sorted(file.name for file in (tmp_path / "reports" / "runs" / "compare-spherical-nothing").iterdir())
    assert made == ["compare.csv", "compare.html", "compare.md"]


def test_leaderboard_lists_groups_and_damaged_runs(monkeypatch, capsys, runs, tmp_path):
    assert call(monkeypatch, "leaderboard", runs, "--out", tmp_path) == 0
    shown = capsys.readouterr().out
    assert shown.count("Detection") >= 2
    assert str(tmp_path / "leaderboard.md") in shown
    damaged = shutil.copytree(runs / "nothing", runs / "damaged") / "paper-v1" / "summary.json"
    damaged.write_text("{")
    assert call(monkeypatch, "leaderboard", runs) == 2
    assert "not ranked: damaged/paper-v1: " in capsys.readouterr().out
