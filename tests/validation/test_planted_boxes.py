"""Mistakes of boxes that the benchmark plants into rendered drives, on a small drive: each is named."""

import re
import shutil

import pytest

from bench.recordings.native import open_native
from bench.validation.boxes import check_boxes
from bench.validation.motion import check_motion
from benchmarks.mistakes import OF_BOXES
from benchmarks.planted_mistakes import Outcome, counted, table, text_of, written
from tests.validation.drive import box_fit_of

# No check tells of an object without a box; of the other the small drive's lidar sees one side with few beams.
UNTOLD = {"the fastest object's boxes half a metre to its left", "the fastest object left out"}
ALWAYS_RUN = {"boxes in the lidar frame", "yaw of boxes reversed", "bottoms given for centres", "boxes 60 cm too short"}


def findings(root):
    recording = open_native(root)
    return [*check_boxes(recording), *check_motion(recording), *box_fit_of(root).findings()]


@pytest.mark.parametrize(
    "mistake",
    [
        pytest.param(mistake, id=mistake.name, marks=() if mistake.name in ALWAYS_RUN else pytest.mark.slow)
        for mistake in OF_BOXES
        if mistake.name not in UNTOLD
    ],
)
def test_a_planted_mistake_is_named(clean, tmp_path, mistake):
    root = shutil.copytree(clean, tmp_path / "drive")
    mistake.plant(root)
    told = [text_of(finding) for finding in findings(root)]
    assert any(re.search(mistake.lead, text, re.IGNORECASE) for text in told), told


@pytest.mark.parametrize(("name", "sign"), [("boxes 50 ms late", 1), ("boxes one sweep early", -2)])
def test_lateness_has_an_interval_that_holds_it(clean, tmp_path, name, sign):
    root = shutil.copytree(clean, tmp_path / "drive")
    (mistake,) = [one for one in OF_BOXES if one.name == name]
    mistake.plant(root)
    (told,) = [finding for finding in findings(root) if "ms to" in finding.got or "ms)" in finding.got]
    low, high = map(int, re.search(r"\((\d+) to (\d+) ms\)", told.got).groups())
    assert low - 10 <= 50 * abs(sign) <= high + 10
    assert ("late" if sign > 0 else "early") in told.got


def test_the_table_counts_drives():
    outcomes = [
        Outcome(mistake="half", part="boxes", drive=str(i), verdict=verdict, findings=())
        for i, verdict in enumerate(["right lead", "right lead", "silent"])
    ]
    total, *lines, row = table(counted(outcomes), ["0", "1", "2"])
    said = "2 found with the right lead, 0 with another, 0 where the report says that the drive cannot tell, 1 silent."
    assert total == f"3 planted mistakes in 0, 1, 2: {said}"
    assert row == "| half | boxes | 2 | 0 | 0 | 1 |"
    assert written("\n".join([total, *lines, row])).loc["half"].tolist() == ["boxes", 2, 0, 0, 1]
