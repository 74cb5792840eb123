"""Functions of the commands: what they return, and what they refuse; what is computed and written is tested there."""

import json
import shutil

import cv2
import numpy as np
import pytest

import bench
from bench.commands import console
from bench.errors import DataError, UnknownNameError, UsageError


@pytest.fixture(scope="module")
def folder(tiny_card, tmp_path_factory):
    """Two runs of the same data, for all functions that read runs."""
    folder = tmp_path_factory.mktemp("runs")
    for method in ("frame-difference", "nothing"):
        bench.run(tiny_card, method, protocol="paper-v1", pictures=False, out=folder / method)
    return folder


@pytest.fixture
def runs(folder):
    return folder / "frame-difference", folder / "nothing"


@pytest.mark.slow
def test_functions_print_nothing(runs, tiny_card, tmp_path, capfd):
    console.be_silent()  # as a process is that has run no command line
    bench.compare(*runs, out=tmp_path / "c", pictures=False)
    (recording,) = bench.validate(tiny_card, split="crossing", deep=True).recordings
    assert (recording.name, recording.images.read) == ("crossing", recording.images.all)
    bench.verify(runs[0])
    bench.view(tiny_card, recording="crossing", frame=3, out=tmp_path / "p")
    assert capfd.readouterr() == ("", "")


def test_every_name_is_there_and_loaded_from_its_module():
    for name in bench.__all__:
        assert getattr(bench, name).__name__ == name
        assert getattr(bench, name).__doc__


def test_a_comparison_takes_folders_and_runs_and_writes_where_it_is_told(runs, tmp_path):
    before, after = bench.load_run(runs[0]), str(runs[1])
    found = bench.compare(before, after, out=tmp_path / "c", pictures=False)
    (pair,) = found.pairs
    assert tmp_path / "c" / "compare.html" in found.files
    assert pair.detections["after"].iloc[-1] == 0
    with pytest.raises(UsageError, match="at least two runs"):
        bench.compare(before)


