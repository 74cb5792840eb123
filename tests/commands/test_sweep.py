"""The command `sweep`: a run for each value, one table, one chart; exit status and what it prints."""

import csv
import json
import re

import pytest

from bench.errors import UsageError
from bench.methods.settings import parse_settings, parse_values
from tests.support.commands import call, error_line, output_of

UNLIKE = {"provenance": None, "sha256": None}  # of equal runs


def table(folder):
    return list(csv.DictReader((folder / "sweep.csv").open()))


def test_each_value_is_the_run_with_it_in_a_folder_of_its_own(monkeypatch, tiny_card, tmp_path):
    common = ("--set", "cell_size_px=8")
    words = ("sweep", tiny_card, *common, "--set", "threshold=2e-3,6e-4", "--out", tmp_path / "sweep")
    shown = output_of(*words)
    for name in ("sweep.html", "sweep.csv", "sweep.md"):
        assert (tmp_path / "sweep" / name).stat().st_size > 100
        assert str(tmp_path / "sweep" / name) in shown
    assert "threshold of spherical on tiny by surface-v1" in shown
    assert "2 values; 24 images answered" in shown
    rows = table(tmp_path / "sweep")
    assert [row["threshold"] for row in rows] == ["0.002", "0.0006"]
    run = ("run", tiny_card, *common, "--set", "threshold=0.002", "--protocol", "surface-v1", "--out", tmp_path / "run")
    assert call(monkeypatch, *run, "--no-pictures") == 0
    alone, value = (
        json.loads((place / "surface-v1" / "summary.json").read_text())
        for place in (tmp_path / "run", tmp_path / "sweep" / "0.002")
    )
    assert alone | UNLIKE == value | UNLIKE
    assert float(rows[0]["iou"]) == alone["all_moving"]["iou"]["value"]
    assert (tmp_path / "sweep" / "0.002" / "surface-v1" / "table.md").is_file()


@pytest.mark.slow
def test_a_second_call_finds_what_is_done_in_the_usual_folder(monkeypatch, capsys, tiny_card, tmp_path):
    monkeypatch.chdir(tmp_path)
    words = ("sweep", tiny_card, "--method", "background-subtraction", "--set", "shadows=false", "--split", "moving")
    answered = []
    for values in ("2,3", "2,3", "2,4"):
        assert call(monkeypatch, *words, "--set", f"images={values}") == 0
        answered.append(int(re.search(r"(\d+) images? answered", capsys.readouterr().out)[1]))
    assert answered == [16, 0, 8]
    (folder,) = (tmp_path / "reports" / "sweeps").iterdir()
    assert folder.name == "tiny-background-subtraction-shadows-False-moving-images"
    assert {entry.name for entry in folder.iterdir() if entry.is_dir()} == {"2", "3", "4"}


@pytest.mark.slow
def test_errors_of_the_input_are_swept_in_the_same_way(monkeypatch, capsys, tiny_card, tmp_path):
    words = ("sweep", tiny_card, "--input-error", "pitch_rate_degps=0,4", "--out", tmp_path, "--split", "moving")
    assert "the reference keeps the true calibration" in " ".join(output_of(*words).split())
    assert "the reference keeps the true calibration" in (tmp_path / "sweep.md").read_text()
    true, wrong = table(tmp_path)
    assert float(wrong["false_positive_coverage"]) > float(true["false_positive_coverage"]) + 0.1
    assert wrong["object_frames"] == true["object_frames"]
    late = ("--method", "nothing", "--input-error", "time_offset_ms=0,550", "--out", tmp_path / "late")
    assert call(monkeypatch, "sweep", tiny_card, *late) == 2, "some images cannot be used"
    assert "failed: 550: " in capsys.readouterr().out
    assert "pitch_rate_degps 4" in json.loads((tmp_path / "4" / "surface-v1" / "summary.json").read_text())["caveats"]


def test_settings_nest_numbers_are_numbers_and_values_are_yaml_between_commas():
    parsed = parse_settings(["weights.anti_parallel=0", "threshold=6e-4", "flow=dis", "root_sum=true"])
    assert parsed == {"weights": {"anti_parallel": 0}, "threshold": 6e-4, "flow": "dis", "root_sum": True}
    for texts, message in (
        (["weights=1", "weights.epipolar=2"], "already has the value"),
        (["flow=["], "a YAML value"),
    ):
        with pytest.raises(UsageError, match=message):
            parse_settings(texts)
    assert parse_values("x", "1e-4, 3,dis") == [1e-4, 3, "dis"]
    assert parse_values("x", "[1,2],[3]") == [[1, 2], [3]]
    assert parse_values("x", "{epipolar: 0},{}") == [{"epipolar": 0}, {}]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--set", "treshold=1,2"), "did you mean 'threshold'"),
        (("--set", "threshold=1e-3,many"), "spherical: expected a valid number for threshold, got 'many'"),
        (("--set", "threshold=1e-3,,2e-3"), "expected values of YAML with commas in between"),
        (("--set", "threshold=1e-3"), "expected one --set or --input-error with several values"),
        (("--set", "threshold=1,2", "--set", "cell_size_px=5,8"), "threshold=3e-4,6e-4,1e-3, got 2"),
        (("--set", "threshold=1,2", "--method", "nothing"), "known are none"),
        (("--input-error", "pitch=1,2"), "did you mean 'pitch_deg'"),
        (("--input-error", "pitch_deg=1,far"), "input error pitch_deg: expected a number, got 'far'"),
        (("--input-error", "image_noise_grey=0,-1"), "expected a number of at least 0"),
        (("--set", "threshold=1,2", "--split", "test"), "known are all, crossing, moving"),
        (("--set", "threshold=1,2", "--protocol", "paper-v1,surface-v1"), "expected one protocol"),
    ],
)
def test_mistakes_are_one_clear_line_and_status_2(monkeypatch, capsys, tiny_card, tmp_path, words, message):
    assert message in error_line(monkeypatch, capsys, "sweep", tiny_card, "--out", tmp_path / "sweep", *words)
    assert not (tmp_path / "sweep").exists()
