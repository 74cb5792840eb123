"""`compare` and `leaderboard`, on runs of the rendered data set."""

import json
from dataclasses import replace

import cv2
import pytest

from bench.evaluation import load_protocol
from bench.harness import RunRequest, run_benchmark
from bench.methods import build_method
from bench.recordings import load_card
from tests.cli.test_commands import call


@pytest.fixture(scope="module")
def runs(tiny_card, tmp_path_factory):
    """The paper's method, nothing, and the paper's method by another protocol."""
    folder = tmp_path_factory.mktemp("runs")
    for name, method, protocol in (
        ("spherical", "spherical", "paper-v1"),
        ("nothing", "nothing", "paper-v1"),
        ("extended", "nothing", "extended-v1"),
    ):
        run_benchmark(
            RunRequest(
                card=load_card(tiny_card),
                method=build_method(method),
                protocol=load_protocol(protocol),
                out=folder / name,
            )
        )
    return folder


def test_compare_ends_with_verdicts_files_and_titled_pictures(monkeypatch, capsys, runs, tmp_path):
    assert call(monkeypatch, "compare", runs / "spherical", runs / "nothing", "--out", tmp_path) == 0
    shown = capsys.readouterr().out
    stored = json.loads((tmp_path / "compare.json").read_text())["comparisons"][0]
    whole = stored["detections"][-1]
    assert whole["lost"] == whole["before"] > 0
    assert f"{whole['object_frames']} object-frames, detected: {whole['before']} before, 0 after; 0 newly" in shown
    assert "nothing against spherical, over everything: " in shown
    assert "too few recordings for a verdict: Detection rate" in shown, "three recordings prove nothing"
    assert stored["remarks"] == [], "processed again, every picture shows what was stored"
    assert [picture["file"] for picture in stored["pictures"]] == [
        "pictures/01-01-newly-missed.jpg",
        "pictures/01-02-newly-missed.jpg",
        "pictures/01-03-fewer-false-positives.jpg",
    ]
    for picture in stored["pictures"]:
        image = cv2.imread(str(tmp_path / picture["file"]))
        assert image.shape[1] > 1300, "both methods side by side"
        title = image[:60]
        assert (title < 100).any(), "letters"
        assert picture["title"].split(" (")[1] in (tmp_path / "compare.md").read_text()
    assert f"and 3 more files in {tmp_path / 'pictures'}" in shown


def test_pictures_show_what_was_scored_and_call_no_method(monkeypatch, capsys, runs, tmp_path):
    from bench.methods.baselines import Nothing
    from bench.methods.spherical.method import SphericalMethod

    def refuse(*_):
        raise AssertionError("a stored run calls its method")

    for kind in (Nothing, SphericalMethod):
        monkeypatch.setattr(kind, "segment", refuse)
    assert call(monkeypatch, "compare", runs / "spherical", runs / "nothing", "--out", tmp_path) == 0
    assert json.loads((tmp_path / "compare.json").read_text())["comparisons"][0]["remarks"] == []
    assert len(list((tmp_path / "pictures").iterdir())) == 3


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
    assert "no picture 01-01-newly-missed.jpg: recording" in shown
    assert "code or data changed since, so that a picture would not show what was scored" in shown
    assert not (tmp_path / "pictures").exists()


def test_compare_refuses_what_does_not_compare_in_one_line(monkeypatch, capsys, runs, tmp_path):
    assert call(monkeypatch, "compare", runs / "spherical", runs / "extended", "--out", tmp_path / "out") == 2
    shown = capsys.readouterr().err
    assert shown.startswith("error: ")
    assert "do not compare: protocol paper-v1" in shown
    assert shown.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_compare_writes_beside_the_runs_of_the_house_without_out(monkeypatch, runs, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert call(monkeypatch, "compare", runs / "spherical", runs / "nothing", "--no-pictures") == 0
    made = sorted(file.name for file in (tmp_path / "reports" / "runs" / "compare-spherical-nothing").iterdir())
    assert made == ["compare.csv", "compare.json", "compare.md", "object_changes.csv"]


def test_leaderboard_lists_groups_and_damaged_runs(monkeypatch, capsys, runs, tmp_path):
    assert call(monkeypatch, "leaderboard", runs, "--out", tmp_path) == 0
    shown = capsys.readouterr().out
    assert shown.count("Detection") >= 2
    assert str(tmp_path / "leaderboard.md") in shown
    (runs / "damaged").mkdir()
    (runs / "damaged" / "summary.json").write_text("{")
    assert call(monkeypatch, "leaderboard", runs) == 2
    assert "damaged: damaged: " in capsys.readouterr().out
