"""Whether references rank as the truth does: numbers that can be checked by hand, then a whole ranking."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.lines import Line2D

from bench.audit.sources import same_objects
from bench.evaluation import load_protocol
from bench.methods import build_method
from bench.recordings import load_card
from bench.reference import IgnoreReason, Status
from benchmarks.ranking.__main__ import main
from benchmarks.ranking.agreement import (
    RankedRow,
    RankingSummary,
    correlation_between,
    mean_difference,
    rank_correlation,
    rank_row,
    run_ranking,
    surface_fits,
)
from benchmarks.ranking.predictions import ALL_PREDICTIONS, Prediction, parse_predictions
from benchmarks.ranking.ranking_report import (
    agreement_table,
    draw_ranking,
    fit_table,
    kind_table,
    overview_table,
    ranking_tables,
)
from benchmarks.ranking.sums import (
    EXACT,
    FIT_SLICES,
    FITS,
    PAPER,
    REFERENCES,
    SCORED,
    SURFACE,
    RankingRows,
    lidar_references,
)
from benchmarks.ranking.wrong_masks import WrongMasks
from tests.evaluation.frames import ignored_object, mask, picture, reference_frame, reference_object
from tests.reporting.printed import texts
from tests.support.changed_data import without_scenario
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


def test_a_prediction_without_the_metric_is_left_out():
    assert mean_difference(np.array([0.5, np.nan]), np.array([0.25, 0.5])) == 0.25
    assert np.isnan(mean_difference(np.array([np.nan]), np.array([0.5])))


def test_what_is_made_of_exact_masks_is_no_real_method():
    predictions = [*ANY[:2], Prediction(name="truth", method=WrongMasks())]
    found = row(by_lidar=[0.2, 0.5, 0.6], by_masks=[0.1, 0.5, 1.0], predictions=predictions).agreement[PAPER]
    assert found.difference.value == pytest.approx((0.1 + 0 + 0.4) / 3)
    assert found.difference_real.value == pytest.approx((0.1 + 0) / 2)


def test_intervals_need_six_recordings_and_are_the_same_again(monkeypatch):
    monkeypatch.setattr("benchmarks.ranking.agreement.DRAWS", 100)
    assert row(by_lidar=[0.1, 0.5, 0.9], by_masks=[0.1, 0.5, 0.9], recordings=5).agreement[PAPER].tau.ci95 is None
    found = row(by_lidar=[0.2, 0.5, 0.9], by_masks=[0.1, 0.5, 0.9], recordings=6).agreement[PAPER]
    assert found.tau.ci95 == pytest.approx((1, 1))
    assert found.difference.ci95 == pytest.approx((0.1 / 3, 0.1 / 3))  # all recordings are alike
    rng = np.random.default_rng(1)
    cases = rng.random((8, 1, 1)) + 0.1
    sums = scores(rng.random((8, len(REFERENCES), 3)) * cases, ANY, cases=cases)
    first, second = (rank_row("crossing", sums, ANY) for _ in range(2))
    assert first.model_dump_json() == second.model_dump_json()
    low, high = first.agreement[PAPER].difference.ci95
    assert low < first.agreement[PAPER].difference.value < high


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


def test_the_tables_show_differences_order_and_which_aims_are_missed(monkeypatch):
    monkeypatch.setattr("benchmarks.ranking.agreement.DRAWS", 20)
    masks = [Prediction(name="truth", method=WrongMasks()), Prediction(name="fat", method=WRONG[1])]
    predictions = [*ANY[:2], *masks]
    six = row(by_lidar=[0.2, 0, 0.8, 0.9], by_masks=[0.1, 0, 1, 0.7], recordings=6, predictions=predictions)
    names = [prediction.name for prediction in predictions]
    # Of ten pixels of cores five lie outside of the masks; of ten of masks one is in neither core nor band.
    near = ("pedestrian", "[0, 2)", "[0, 0.05)", 1, 4, 1, 8, 0, 0.5)
    far = ("pedestrian", "[2, 4)", "[0, 0.05)", 1, 6, 4, 2, 1, 0.25)
    found = RankingSummary.model_construct(
        predictions=names,
        real=names[:2],
        errors={"fat": "outlines"},
        ceiling="truth",
        rows=(six,),
        fits=surface_fits(pd.DataFrame([near, far], columns=[*FIT_SLICES, *FITS])),
    )
    (*_, surface), agreement_of_rows = texts(overview_table(found)), texts(agreement_table(found))
    # Differences of 10, 0, 20 and 20 points; of six pairs five are in the same order, so tau is (5 - 1) / 6.
    aims = "tau 0.67 in crossing; mean difference 12.5 over all predictions; mean difference 5.0 over real methods"
    assert surface == ["surface-v1", "12.5", "5.0", "0.67", "fat in crossing", aims]
    assert {cells[4].partition(" ")[0] for cells in agreement_of_rows} == {"0.67"}
    assert texts(kind_table(found))[0] == ["Crossing", "convex hull (paper-v1)", "-1.00", "+20.0", "", "", "n/a"]
    every, of_class, _, near, *_ = texts(fit_table(found))
    assert every == ["all", "all", "all", "2", "50.0", "10.0", "37.5"]
    assert of_class == ["pedestrian", *every[1:]]
    assert near == ["pedestrian", "[2, 4)", "all", "1", "66.7", "50.0", "25.0"]


def test_the_lidar_references_are_those_of_the_protocols():
    found = lidar_references()
    assert list(found) == list(REFERENCES[:-1])
    assert [settings.polygon_kind for settings in found.values()] == ["convex", "concave", *["surface-patches"] * 2]
    assert [settings.outline is None for settings in found.values()] == [True, True, True, False]


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


def test_a_recording_without_images_has_no_sums():
    rows = RankingRows(["half", "all"], component_size_px=0)
    assert len(rows.scores()) == len(rows.fits()) == 0
    assert rank_row("crossing", rows.scores(), ANY).cases == 0


def test_an_object_that_one_reference_ignores_is_ignored_in_all():
    ids = picture("11.22").astype(np.uint16)
    both = reference_frame(picture("11.22"))
    only_b = reference_frame(
        picture("...22"), objects=[ignored_object("a", IgnoreReason.SMALL_POLYGON), reference_object("b")]
    )
    turned = reference_frame(picture("22.11"), objects=[reference_object("b"), reference_object("a")])
    for frame in same_objects([both, only_b, turned], ids, {"a": 1, "b": 2}):
        status = {item.track_id: item.status for item in frame.objects}
        assert status == {"a": Status.IGNORED, "b": Status.EVALUATED}
        number = [item.track_id for item in frame.objects].index("b") + 1
        assert np.array_equal(frame.labels > 0, mask("...##"))
        assert set(np.unique(frame.labels)) == {0, number}


def test_all_holds_real_methods_and_masks_that_are_wrong_in_known_ways():
    found = parse_predictions("all")
    assert tuple(prediction.name for prediction in found) == ALL_PREDICTIONS
    assert len(set(ALL_PREDICTIONS)) >= 16
    assert sum(prediction.real for prediction in found) >= 12
    methods = [prediction.method for prediction in found]
    assert all(oracle in methods for oracle in (WrongMasks(), *WRONG))
    errors = [prediction.error for prediction in found]
    assert (errors.count("outlines"), errors.count("objects")) == (12, 12)


METHODS = "spherical,epipolar-only,background-subtraction,everything,nothing,truth,truth:grow_px=4,truth:shape=feet"


def ranked(card: Path, out: Path, methods: str = METHODS, **options: object) -> RankingSummary:
    return run_ranking(load_card(card), predictions=parse_predictions(methods), out=out, **options)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def ranking(tiny_card: Path, tmp_path_factory: pytest.TempPathFactory) -> RankingSummary:
    return ranked(tiny_card, tmp_path_factory.mktemp("ranking"))


@pytest.mark.slow
def test_the_exact_masks_are_perfect_by_themselves(ranking: RankingSummary):
    assert ranking.failures == ()
    for found in ranking.rows[:-1]:
        if found.cases:
            assert found.scores[EXACT]["truth"] == 1
    assert ranking.rows[-1].scores[EXACT]["truth"] == 0
    assert {found.name: found.recordings for found in ranking.rows} == {
        "crossing": 1, "overtaking": 1, "preceding": 0, "approaching": 0, "static_ego": 1, "all_moving": 3,
        "false_positives": 3,
    }  # fmt: skip


@pytest.mark.slow
def test_a_method_scores_as_in_a_run(ranking: RankingSummary, tiny_card: Path, tmp_path: Path):
    for name in ("spherical", "background-subtraction"):
        run = run_one(
            card=load_card(tiny_card), method=build_method(name), protocol=load_protocol(PAPER), out=tmp_path / name
        )
        every, false = ranking.rows[-2:]
        assert every.cases == run.all_moving.object_frames
        assert every.scores[PAPER][name] == pytest.approx(run.all_moving.iou.value)
        assert false.scores[PAPER][name] == pytest.approx(run.false_positives.coverage.value)


@pytest.mark.slow
def test_an_image_that_cannot_be_used_is_left_out_for_all(tiny_card: Path, tmp_path: Path):
    card = shutil.copytree(tiny_card.parent, tmp_path / "datasets") / tiny_card.name
    without_scenario(card)
    image = sorted((card.parent / "data" / "tiny" / "crossing" / "truth" / "front").iterdir())[2]
    image.write_bytes(image.read_bytes()[:100])
    found = ranked(card, tmp_path / "out", "nothing,everything", split="moving")
    assert len(found.failures) == 1
    assert image.name in found.failures[0]
    assert found.images == found.rows[-1].cases == 7


@pytest.mark.slow
def test_the_command_prints_the_tables_and_leaves_the_files(monkeypatch, capsys, tiny_card, tmp_path):
    words = (tiny_card, "--methods", METHODS, "--recordings", 2, "--workers", 1, "--out", tmp_path)
    monkeypatch.setattr("sys.argv", ["ranking", *map(str, words)])
    main()
    shown = capsys.readouterr().out
    for text in (
        "Agreement with the exact masks",
        "Ceiling: IoU of the exact masks",
        "by kind of error",
        "too few",
    ):
        assert text in shown
    assert "\u2026" not in shown  # no cell is cut
    for name in ("ranking.json", "ranking.md", "ranking.png", "ranking.svg"):
        assert (tmp_path / name).stat().st_size > 100
        assert str(tmp_path / name) in shown
    found = RankingSummary.model_validate_json((tmp_path / "ranking.json").read_bytes())
    text = (tmp_path / "ranking.md").read_text()
    for table in ranking_tables(found):
        assert table.title in text
        assert all(len(cells) == len(table.headings()) for cells in table.cells())
    assert draw_ranking(found).findobj(Line2D)
