"""The command `sweep`: exit status, what it prints, which files it leaves."""

import pytest

from bench.harness.sweep import SWEEPS
from tests.support.commands import call, error_line


def test_sweep_leaves_table_and_chart_and_ends_with_the_table(monkeypatch, capsys, tiny_card, tmp_path):
    words = (
        "sweep",
        tiny_card,
        "--what",
        "error.yaw_rate",
        "--values",
        "-2,2",
        "--out",
        tmp_path,
        "--cache",
        tmp_path / "cache",
    )
    assert call(monkeypatch, *words, "--split", "moving") == 0
    shown = capsys.readouterr().out
    for name in ("sweep.json", "sweep.csv", "sweep.md", "sweep.png", "sweep.svg", "sweep.pdf"):
        assert (tmp_path / "error.yaw_rate" / name).stat().st_size > 100
        assert str(tmp_path / "error.yaw_rate" / name) in shown
    for text in ("bias of the yaw rate (deg/s)", "-2 ", "0 * ", "3 values on 8 images", "flow computed 8 times"):
        assert text in shown
    assert len(list((tmp_path / "cache").glob("flow/*/*.npz"))) == 8


def test_sweep_list_names_every_sweep_with_its_values(monkeypatch, capsys, tiny_card):
    assert call(monkeypatch, "sweep", tiny_card, "--what", "list") == 0
    shown = capsys.readouterr().out
    assert all(f" {name} " in shown for name in SWEEPS)
    assert "0.0006" in shown


def test_images_that_cannot_be_used_are_said_and_the_status_is_2(monkeypatch, capsys, tiny_card, tmp_path):
    words = ("sweep", tiny_card, "--what", "error.time", "--values", "550", "--out", tmp_path, "--split", "moving")
    assert call(monkeypatch, *words) == 2
    assert "failed: " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--what", "tresholds"), "did you mean 'threshold'"),
        (("--what", "threshold", "--values", "1e-3,many"), "expected a number (threshold"),
        (("--what", "threshold", "--values", "1e-3,,2e-3"), "expected values with commas in between"),
        (("--what", "ablation", "--values", "without epipolr"), "did you mean 'without epipolar'"),
        (
            ("--what", "threshold", "--method", "nothing"),
            "expected a method with the parameter 'threshold', got 'nothing'",
        ),
        (("--what", "threshold", "--split", "test"), "known are all, moving"),
    ],
)
def test_mistakes_are_one_clear_line_and_status_2(monkeypatch, capsys, tiny_card, tmp_path, words, message):
    assert message in error_line(monkeypatch, capsys, "sweep", tiny_card, "--out", tmp_path, *words)
