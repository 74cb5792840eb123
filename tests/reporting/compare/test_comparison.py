"""Runs against each other, on the images that both scored; what is shown of a change; the files."""

import csv
import io
import math
import re
import shutil
from urllib.parse import unquote

import pandas as pd
import pytest

from bench.errors import UsageError
from bench.evaluation.comparison import holm
from bench.harness.stored import read_run
from bench.reporting.compare import (
    HEADLINES,
    Kind,
    Shown,
    compare_runs,
    report,
    terminal_report,
    verdict_line,
    what_is_shown,
    write_comparison,
)
from bench.reporting.document import to_markdown
from bench.reporting.formats import points
from bench.reporting.leaderboard import read_leaderboard
from tests.reporting.compare.runs import IMAGE_PX, IMAGES, RECORDINGS, drawn, write_run
from tests.reporting.printed import printed

CATEGORIES = ["crossing", "overtaking", "preceding", "approaching", "static_ego"]


def compared(*folders):
    return compare_runs(folders)


def change(comparison, name, metric):
    """Of a metric of a kind of motion."""
    return comparison.changes.droplevel("breakdown").loc[(name, metric)]


@pytest.fixture(scope="module")
def half(tmp_path_factory):
    """Every object half detected."""
    return write_run(tmp_path_factory.mktemp("runs") / "half", drawn(50))


def test_a_run_against_itself_differs_in_nothing(half):
    (found,) = compared(half, half)
    known = found.changes["cases_before"] > 0
    assert (found.changes.loc[known, "difference"] == 0).all()
    assert set(found.changes["p_value"].dropna()) == {1.0}
    assert set(found.changes["verdict"].dropna()) == {Shown.THE_SAME, Shown.NO_CASES}
    assert (found.detections[["gained", "lost"]] == 0).all(axis=None)
    assert list(found.detections.index) == [*CATEGORIES, "all_moving"]
    assert found.frames.empty
    assert found.after.label == "half (2)"
    assert verdict_line(found).startswith("half (2) against half, over everything. The same: IoU, all; TPR, all")


@pytest.mark.parametrize(("protocol", "lost"), [("paper-v1", 0), ("surface-v1", RECORDINGS * IMAGES + 3 * IMAGES)])
def test_under_a_protocol_with_bands_an_object_is_missed_below_half_of_its_core(tmp_path, protocol, lost):
    runs = [write_run(tmp_path / f"{px}", drawn(px), protocol=protocol) for px in (50, 49)]
    (found,) = compared(*runs)
    assert found.detections.loc["all_moving", "lost"] == lost
    text = to_markdown(report([found], out=tmp_path).blocks)
    assert ("found by half of the core" in text) == ("Core: the part of an object's region" in text) == bool(lost)


def test_a_run_that_finds_nothing_loses_everything(half, tmp_path):
    nothing = write_run(tmp_path / "nothing", drawn(0), fp_px=0)
    (found,) = compared(half, nothing)
    whole = found.detections.loc["all_moving"]
    assert whole.object_frames == RECORDINGS * IMAGES + 3 * IMAGES
    assert (whole.before, whole.after, whole.gained, whole.lost) == (whole.object_frames, 0, 0, whole.object_frames)
    assert change(found, "all_moving", "detection_rate_50").verdict == Shown.WORSE
    assert change(found, "crossing", "detection_rate").difference == -1
    assert change(found, "preceding", "detection_rate_50").verdict == Shown.TOO_FEW, "three recordings"
    assert change(found, "overtaking", "iou").verdict == Shown.NO_CASES
    assert math.isnan(change(found, "all_moving", "tpr").after), "no detected object-frame"
    assert change(found, "frames", "false_positive_coverage").before == 3072 / IMAGE_PX
    assert change(found, "frames", "false_positive_coverage").verdict == Shown.BETTER
    assert set(found.frames["kind"]) == {Kind.LOST, Kind.FEWER_FALSE}
    assert not found.frames.duplicated(["recording", "track_id"]).any(), "one frame per object"


def test_gained_and_lost_add_up_with_the_detected(half, tmp_path):
    before = drawn(50) | {(r, 0, "crossing"): 0 for r in range(4)}
    after = drawn(50) | {(r, 1, "crossing"): 0 for r in range(7)} | {(0, 2, "preceding"): 0}
    (found,) = compared(write_run(tmp_path / "a", before), write_run(tmp_path / "b", after))
    counts = found.detections
    assert counts.loc["crossing", ["gained", "lost"]].tolist() == [4, 7]
    assert counts.loc["preceding", ["gained", "lost"]].tolist() == [0, 1]
    assert (counts["after"] - counts["before"] == counts["gained"] - counts["lost"]).all()
    for name, row in counts[counts["object_frames"] > 0].iterrows():
        difference = change(found, name, "detection_rate").difference
        assert difference * row.object_frames == pytest.approx(row.after - row.before)


