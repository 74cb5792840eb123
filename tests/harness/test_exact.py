"""The reference scored against itself is perfect, or the evaluation is wrong; exact masks are the ceiling."""

import shutil

import cv2
import numpy as np
import pytest

from bench.errors import UsageError
from bench.harness.exact import ReferenceItself, build_scorable, moving_instances, scorable_methods
from bench.harness.frames import FramePipeline
from bench.harness.stored import read_run
from bench.methods import build_method, known_methods
from bench.recordings import load_card, open_dataset, read_truth
from tests.support.changed_data import without_scenario
from tests.support.commands import call
from tests.support.runs import PAPER, score


@pytest.mark.parametrize("protocol", ["paper-v1", "extended-v1", "surface-v1"])
def test_the_reference_scores_perfectly(tiny_card, tmp_path, monkeypatch, protocol):
    out = tmp_path / "run"
    words = ("--method", "reference", "--protocol", protocol, "--out", out, "--no-pictures")
    assert call(monkeypatch, "run", tiny_card, *words) == 0
    summary = read_run(out).summary
    assert summary.all_moving.object_frames >= 12
    for figures in (summary.all_moving, summary.categories["crossing"], summary.categories["static_ego"]):
        rates = "detection_rate", "detection_rate_10", "detection_rate_50"
        assert {figures.metric(name).value for name in (*rates, "tpr", "tpr_all", "iou", "iou_detected")} == {1.0}
    assert summary.false_positives.coverage.value == summary.false_positives.frame_rate.value == 0.0
    assert summary.images.evaluated == 12
    # The manifest tells that this is no method.
    method = read_run(out).manifest.method
    assert method.name == "reference"
    assert method.settings == {"sees_the_reference": True}


def test_it_is_no_method(monkeypatch, tiny_card, capsys):
    assert "reference" not in known_methods()
    assert set(scorable_methods()) == {"reference", "truth", *known_methods()}
    assert call(monkeypatch, "audit", tiny_card, "--method", "reference") == 2
    assert "unknown method 'reference'" in capsys.readouterr().err
    with pytest.raises(Exception, match="unknown setting of reference"):
        build_scorable("reference", {"sees_the_reference": False})
    assert build_scorable("nothing").settings() == build_method("nothing").settings()


def truth_frame(tiny_card, index=2):
    """An image of a simulated drive with the answer of its exact masks, and the true instance ids."""
    handle = next(h for h in open_dataset(load_card(str(tiny_card))) if h.name == "crossing")
    recording = handle.open()
    pipeline = FramePipeline(recording, "front", method=build_scorable("truth"), protocol=PAPER)
    frame = pipeline.process(index)
    return frame, read_truth(frame.image, recording.cameras["front"]), moving_instances(recording, frame.reference)


def test_the_exact_masks_are_the_pixels_of_what_moves(tiny_card):
    frame, ids, moving = truth_frame(tiny_card)
    assert moving
    assert np.array_equal(frame.segmentation.mask, np.isin(ids, moving))


def test_exact_masks_are_scored_and_marked_and_follow_their_files(own_card, tmp_path):
    summary = score(own_card, tmp_path / "run", method="truth")
    assert read_run(tmp_path / "run").manifest.method.settings["sees_the_truth"] is True
    assert summary.all_moving.metric("detection_rate").value > 0.9
    file = sorted(own_card.parent.glob("data/tiny/crossing/truth/front/*.png"))[2]
    cv2.imwrite(str(file), np.zeros_like(cv2.imread(str(file), cv2.IMREAD_UNCHANGED)))
    again = score(own_card, tmp_path / "run", method="truth", overwrite=True)
    assert again.provenance.images_asked == 4
    assert again.all_moving.metric("tpr_all").value < summary.all_moving.metric("tpr_all").value


def test_data_without_exact_masks_have_no_ceiling(own_card, tmp_path, monkeypatch, capsys):
    shutil.rmtree(own_card.parent / "data" / "tiny" / "crossing" / "truth")
    without_scenario(own_card)
    words = ("--method", "truth", "--protocol", "paper-v1", "--out", tmp_path / "run", "--no-pictures")
    call(monkeypatch, "run", own_card, *words)
    assert "expected exact masks" in capsys.readouterr().out


def test_nobody_else_is_answered_for(tiny_card):
    class Answers(ReferenceItself):
        """Has all that an oracle has, and is none."""

    handle = open_dataset(load_card(str(tiny_card)))[0]
    pipeline = FramePipeline(handle.open(), "front", method=Answers(), protocol=PAPER)
    with pytest.raises(UsageError, match=r"derived from bench\.methods\.Method, got Answers"):
        pipeline.process(2)