def test_a_verdict_is_that_of_the_command(runs, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(bench.MissingBaselineError, match="no baseline there"):
        bench.judge(runs[0])
    made = bench.update_baseline(runs[0], allow_dirty=True)
    assert (made.difference, made.replaced) == (None, "the first baseline of this name")
    assert made.why_few == ": 3 recordings, 6 needed"
    verdict, same = bench.judge(runs[1]), bench.judge(bench.load_run(runs[1]), made.folder)
    assert repr(verdict) == repr(same)
    assert repr(verdict.rows) == repr(bench.judge(runs[1], runs[0]).rows)
    assert not verdict.passed
    again = bench.update_baseline(runs[0], allow_dirty=True)
    assert repr(again.difference) == repr(bench.judge(runs[0]))
    with pytest.raises(UnknownNameError, match="tolerances"):
        bench.judge(runs[0], tolerances="strict")


def test_a_ci_server_is_told_why_there_is_no_verdict(runs, tmp_path):
    refused = bench.refused_verdict(runs[0], reason="no baseline there")
    assert (refused.passed, refused.why_none, refused.dataset) == (False, "no baseline there", "tiny")
    assert bench.refused_verdict(tmp_path / "none", reason="damaged").run is None
    bench.write_verdict(refused, junit=str(tmp_path / "gate.xml"), json=tmp_path / "gate.json")
    assert "no baseline there" in (tmp_path / "gate.xml").read_text()
    assert json.loads((tmp_path / "gate.json").read_text())["passed"] is False


def test_a_run_is_verified(runs, tiny_card, tmp_path):
    sent = shutil.copytree(runs[0], tmp_path / "sent")
    next(sent.rglob("*.frames.parquet")).unlink()
    assert "a row that only one of the two has" in "".join(bench.verify(bench.load_run(sent), tiny_card).differences)


def test_runs_are_ranked(folder, tmp_path):
    ranked = bench.leaderboard(folder)
    ((first, second),) = [group.entries for group in ranked.found.groups]
    assert (first.method, second.method) == ("frame-difference", "nothing")
    assert ranked.files == ()
    written = bench.leaderboard(str(folder), out=tmp_path / "board")
    assert written.files[0] == tmp_path / "board" / "index.html"


def test_a_method_is_scored_for_a_leaderboard(tiny_card, tmp_path):
    ranked = bench.leaderboard(tmp_path, score=[str(tiny_card)], methods="nothing", protocol="surface-v1")
    assert ranked.scored == ("tiny, nothing: 12 images answered, the others were there",)
    assert (ranked.left_out, ranked.failures) == ((), 0)
    folder = tmp_path / "tiny" / "nothing" / "surface-v1"
    assert bench.load_run(folder).manifest.protocol.name == "surface-v1"
    assert (folder / "index.html").is_file()


@pytest.mark.slow
def test_parts_of_settings_and_errors_of_the_input_are_swept(tiny_card, tmp_path):
    chosen = {"method": "spherical", "split": "standing"}
    swept = bench.sweep(tiny_card, settings={"weights.epipolar": [0.0, 1.0]}, out=tmp_path / "a", **chosen)
    assert list(swept.runs) == ["0.0", "1.0"]
    weights = [run.manifest.method.settings["weights"] for run in swept.runs.values()]
    assert [weight["epipolar"] for weight in weights] == [0.0, 1.0]
    nested = bench.sweep(tiny_card, settings={"weights": {"epipolar": [0.0, 1.0]}}, out=tmp_path / "a", **chosen)
    assert sum(run.summary.provenance.images_asked for run in nested.runs.values()) == 0
    wrong = bench.sweep(tiny_card, input_errors={"pitch_deg": [0, 2]}, out=tmp_path / "b", **chosen)
    assert list(wrong.runs) == ["0", "2"]
    assert (wrong.folder / "2" / "paper-v1" / "summary.json").is_file()
    with pytest.raises(UsageError, match="'weights' already has the value 1"):
        bench.sweep(tiny_card, settings={"weights": 1, "weights.epipolar": [0.0, 1.0]}, **chosen)
    with pytest.raises(UsageError, match="got none"):
        bench.sweep(tiny_card, settings={"threshold": []}, **chosen)


def test_masks_of_a_folder_are_scored(tiny_card, tmp_path):
    for number, frame in enumerate(bench.open_dataset(tiny_card).frames(recordings=["crossing"])):
        file = tmp_path / "masks" / frame.recording / frame.camera / f"{frame.timestamp_ns}.png"
        file.parent.mkdir(parents=True, exist_ok=True)
        if number:
            cv2.imwrite(str(file), (frame.reference.labels > 0).astype(np.uint8))
    chosen = {"split": "crossing", "out": tmp_path / "run"}
    with pytest.raises(DataError, match="1 missing"):
        bench.evaluate(tiny_card, tmp_path / "masks", **chosen)
    scored = bench.evaluate(tiny_card, str(tmp_path / "masks"), missing="skip", name="mine", **chosen)
    assert (len(scored.found.usable), scored.found.expected) == (3, 4)
    assert scored.run.summary.all_moving.iou.value == 1.0
    assert scored.run.manifest.method.name == "mine"
    assert (scored.run.folder / "predictions.json").is_file()
    with pytest.raises(UsageError, match="another name than those of methods"):
        bench.evaluate(tiny_card, tmp_path / "masks", name="spherical", **chosen)


def test_frames_are_drawn_and_unknown_names_refused(tiny_card, tmp_path):
    found = bench.view(tiny_card, method="nothing", frame=3, out=str(tmp_path / "one"))
    assert tmp_path / "one" / "areas.png" in found.files
    (picture,) = bench.view(tiny_card, calibration=True, recording="crossing", frame=3, out=tmp_path / "lens").files
    assert picture.name == "calibration.png"
    with pytest.raises(UsageError, match="the name of the method"):
        bench.view(tiny_card, settings={"threshold": 1})
    with pytest.raises(UnknownNameError, match="camera"):
        bench.view(tiny_card, camera="rear")
    with pytest.raises(UnknownNameError):
        bench.validate(tiny_card, split="none")