def test_the_largest_changes_of_coverage_come_first(half, tmp_path):
    after = drawn(50) | {(1, 1, "crossing"): 20, (2, 1, "crossing"): 5, (2, 2, "crossing"): 10, (3, 0, "crossing"): 80}
    (found,) = compared(half, write_run(tmp_path / "b", after))
    shown = found.frames.set_index("kind")[["recording", "before", "after"]]
    assert shown.loc[[Kind.FELL]].to_numpy().tolist() == [["drive-2", 0.5, 0.05], ["drive-1", 0.5, 0.2]]
    assert shown.loc[[Kind.ROSE]].to_numpy().tolist() == [["drive-3", 0.5, 0.8]]


def test_holm_runs_over_the_rows_of_one_metric_with_a_p_value(half, tmp_path):
    after = {key: 30 if key[2] == "crossing" else 51 for key in drawn(50)}
    after |= {(0, 0, "approaching"): 40}
    before = drawn(50) | {(0, 0, "approaching"): 50}
    (found,) = compared(write_run(tmp_path / "a", before), write_run(tmp_path / "b", after))
    for metric in HEADLINES:
        rows = found.changes.xs(metric, level="metric")
        p_values, p_holm = ([None if math.isnan(p) else p for p in rows[name]] for name in ("p_value", "p_holm"))
        assert p_holm == holm(p_values)
    tested = found.changes["p_holm"].xs("tpr_all", level="metric").dropna()
    assert list(tested.index.get_level_values("slice")) == ["crossing", "all_moving"], "three recordings are no test"
    lowest, other = (change(found, name, "tpr_all") for name in ("all_moving", "crossing"))
    assert lowest.p_holm == pytest.approx(2 * lowest.p_value)
    assert other.p_holm == other.p_value == 2 / 2**RECORDINGS, "all of them agree"
    alone = change(found, "frames", "false_positive_coverage")
    assert alone.p_holm == alone.p_value == 1
    extras = found.changes.drop(HEADLINES, level="metric")
    assert len(extras)
    assert extras[["p_holm", "verdict"]].isna().all(axis=None)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"protocol": "extended-v1"},
            r"protocol extended-v1 version 1 \([0-9a-f]{12}\), was paper-v1 version 1 \(",
        ),
        ({"region_px": 90}, "their references differ on the 32 images that both scored: annotations, other data or"),
        ({"dataset": "other"}, "data set 'other', was 'demo'"),
        ({"split": "test"}, "split 'test', was none"),
    ],
)
def test_runs_that_do_not_compare_are_refused_with_both_values(half, tmp_path, changed, message):
    other = write_run(tmp_path / "other", drawn(50), **changed)
    with pytest.raises(UsageError, match=message) as refused:
        compared(half, half, other)
    assert str(refused.value).startswith(f"{half}/paper-v1 and {other}/")
    assert "\n" not in str(refused.value)
    with pytest.raises(UsageError, match="at least two runs, got 1"):
        compared(half)


def test_settings_are_named_where_they_differ(tmp_path):
    weights = [{"weights": {"depth": 1.0, "height": h}, "flow": "dis"} for h in (0.2, 0.0)]
    runs = [write_run(tmp_path / str(n), drawn(50), settings=own) for n, own in enumerate(weights)]
    (found,) = compared(*runs)
    assert found.methods == ("nothing (weights.height=0.2)", "nothing (weights.height=0.0)")
    assert re.fullmatch("[01]", found.before.label)


@pytest.mark.parametrize(
    ("change", "verdict"),
    [
        ({}, Shown.BETTER),
        ({"improvement": -0.1}, Shown.WORSE),
        ({"p_holm": 0.051}, Shown.NOT_SHOWN),
        ({"ci95": (0.0, 0.15)}, Shown.NOT_SHOWN),
        ({"ci95": (-0.01, 0.15)}, Shown.NOT_SHOWN),
        ({"ci95": None, "p_holm": math.nan}, Shown.TOO_FEW),
        ({"difference": 0.0, "ci95": None, "p_holm": 1.0}, Shown.THE_SAME),
        ({"difference": 0.0, "ci95": (-0.1, 0.1)}, Shown.NOT_SHOWN),
        ({"difference": math.nan, "ci95": None, "p_holm": math.nan}, Shown.NO_CASES),
    ],
)
def test_no_more_is_said_than_the_interval_allows(change, verdict):
    shown = {"difference": 0.1, "improvement": 0.1, "ci95": (0.05, 0.15), "p_holm": 0.01}
    assert what_is_shown(shown | change) is verdict


