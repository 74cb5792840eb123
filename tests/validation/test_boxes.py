"""Boxes against returns: each mistake that the benchmark plants is named on a small drive, and so is a missing box."""

import re
import shutil
from dataclasses import replace
from functools import partial

import pytest

from bench.annotation import proposals, propose
from bench.recordings.native import open_native
from bench.records.recording import NOT_ANNOTATED, Annotated
from bench.validation.fits.box_fit import check_unboxed
from bench.validation.quick.boxes import check_boxes
from bench.validation.quick.motion import check_motion
from benchmarks.mistakes import OF_BOXES
from benchmarks.planted_mistakes import Outcome, counted, table, text_of, written
from tests.annotation.street import COARSE, street
from tests.validation.drive import box_fit_of, planted

# No check tells of an object without a box; of the other the small drive's lidar sees one side with few beams.
UNTOLD = {"the fastest object's boxes half a metre to its left", "the fastest object left out"}
ALWAYS_RUN = {"boxes in the lidar frame", "yaw of boxes reversed", "bottoms given for centres", "boxes 60 cm too short"}


def findings(root):
    recording = open_native(root)
    return [*check_boxes(recording), *check_motion(recording), *box_fit_of(root).findings()]


@pytest.mark.parametrize("mistake", planted(OF_BOXES, always_run=ALWAYS_RUN, untold=UNTOLD))
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


# ---------------------------------------------------------------- what has no box

AHEAD_M = ((3.0, -6.0), (30.0, -6.0), (30.0, 6.0), (3.0, 6.0))


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A street, and proposals by its coarse beams."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(proposals, "propose", partial(propose, settings=COARSE))
        yield street(tmp_path_factory.mktemp("unboxed") / "street")


def without(recording, name):
    return replace(recording, tracks=tuple(track for track in recording.tracks if track.track_id != name))


def test_a_vehicle_without_a_box_is_found(recording):
    assert not list(check_unboxed(recording))
    (finding,) = check_unboxed(without(recording, "leader"))
    assert finding.check == "object-without-box"
    assert re.search(r"move at (5\.[89]|6\.[0-2]) m/s without a box in \d+ sweeps \(\d+ m ahead", finding.got)


def test_nothing_is_missed_where_and_when_nothing_is_annotated(recording):
    missing = without(recording, "leader")
    always = recording.annotated.spans_ns
    for annotated in (NOT_ANNOTATED, Annotated(spans_ns=always, left_out_m=(AHEAD_M,)), Annotated(spans_ns=((0, 1),))):
        assert not list(check_unboxed(replace(missing, annotated=annotated)))
