"""Whether references rank as the truth does: numbers that can be checked by hand, then a whole ranking."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bench.evaluation.protocol import load_protocol
from bench.methods import build_method
from bench.recordings import load_card
from benchmarks.ranking.__main__ import main
from benchmarks.ranking.agreement import Ranking, correlation_between, rank_correlation, ranking_of
from benchmarks.ranking.predictions import Prediction
from benchmarks.ranking.ranking_report import wins
from benchmarks.ranking.sums import EXACT, FITS, PAPER, REFERENCES, SCORED, SURFACE, RankingRows
from benchmarks.ranking.wrong_masks import WrongMasks
from tests.evaluation.frames import mask, picture, reference_frame
from tests.support.runs import run_one

ANY = [Prediction(name=name, method=build_method(name)) for name in ("everything", "nothing", "frame-difference")]


def wrong(*masks: WrongMasks) -> list[Prediction]:
    return [Prediction(name=str(number), method=method) for number, method in enumerate(masks)]


def ranked(*, by_lidar: list[float], by_masks: list[float], recordings: int = 1, predictions=ANY) -> Ranking:
    """Predictions with these IoU: one crossing object-frame a recording, all lidar references alike."""
    iou = np.broadcast_to(by_lidar, (recordings, len(REFERENCES), len(predictions))).copy()
    iou[:, -1] = by_masks
    names = [prediction.name for prediction in predictions]
    every = pd.MultiIndex.from_product(
        [[f"drive-{k}" for k in range(recordings)], REFERENCES, names], names=["recording", "reference", "prediction"]
    )
    sums = pd.DataFrame({"numerator": iou.ravel(), "denominator": 1.0}, index=every).reset_index()
    fits = pd.DataFrame({"object_class": ["vehicle"], "range_m": ["[0, 2)"], "ego_speed_mps": ["[1, 3)"]})
    fits = fits.assign(**dict.fromkeys(FITS, 1.0))
    return ranking_of(sums.assign(slice="crossing", metric="iou"), fits, predictions, stored=None)


def agreement_of(**given) -> pd.Series:
    return ranked(**given).agreement.loc[("crossing", PAPER)]


@pytest.mark.parametrize(
    ("by_lidar", "tau", "difference"),
    [
        ([0.1, 0.5, 0.9], 1, 0.0),
        ([0.9, 0.5, 0.1], -1, (0.8 + 0 + 0.8) / 3),
        ([0.0, 0.4, 0.6], 1, (0.1 + 0.1 + 0.3) / 3),
    ],
    ids=["the scores of the truth", "the reversed order", "other scores in the same order"],
)
def test_a_reference_agrees_with_the_truth_in_order_and_scores(by_lidar, tau, difference):
    found = ranked(by_lidar=by_lidar, by_masks=[0.1, 0.5, 0.9])
    for reference in (PAPER, SURFACE):
        agreement = found.agreement.loc[("crossing", reference)]
        assert agreement["tau"].value == pytest.approx(tau)
        assert agreement["difference"].value == agreement["difference_real"].value == pytest.approx(difference)
        assert found.of_motion(reference, "difference") == pytest.approx(difference)


def test_ties_count_as_kendall_says():
    # Of three pairs two agree and one is tied in x: 2 / sqrt(2 * 3).
    assert rank_correlation(np.array([1.0, 2, 2]), np.array([1.0, 2, 3])) == pytest.approx(2 / 6**0.5)
    assert np.isnan(rank_correlation(np.zeros(3), np.array([1.0, 2, 3])))


def test_what_is_made_of_exact_masks_is_no_real_method():
    predictions = [*ANY[:2], *wrong(WrongMasks())]
    found = agreement_of(by_lidar=[0.2, 0.5, 0.6], by_masks=[0.1, 0.5, 1.0], predictions=predictions)
    assert found["difference"].value == pytest.approx((0.1 + 0 + 0.4) / 3)
    assert found["difference_real"].value == pytest.approx((0.1 + 0) / 2)


def test_intervals_need_six_recordings(monkeypatch):
    monkeypatch.setattr("benchmarks.ranking.agreement.DRAWS", 100)
    scores = {"by_lidar": [0.2, 0.5, 0.9], "by_masks": [0.1, 0.5, 0.9]}
    assert agreement_of(**scores, recordings=5)["tau"].ci95 is None
    found = agreement_of(**scores, recordings=6)
    assert found["tau"].ci95 == pytest.approx((1, 1))
    assert found["difference"].ci95 == pytest.approx((0.1 / 3, 0.1 / 3))  # all recordings are alike


def test_a_wrong_mask_that_beats_the_exact_one_is_found():
    predictions = wrong(WrongMasks(), WrongMasks(shape="hull"), WrongMasks(grow_px=4), WrongMasks(drop_share=0.5))
    found = ranked(by_lidar=[0.6, 0.7, 0.5, 0.61], by_masks=[1.0, 0.8, 0.5, 0.4], predictions=predictions)
    assert [*wins(found, PAPER)] == [("crossing", "1"), ("crossing", "3")]
    assert [*wins(found, EXACT)] == []


def test_errors_of_outlines_and_of_objects_are_told_apart():
    outlines, objects = [{"shape": "hull"}, {"grow_px": 4}], [{"shape": "feet"}, {"drop_share": 0.5}]
    predictions = [ANY[0], *wrong(WrongMasks(), *(WrongMasks(**how) for how in outlines + objects))]
    by_lidar, by_masks = [0.1, 0.9, 0.85, 0.8, 0.2, 0.3], [0.2, 1.0, 0.7, 0.6, 0.5, 0.65]
    found = agreement_of(by_lidar=by_lidar, by_masks=by_masks, predictions=predictions)
    assert found["points_outlines"] == pytest.approx((0.15 + 0.2) / 2)  # too high
    assert found["points_objects"] == pytest.approx((-0.3 - 0.35) / 2)  # too low
    assert found["tau_outlines"] == found["tau_objects"] == pytest.approx(1)  # each in order, the exact one first
    # Of the four pairs of a hull-shaped or fat and a missed or halved one, fat and missed change places.
    assert found["tau_between"] == pytest.approx((3 - 1) / 4)


def test_pairs_of_one_kind_do_not_count_between_kinds():
    kinds = ["outlines", "outlines", "objects", None]
    found = correlation_between(np.array([3.0, 1, 2, 9]), np.array([3.0, 1, 1, 0]), kinds)
    assert found == pytest.approx(1 / 2**0.5)  # one agrees, one is tied by masks
    assert np.isnan(correlation_between(np.ones(2), np.ones(2), ["outlines", "outlines"]))


def test_sums_of_an_image():
    frame = reference_frame(picture("11.\n11.\n..."))
    half = mask("#..\n#..\n..#")  # 2 of the object's 4 px, and 1 of 9 elsewhere
    unknown = replace(frame, objects=(replace(frame.objects[0], unknown_px=1),))
    rows = RankingRows(["half", "all"], component_size_px=0)
    rows.add([frame, frame, frame, unknown, frame], [half, np.ones((3, 3), dtype=bool)])
    sums = rows.scores().set_index(["slice", "metric", *SCORED])[["numerator", "denominator"]]
    of_half, of_all = sums.xs((PAPER, "half"), level=SCORED[:2]), sums.xs((PAPER, "all"), level=SCORED[:2])
    for name in ("crossing", "all_moving"):
        assert tuple(of_half.loc[(name, "iou", "drive")]) == (0.5, 1)
        assert tuple(of_half.loc[(name, "unknown_share", "drive")]) == (0, 1)
        assert of_all.loc[(name, "iou", "drive"), "numerator"] == pytest.approx(4 / 9)
        assert sums.loc[(name, "unknown_share", SURFACE, "half", "drive"), "numerator"] == 1 / 5
    false = [of.loc[("false_positives", "false_positive_coverage", "drive"), "numerator"] for of in (of_half, of_all)]
    assert false == pytest.approx([1 / 9, 5 / 9])
    assert "overtaking" not in sums.index.get_level_values("slice")
    assert rows.fits()[FITS].to_numpy().tolist() == [[1, 4, 0, 4, 0, 0.2]]


METHODS = "spherical,epipolar-only,background-subtraction,everything,nothing,truth,truth:grow_px=4,truth:shape=feet"


@pytest.mark.slow
def test_a_ranking_scores_as_runs_do_and_leaves_its_tables(monkeypatch, capsys, tiny_card, tmp_path):
    words = (tiny_card, "--methods", METHODS, "--workers", 1, "--out", tmp_path)
    monkeypatch.setattr("sys.argv", ["ranking", *map(str, words)])
    main()
    shown = capsys.readouterr().out
    for name in ("ranking.md", "ranking.png", "ranking.svg"):
        assert str(tmp_path / name) in shown
        assert (tmp_path / name).stat().st_size > 100
    text = (tmp_path / "ranking.md").read_text()
    run = run_one(
        card=load_card(tiny_card), method=build_method("spherical"), protocol=load_protocol(PAPER), out=tmp_path / "run"
    )
    of_all, of_images = text.partition("## All moving: IoU")[2].split("## False positives: area")
    assert "| truth | " in of_all
    assert of_all.split("| truth |")[1].splitlines()[0].split(" | ")[-1].rstrip(" |") == "100.0"
    assert f"{run.all_moving.object_frames} frames of 3 recordings" in of_all
    scored = [part.split("| spherical |")[1].split(" | ")[0].strip() for part in (of_all, of_images)]
    metrics = run.all_moving.iou.value, run.false_positives.coverage.value
    assert scored == [f"{100 * value:.1f}" for value in metrics]