# The files.

NAMES = ["compare.html", "compare.md", "compare.csv"]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    after = {key: 0 if key[0] < 7 and key[1] == 1 else 20 + key[0] for key in drawn(50)}
    made = {"old": (drawn(50), 3072), "new": (after, 0), "x|y": (after, 3072)}
    return [write_run(runs / name, px, fp_px=fp_px, dataset="gone") for name, (px, fp_px) in made.items()]


def test_equal_input_gives_equal_bytes(folders, tmp_path):
    _, first = write_comparison(folders, tmp_path / "one")
    _, second = write_comparison(folders, tmp_path / "two")
    assert [file.name for file in first] == NAMES
    assert [file.read_bytes() for file in first] == [file.read_bytes() for file in second]


def test_all_forms_carry_the_same_numbers(folders, tmp_path):
    comparisons, _ = write_comparison(folders, tmp_path)
    (row,) = [
        row
        for row in csv.DictReader(io.StringIO((tmp_path / "compare.csv").read_text()))
        if (row["after_run"], row["row"], row["metric"]) == ("new", "crossing", "tpr_all")
    ]
    # Seven recordings lose one image of four; of the others (20 + r) % are found.
    difference = sum(0.2 + r / 100 for r in range(8) for k in range(4) if r == 7 or k != 1) / 32 - 0.5
    cell = comparisons[0].changes.droplevel("breakdown").loc[("crossing", "tpr_all")]
    assert cell["difference"] == float(row["difference"]) == pytest.approx(difference)
    assert cell["ci95"] == (float(row["ci95_low"]), float(row["ci95_high"]))
    assert cell["p_holm"] == float(row["p_holm"])
    assert cell["verdict"] == row["verdict"] == "worse"
    assert (
        f"| TPR, all | Crossing | worse | 8 | 50.0 | {50 + 100 * difference:.1f} | {points(difference)} |"
        in (tmp_path / "compare.md").read_text()
    )
    assert comparisons[0].detections.loc["all_moving"].lost == 7 + 3
    text = (tmp_path / "compare.md").read_text()
    assert "**new against old, over everything. Better: False-positive coverage. Worse: IoU, all; TPR, all; Det" in text
    assert "| TPR, all | Preceding | too few recordings | 3 | 50.0 |" in text
    assert "n/a" not in text, "kinds without object-frames are not judged"
    assert "| newly missed: vehicle 'crossing', crossing, 4.0 m (drive-0, camera front, 0.10 s) | 50.0 | 0.0 |" in text
    assert "| fewer false positives (drive-0, camera front, 0.00 s) | 1.0 | 0.0 |" in text


def test_recordings_are_set_beside_each_other(folders, tmp_path):
    write_comparison(folders[:2], tmp_path)
    keys = ["breakdown", "metric", "recording"]
    sums = [pd.read_csv(folder / "paper-v1" / "sums.csv").set_index(keys).loc["all_moving"] for folder in folders[:2]]
    lines = (tmp_path / "compare.md").read_text().splitlines()
    for recording in (f"drive-{number}" for number in range(8)):
        rows = [one.loc[metric, recording] for metric in ("iou", "tpr_all", "detection_rate_50") for one in sums]
        expected = [f"{100 * row['numerator'] / row['denominator']:.1f}" for row in rows]
        (line,) = [line for line in lines if line.startswith(f"| {recording} |")]
        assert line.split(" | ")[1:7] == expected


def test_without_data_there_are_no_pictures(folders, tmp_path, monkeypatch):
    monkeypatch.setattr("bench.harness.datasets.shipped_folder", lambda: tmp_path)  # in which there is no card
    comparisons, _ = write_comparison(folders, tmp_path)
    assert all(comparison.pictures == () for comparison in comparisons)
    remarks = [comparison.remarks for comparison in comparisons]
    assert all(remark.startswith("no picture: nowhere.yaml") for (remark,) in remarks)
    assert "no picture: nowhere.yaml" in (tmp_path / "compare.md").read_text()


