"""The reference scored against itself, through the public command: all is perfect, or the evaluation is wrong."""

import pytest

from bench.cli import main
from bench.evaluation import load_protocol
from bench.harness import build_scorable, read_run, run_benchmark, scorable_methods
from bench.methods import build_method, known_methods
from bench.recordings import load_card


def call(monkeypatch, *words) -> int:
    monkeypatch.setattr("sys.argv", ["fisheye-bench", *map(str, words)])
    try:
        main()
    except SystemExit as end:
        return int(end.code or 0)
    return 0


@pytest.mark.parametrize("protocol", ["paper-v1", "extended-v1"])
def test_the_reference_scores_perfectly(tiny_card, tmp_path, monkeypatch, protocol):
    out = tmp_path / "run"
    words = ("--method", "reference", "--protocol", protocol, "--out", out, "--no-pictures")
    assert call(monkeypatch, "run", tiny_card, *words) == 0
    summary = read_run(out)
    assert summary.all_moving.object_frames >= 12
    for figures in (summary.all_moving, summary.categories["crossing"], summary.categories["static_ego"]):
        for name in (
            "detection_rate",
            "detection_rate_10",
            "detection_rate_50",
            "tpr",
            "tpr_all",
            "iou",
            "iou_detected",
        ):
            assert figures.figure(name).value == 1.0
    assert summary.false_positives.coverage.value == summary.false_positives.frame_rate.value == 0.0
    assert summary.images.evaluated == 12
    # The stamp tells that this is no method.
    assert summary.method.name == "reference"
    assert summary.method.settings == {"sees_the_reference": True}


def test_it_compares_with_methods_on_the_same_images(tiny_card, tmp_path):
    fingerprints = {
        run_benchmark(
            load_card(str(tiny_card)),
            method=build_scorable(name),
            protocol=load_protocol("paper-v1"),
            out=tmp_path / name,
        ).reference_fingerprint
        for name in ("reference", "nothing", "background-subtraction", "spherical-sparse")
    }
    assert len(fingerprints) == 1


def test_it_is_no_method(monkeypatch, tiny_card, capsys):
    assert "reference" not in known_methods()
    assert set(scorable_methods()) == {"reference", *known_methods()}
    assert call(monkeypatch, "sweep", tiny_card, "--what", "min_points", "--method", "reference") == 2
    assert "unknown method 'reference'" in capsys.readouterr().err
    with pytest.raises(Exception, match="sees the reference and nothing else"):
        build_scorable("reference", {"sees_the_reference": False})
    assert build_scorable("nothing").settings() == build_method("nothing").settings()


def test_it_can_be_looked_at(tiny_card, tmp_path, monkeypatch):
    assert call(monkeypatch, "view", tiny_card, "--method", "reference", "--out", tmp_path) == 0
    assert list(tmp_path.rglob("*.png"))


def test_methods_are_listed_with_a_line_each(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "200")
    assert call(monkeypatch, "methods") == 0
    listed = capsys.readouterr().out
    for name in scorable_methods():
        assert f"\n {name} " in f"\n{listed}"
    assert "MOG2" in listed


def test_visual_odometry_refuses_what_needs_scale_in_one_line(monkeypatch, tiny_card, tmp_path, capsys):
    words = ("--method", "spherical-visual-odometry", "--set", "weights.positive_height=0.2", "--out", tmp_path / "run")
    assert call(monkeypatch, "run", tiny_card, *words) == 2
    assert "need the length of the translation, which images do not show" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
