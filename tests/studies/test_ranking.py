"""Whether references rank as the truth does: numbers that can be checked by hand, then a whole ranking."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bench.evaluation import load_protocol
from bench.methods import build_method
from bench.recordings import load_card
from benchmarks.ranking.__main__ import main
from benchmarks.ranking.agreement import (
    RankedRow,
    RankingSummary,
    correlation_between,
    rank_correlation,
    rank_row,
)
from benchmarks.ranking.predictions import Prediction
from benchmarks.ranking.ranking_report import (
    ranking_tables,
)
from benchmarks.ranking.sums import (
    EXACT,
    FITS,
    PAPER,
    REFERENCES,
    SCORED,
    SURFACE,
    RankingRows,
)
from benchmarks.ranking.wrong_masks import WrongMasks
from tests.evaluation.frames import mask, picture, reference_frame
from tests.support.runs import run_one

WRONG = (WrongMasks(shape="hull"), WrongMasks(grow_px=4), WrongMasks(drop_share=0.5))
ANY = [Prediction(name=name, method=build_method(name)) for name in ("everything", "nothing", "frame-difference")]


def row(*, by_lidar: list[float], by_masks: list[float], recordings: int = 1, predictions=ANY) -> RankedRow:
    """A row of predictions with these IoU: one object-frame a recording, all lidar references alike."""
    values = np.broadcast_to(by_lidar, (recordings, len(REFERENCES), len(predictions))).copy()
    values[:, -1] = by_masks
    return rank_row("crossing", scores(values, predictions), predictions)


def scores(iou: np.ndarray, predictions, *, cases: np.ndarray | float = 1.0) -> pd.DataFrame:
    """Sums of one row, (recordings, references, predictions)."""
    names = [prediction.name for prediction in predictions]
    every = pd.MultiIndex.from_product(
        [[f"drive-{k}" for k in range(len(iou))], REFERENCES, names], names=["recording", "reference", "prediction"]
    )
    terms = {"numerator": iou.ravel(), "denominator": np.broadcast_to(cases, iou.shape).ravel()}
    return pd.DataFrame(terms, index=every).reset_index().assign(slice="crossing", metric="iou")


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
    found = row(by_lidar=by_lidar, by_masks=[0.1, 0.5, 0.9])
    for reference in (PAPER, SURFACE):
        agreement = found.agreement[reference]
        assert agreement.tau.value == pytest.approx(tau)
        assert agreement.difference.value == pytest.approx(difference)
        assert agreement.difference_real.value == pytest.approx(difference)


def test_ties_count_as_kendall_says():
    # Of three pairs two agree and one is tied in x: 2 / sqrt(2 * 3).
    assert rank_correlation(np.array([1.0, 2, 2]), np.array([1.0, 2, 3])) == pytest.approx(2 / 6**0.5)
    assert np.isnan(rank_correlation(np.zeros(3), np.array([1.0, 2, 3])))


def test_what_is_made_of_exact_masks_is_no_real_method():
    predictions = [*ANY[:2], Prediction(name="truth", method=WrongMasks())]
    found = row(by_lidar=[0.2, 0.5, 0.6], by_masks=[0.1, 0.5, 1.0], predictions=predictions).agreement[PAPER]
    assert found.difference.value == pytest.approx((0.1 + 0 + 0.4) / 3)
    assert found.difference_real.value == pytest.approx((0.1 + 0) / 2)


def test_intervals_need_six_recordings(monkeypatch):
    monkeypatch.setattr("benchmarks.ranking.agreement.DRAWS", 100)
    assert row(by_lidar=[0.1, 0.5, 0.9], by_masks=[0.1, 0.5, 0.9], recordings=5).agreement[PAPER].tau.ci95 is None
    found = row(by_lidar=[0.2, 0.5, 0.9], by_masks=[0.1, 0.5, 0.9], recordings=6).agreement[PAPER]
    assert found.tau.ci95 == pytest.approx((1, 1))
    assert found.difference.ci95 == pytest.approx((0.1 / 3, 0.1 / 3))  # all recordings are alike


def test_a_wrong_mask_that_beats_the_exact_one_is_found():
    predictions = [Prediction(name=str(k), method=m) for k, m in enumerate((WrongMasks(), *WRONG))]
    by_lidar, by_masks = [0.6, 0.7, 0.5, 0.61], [1.0, 0.8, 0.5, 0.4]
    scored = row(by_lidar=by_lidar, by_masks=by_masks, predictions=predictions)
    found = RankingSummary.model_construct(rows=(scored,), errors=dict.fromkeys("123", "outlines"), ceiling="0")
    assert found.wins(PAPER) == (("crossing", "1"), ("crossing", "3"))
    assert found.wins(EXACT) == ()


def test_errors_of_outlines_and_of_objects_are_told_apart():
    methods = (WrongMasks(), *WRONG[:2], WrongMasks(shape="feet"), *WRONG[2:])
    predictions = [*ANY[:1], *(Prediction(name=str(k), method=method) for k, method in enumerate(methods))]
    by_lidar, by_masks = [0.1, 0.9, 0.85, 0.8, 0.2, 0.3], [0.2, 1.0, 0.7, 0.6, 0.5, 0.65]
    found = row(by_lidar=by_lidar, by_masks=by_masks, predictions=predictions).agreement[SURFACE]
    outlines, objects = found.by_kind["outlines"], found.by_kind["objects"]
    assert (outlines.predictions, objects.predictions) == (2, 2)
    assert outlines.signed_difference == pytest.approx((0.15 + 0.2) / 2)  # too high
    assert objects.signed_difference == pytest.approx((-0.3 - 0.35) / 2)  # too low
    assert outlines.tau == objects.tau == pytest.approx(1)  # each in order, the exact one first
    # Of the four pairs of a hull-shaped or fat and a missed or halved one, fat and missed change places.
    assert found.tau_between == pytest.approx((3 - 1) / 4)


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
    for name in ("crossing", "all_moving"):
        terms = sums.loc[name].xs((PAPER, "half", "drive"), level=SCORED)
        assert {metric: tuple(values) for metric, values in terms.T.items()} == {
            "iou": (0.5, 1),
            "unknown_share": (0, 1),
        }
        assert sums.loc[(name, "iou", PAPER, "all", "drive"), "numerator"] == pytest.approx(4 / 9)
        assert sums.loc[(name, "unknown_share", SURFACE, "half", "drive"), "numerator"] == 1 / 5
    first, whole = (
        sums.loc[("false_positives", "false_positive_coverage", PAPER, name, "drive"), "numerator"]
        for name in ("half", "all")
    )
    assert (first, whole) == (pytest.approx(1 / 9), pytest.approx(5 / 9))
    assert "overtaking" not in sums.index.get_level_values("slice")
    (fit,) = rows.fits()[FITS].to_numpy().tolist()
    assert fit == [1, 4, 0, 4, 0, 0.2]


METHODS = "spherical,epipolar-only,background-subtraction,everything,nothing,truth,truth:grow_px=4,truth:shape=feet"


@pytest.mark.slow
def test_a_ranking_scores_as_runs_do_and_leaves_its_tables(monkeypatch, capsys, tiny_card, tmp_path):
    words = (tiny_card, "--methods", METHODS, "--workers", 1, "--out", tmp_path)
    monkeypatch.setattr("sys.argv", ["ranking", *map(str, words)])
    main()
    shown = capsys.readouterr().out
    for name in ("ranking.json", "ranking.md", "ranking.png", "ranking.svg"):
        assert str(tmp_path / name) in shown
        assert (tmp_path / name).stat().st_size > 100
    found = RankingSummary.model_validate_json((tmp_path / "ranking.json").read_bytes())
    assert found.failures == ()
    assert all(table.title in (tmp_path / "ranking.md").read_text() for table in ranking_tables(found))
    assert set(found.predictions) == set(METHODS.split(","))
    *categories, every, false = found.rows
    assert [row.recordings for row in categories] == [1, 1, 0, 0, 1]
    for row in (row for row in (*categories, every) if row.cases):
        assert row.scores[EXACT]["truth"] == 1
    assert false.scores[EXACT]["truth"] == 0
    run = run_one(
        card=load_card(tiny_card), method=build_method("spherical"), protocol=load_protocol(PAPER), out=tmp_path / "run"
    )
    assert every.cases == run.all_moving.object_frames
    assert every.scores[PAPER]["spherical"] == pytest.approx(run.all_moving.iou.value)
    assert false.scores[PAPER]["spherical"] == pytest.approx(run.false_positives.coverage.value)