def test_the_page_leads_to_the_pages_of_the_runs(folders, tmp_path):
    page = folders[1] / "paper-v1" / "index.html"
    page.write_text("a page")
    write_comparison(folders[:2], tmp_path / "a b")
    links = re.findall(r'<a href="([^"]*)">([^<]*)</a>', (tmp_path / "a b" / "compare.html").read_text())
    page.unlink()
    ((address, label),) = links  # the other run has no page
    assert label == "new"
    assert (tmp_path / "a b" / unquote(address)).resolve() == page.resolve()


def test_the_terminal_table_fits(folders):
    comparison = compare_runs(folders)[0]
    shown = printed(terminal_report(comparison), width=100)
    assert "…" not in shown
    assert "(Holm) \n" in shown, "the last column is whole"
    for word in ("new (after) against old (before)", "Crossing", "False positives"[:5], "worse", "-28.7", "<0.001"):
        assert word in shown
    lines = [line.split() for line in shown.splitlines()]
    assert ["Preceding", "too", "few", "3", "50.0", "15.8", "-34.2"] in lines


# Runs that scored other images.

WHOLE = drawn(50) | {(r, 1, "crossing"): 10 * r for r in range(RECORDINGS)}
LATER = {key: px + 10 for key, px in WHOLE.items() if key[1] > 0}  # as of a method that needs one image more
SCORED = {"whole": RECORDINGS * IMAGES, "later": RECORDINGS * (IMAGES - 1), "cut": RECORDINGS * (IMAGES - 1)}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two runs, and the first as if it had scored the images of the second alone."""
    folder = tmp_path_factory.mktemp("runs")
    detected = {"whole": WHOLE, "later": LATER, "cut": {key: WHOLE[key] for key in LATER}}
    found = {name: write_run(folder / name, px) for name, px in detected.items()}
    assert {name: read_run(run).summary.images.evaluated for name, run in found.items()} == SCORED
    assert len({read_run(run).manifest.reference for run in found.values()}) == 2
    return found


@pytest.mark.parametrize("order", [("whole", "later"), ("later", "whole")])
def test_figures_are_those_of_the_images_that_both_scored(runs, order):
    (found,) = compare_runs([runs[name] for name in order])
    (expected,) = compare_runs([runs["cut" if name == "whole" else name] for name in order])
    assert found.images == (SCORED[order[0]], SCORED[order[1]], SCORED["later"])
    pd.testing.assert_frame_equal(found.changes, expected.changes)
    pd.testing.assert_frame_equal(found.detections, expected.detections)
    pd.testing.assert_frame_equal(found.frames, expected.frames)


def test_every_form_says_how_many_images_each_run_had(runs, tmp_path):
    line = "Compared on the 24 images that both scored: whole scored 32, later 24."
    write_comparison([runs["whole"], runs["later"]], tmp_path, pictures=False)
    assert line in (tmp_path / "compare.md").read_text()
    with (tmp_path / "compare.csv").open() as stream:
        counts = {(r["images_before"], r["images_after"], r["images_compared"]) for r in csv.DictReader(stream)}
    assert counts == {("32", "24", "24")}


def test_the_leaderboard_ranks_all_on_their_common_images(runs):
    (group,) = read_leaderboard(runs["whole"].parent).groups
    assert {entry.run: entry.images for entry in group.entries} == SCORED
    assert (group.images, group.cases["all_moving"][0]) == (SCORED["later"], len(LATER))
    values = {entry.run: entry.metrics for entry in group.entries}
    assert values["whole"] == values["cut"]


def test_a_run_of_few_images_has_a_table_of_its_own(runs, tmp_path):
    shutil.copytree(runs["whole"], tmp_path / "whole")
    few = write_run(tmp_path / "few", {key: px for key, px in WHOLE.items() if key[1] == 0})
    groups = read_leaderboard(tmp_path).groups
    assert sorted([entry.run for entry in group.entries] for group in groups) == [["few"], ["whole"]]
    (compared,) = compare_runs([runs["whole"], few])
    assert compared.images == (32, 8, 8)


def test_no_common_image_is_said(runs, tmp_path):
    other = write_run(tmp_path / "other", {(r, n + IMAGES, kind): px for (r, n, kind), px in WHOLE.items()})
    with pytest.raises(UsageError, match="no image was scored by both; the first has 32, the second 32"):
        compare_runs([runs["whole"], other])
