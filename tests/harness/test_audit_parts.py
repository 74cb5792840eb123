"""The parts of an audit on cases that can be checked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from bench.audit.causes import Evidence, FalseCause, MissCause, false_causes, miss_causes
from bench.audit.polygons import Compensation, lenient, region_fit, with_compensation
from bench.audit.sources import same_objects
from bench.evaluation.counts import count_frame
from bench.evaluation.protocol import load_protocol
from bench.recordings import load_card, open_dataset
from bench.records.reference import IgnoreReason, Status
from bench.reference.build import ReferenceBuilder
from tests.evaluation.frames import ignored_object, mask, picture, reference_frame, reference_object, static_object


def square(left: int, top: int, side: int, *, size: int = 40) -> np.ndarray:
    area = np.zeros((size, size), dtype=bool)
    area[top : top + side, left : left + side] = True
    return area


@pytest.mark.parametrize(
    ("region", "mask", "iou", "area_error", "boundary_px"),
    [
        (square(5, 5, 10), square(5, 5, 10), 1, 0, 0),
        (square(8, 5, 10), square(5, 5, 10), 70 / 130, 0, None),
        (square(8, 8, 14), square(10, 10, 10), 100 / 196, 0.96, pytest.approx(2, abs=0.15)),  # more at the corners
        (square(6, 7, 1), square(5, 5, 1), 0, 0, math.sqrt(5)),
    ],
)
def test_fit_of_squares(region, mask, iou, area_error, boundary_px):
    fit = region_fit(region, mask)
    assert (fit.iou, fit.area_error, fit.solid) == pytest.approx((iou, area_error, 1))
    assert fit.boundary_px == boundary_px if boundary_px is not None else 0 < fit.boundary_px < 3


def test_holes_of_the_mask_limit_what_a_polygon_can_reach():
    fit = region_fit(square(5, 5, 10), square(5, 5, 10) & ~square(7, 7, 6))
    assert fit.iou == fit.solid == pytest.approx(0.64)


def evidence(**firing: bool) -> Evidence:
    values = dict.fromkeys(Evidence.__slots__, False) | {"seen": True, "defined": True, "visible": True} | firing
    return Evidence(**{name: np.array([[value]]) for name, value in values.items()})


@pytest.mark.parametrize(
    ("firing", "cause"),
    [
        ({"by_exact_flow": True, "by_exact_motion": True}, MissCause.EGO_MOTION),
        ({"by_exact_flow": True}, MissCause.FLOW),
        ({"by_exact_flow": True, "visible": False}, MissCause.UNCOVERED),
        ({"below_horizon": True}, MissCause.BELOW_THRESHOLD),
        ({}, MissCause.ABOVE_HORIZON),
        ({"defined": False}, MissCause.NEAR_EPIPOLE),
        ({"seen": False, "defined": False}, MissCause.ENTERED),
        ({"by_exact_motion": True}, MissCause.ABOVE_HORIZON),  # what the constraints cannot see stays blind
    ],
)
def test_cause_of_a_missed_cell(firing: dict[str, bool], cause: MissCause):
    assert list(MissCause)[miss_causes(evidence(**firing))[0, 0]] is cause


@pytest.mark.parametrize(
    ("firing", "cause"),
    [
        ({"by_exact_flow": True, "anti_parallel": True, "by_exact_motion": True}, FalseCause.ANTI_PARALLEL),
        ({"by_exact_flow": True}, FalseCause.OTHER_CONSTRAINT),
        ({"by_exact_motion": True}, FalseCause.FLOW),
        ({"by_exact_motion": True, "visible": False}, FalseCause.UNCOVERED),
        ({"by_exact_motion": True, "moving": True}, FalseCause.BESIDE_OBJECT),
        ({}, FalseCause.EGO_MOTION),
        ({"anti_parallel": True}, FalseCause.EGO_MOTION),
    ],
)
def test_cause_of_a_false_alarm(firing: dict[str, bool], cause: FalseCause):
    assert list(FalseCause)[false_causes(evidence(**firing), cell_size_px=5)[0, 0]] is cause


def test_beside_an_object_is_within_a_flow_window():
    shape = (1, 12)
    cells = {name: np.zeros(shape, dtype=bool) for name in Evidence.__slots__}
    cells["by_exact_motion"][:] = cells["visible"][:] = True
    cells["moving"][0, 0] = True
    causes = [list(FalseCause)[k] for k in false_causes(Evidence(**cells), cell_size_px=5)[0]]
    assert causes == [FalseCause.BESIDE_OBJECT] * 4 + [FalseCause.FLOW] * 8


@given(st.data())
def test_every_cell_has_one_cause_and_blind_means_that_exact_flow_does_not_fire(data: st.DataObject):
    flags = npst.arrays(bool, (4, 5))
    drawn = Evidence(**{name: data.draw(flags) for name in Evidence.__slots__})
    causes = np.array([list(MissCause)[k] for k in miss_causes(drawn).ravel()])
    blind = [MissCause.NEAR_EPIPOLE, MissCause.ENTERED, MissCause.ABOVE_HORIZON, MissCause.BELOW_THRESHOLD]
    assert np.array_equal(np.isin(causes, blind), ~drawn.by_exact_flow.ravel())
    assert np.array_equal(causes == MissCause.EGO_MOTION, (drawn.by_exact_flow & drawn.by_exact_motion).ravel())
    false = np.array([list(FalseCause)[k] for k in false_causes(drawn, cell_size_px=5).ravel()])
    by_method = np.isin(false, (FalseCause.ANTI_PARALLEL, FalseCause.OTHER_CONSTRAINT))
    assert np.array_equal(by_method, drawn.by_exact_flow.ravel())


def test_references_of_the_same_objects_differ_in_their_regions_alone():
    labels = picture(
        """
        11..22
        11..22
        ......
        """
    )
    ids = picture(
        """
        .7..33
        77....
        ..5599
        """
    ).astype(np.uint16)
    objects = [reference_object("a"), reference_object("b"), ignored_object("c"), static_object("d")]
    valid = np.ones(labels.shape, dtype=bool)
    valid[1, 0] = False
    lidar = reference_frame(labels * valid, objects=objects, valid=valid)
    by_lidar, by_masks = same_objects([lidar], ids, {"a": 7, "b": 3, "c": 5, "d": 9})
    assert by_lidar is lidar
    assert np.array_equal(by_masks.labels, picture(".1..22\n.1....\n......"))
    assert np.array_equal(by_masks.ignored, mask("......\n......\n..##.."))
    assert [o.status for o in by_masks.objects] == [o.status for o in lidar.objects]
    assert [o.region_px for o in by_masks.objects[:2]] == [2, 2]
    detected = np.ones(labels.shape, dtype=bool)
    assert count_frame(by_masks, detected, component_size_px=0)[1][0].tp == 2


def test_an_object_that_no_pixel_shows_is_ignored_in_both():
    lidar = reference_frame(picture("11.22"))
    ids = picture("..99.").astype(np.uint16)
    both = same_objects([lidar], ids, {"a": -1, "b": 9})
    for frame in both:
        assert [o.status for o in frame.objects] == [Status.IGNORED, Status.EVALUATED]
        assert frame.objects[0].reason is IgnoreReason.OCCLUDED
        assert set(np.unique(frame.labels)) == {0, 2}
    assert np.array_equal(both[0].ignored, mask("##..."))
    assert not both[1].ignored.any()
    assert lidar.objects[0].status is Status.EVALUATED  # the one that came is not changed


def test_less_compensation_moves_the_polygon_of_a_fast_object_and_keeps_it_moving(tiny_card):
    handles = {handle.name: handle for handle in open_dataset(load_card(tiny_card))}
    recording = handles["overtaking"].open()
    settings = lenient(load_protocol("paper-v1").reference, "convex")
    image = recording.images["front"][2]
    built = {
        compensation: ReferenceBuilder(with_compensation(recording, compensation), "front", settings).build(image)
        for compensation in Compensation
    }
    assert with_compensation(recording, Compensation.FULL) is recording
    assert all(frame.objects[0].status is Status.EVALUATED for frame in built.values())
    places = {name: frame.objects[0].polygon.centroid.x for name, frame in built.items()}
    # The car drives at 6 m/s and the ego vehicle at 2.8: undoing the ego-motion alone leaves more than undoing neither.
    shifts = {name: abs(place - places[Compensation.FULL]) for name, place in places.items()}
    assert shifts[Compensation.EGO_MOTION] > 0.2
    assert shifts[Compensation.NONE] > 0.05
    assert not np.array_equal(built[Compensation.NONE].labels, built[Compensation.EGO_MOTION].labels)
