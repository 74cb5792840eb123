"""Runs that scored other images are compared, and ranked, on the images that both scored."""

import csv
import shutil

import pandas as pd
import pytest

from bench.errors import UsageError
from bench.harness import read_run
from bench.reporting.compare import compare_runs, read_comparable, write_comparison
from bench.reporting.leaderboard import read_leaderboard
from tests.reporting.compare.runs import IMAGES, RECORDINGS, drawn, write_run

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
    (found,) = compare_runs(read_comparable([runs[name] for name in order]))
    (expected,) = compare_runs(read_comparable([runs["cut" if name == "whole" else name] for name in order]))
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
    (compared,) = compare_runs(read_comparable([runs["whole"], few]))
    assert compared.images == (32, 8, 8)


def test_no_common_image_is_said(runs, tmp_path):
    other = write_run(tmp_path / "other", {(r, n + IMAGES, kind): px for (r, n, kind), px in WHOLE.items()})
    with pytest.raises(UsageError, match="no image was scored by both; the first has 32, the second 32"):
        compare_runs(read_comparable([runs["whole"], other]))
