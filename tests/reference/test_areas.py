"""Areas and times that the annotations leave out: nothing there is right or wrong."""

from dataclasses import replace

import numpy as np
import pytest

from bench.recordings import COMPLETELY, NOT_ANNOTATED, Annotated
from bench.records.recording import ALWAYS_NS
from bench.reference import IgnoreReason, Status
from bench.reference.silhouette import TALLEST_M, left_out_pixels
from tests.reference.drives import MS, Box, camera, circle, drive, reference_of

LEFT = ((-300.0, 3.0), (300.0, 3.0), (300.0, 60.0), (-300.0, 60.0))  # an opposite carriageway
LEFT_OUT = Annotated(spans_ns=(ALWAYS_NS,), left_out_m=(LEFT,))
SIZE = (1.0, 1.0, 1.6)
HERE, THERE = Box((8.0, 1.0, 0.8), SIZE, (0.0, -1.4, 0.0)), Box((7.0, 4.5, 0.8), SIZE, (0.0, -1.4, 0.0))


def build(annotated, boxes=(HERE, THERE)):
    return reference_of(drive(boxes, circle(5.0, 0.0), exposures_ns=(30 * MS,), annotated=annotated))


def test_objects_and_pixels_of_an_area_are_ignored():
    whole, found = build(COMPLETELY), build(LEFT_OUT)
    assert {item.track_id: item.status for item in whole.objects} == dict.fromkeys(
        ("object-0", "object-1"), Status.EVALUATED
    )
    kept = {item.track_id: (item.status, item.reason) for item in found.objects}
    assert kept == {
        "object-0": (Status.EVALUATED, None),
        "object-1": (Status.IGNORED, IgnoreReason.NOT_ANNOTATED),
    }
    assert found.annotated
    number = {item.track_id: k for k, item in enumerate(found.objects, start=1)}
    assert (found.labels == number["object-0"]).sum() == (whole.labels == number["object-0"]).sum()
    assert found.ignored[whole.labels == number["object-1"]].all(), "what may be seen there counts neither way"
    assert not (found.ignored & (found.labels > 0)).any()
    assert not (found.ignored & ~found.valid).any()
    assert found.left_out.any()
    assert not (found.left_out & ~found.ignored).any()
    assert not found.left_out[whole.labels == number["object-1"]].any(), "an ignored object is told from its area"
    assert not whole.left_out.any()


@pytest.mark.parametrize(
    ("point_m", "inside"),
    [
        ((20.0, 10.0, 1.0), True),
        ((3.7, 59.0, 0.1), True),
        ((20.0, 2.0, 0.0), False),  # on the own side, in front of nothing of the area
        ((8.0, -5.0, 1.0), False),
        ((6.0, 3.5, TALLEST_M + 2.0), False),  # above all that drives
    ],
)
def test_pixels_show_what_may_stand_in_the_area(point_m, inside):
    mounted = camera()
    pixel, valid = mounted.model.project(mounted.vehicle_from_camera.inverse().apply(np.array([point_m])))
    assert valid.all()
    u, v = pixel.round().astype(int)[0]
    assert left_out_pixels(LEFT_OUT, mounted)[v, u] == inside


def test_other_times_and_recordings_without_annotations_have_no_scores():
    at_ns = 30 * MS
    for annotated, scored in (
        (Annotated(spans_ns=((at_ns, at_ns),)), True),
        (Annotated(spans_ns=((0, at_ns - 1), (at_ns + 1, 9 * at_ns))), False),
        (NOT_ANNOTATED, False),
    ):
        frame = build(annotated)
        assert frame.annotated == scored
        assert bool(frame.objects) == scored
        assert (frame.ignored == frame.valid).all() == (not scored)
        assert (frame.left_out == frame.valid).all() == (not scored)
        assert scored or not frame.labels.any()


def test_without_areas_nothing_changes():
    one, other = build(COMPLETELY), build(replace(COMPLETELY, spans_ns=((0, 60 * MS),)))
    assert (one.labels == other.labels).all()
    assert (one.ignored == other.ignored).all()
