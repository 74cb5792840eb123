"""Objects without a box, by what moves without one."""

import re
from dataclasses import replace
from functools import partial

import pytest

from bench.annotation import proposals
from bench.annotation.proposals import propose
from bench.records.recording import NOT_ANNOTATED, Annotated
from bench.validation.fits.box_fit import check_unboxed
from tests.annotation.street import COARSE, street

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
