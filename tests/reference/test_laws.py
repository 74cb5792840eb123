"""What holds for the reference of any image, and for what is scored against it.

Source:
    metrics.md, regions of one image and checks that must always hold.
"""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from bench.evaluation.counts import count_frame
from bench.records.reference import Limb
from bench.reference import OutlineErrors, ReferenceFrame, Status, build
from bench.reference.bands import with_band
from tests.reference.drives import MS, Box, circle, drive, reference_of, with_settings

SEEDS = range(12)
LEGS = (Limb(joint=0.53, end=0.0, speed=2.0),)
SETTINGS = {
    "convex": with_settings(min_points=200),  # of 400 on each object
    "unknown bands": with_settings(
        min_points=200,
        polygon_kind="surface-patches",
        clearance_above_shape=True,
        outline=OutlineErrors(range_noise_m=0.02, angle_rad=0.002, position_m=0.007, limbs={"pedestrian": LEGS}),
    ),
}
EXPOSURE_NS = 40 * MS


def recording_of(seed):
    """Eight objects that stand, drive and turn close around the camera, one in four of a class of its own."""
    rng = np.random.default_rng(seed)
    boxes = [
        Box(
            place_m=(*rng.uniform([1.0, -5.0], [16.0, 5.0]), 0.8),
            size_m=rng.uniform([0.5, 0.5, 1.4], [5.0, 2.0, 1.6]),
            velocity_mps=(*rng.uniform(-6.0, 6.0, 2) * (rng.random() < 0.7), 0.0),
            yaw_rate_radps=float(rng.uniform(-1.0, 1.0)),
            yaw_rad=float(rng.uniform(-3.0, 3.0)),
        )
        for _ in range(8)
    ]
    classes = rng.choice(["vehicle", "pedestrian", "cyclist", "balloon"], 8).tolist()
    host = circle(float(rng.uniform(-3.0, 9.0)), float(rng.uniform(-0.6, 0.6)))
    return drive(boxes, host, exposures_ns=(EXPOSURE_NS,), classes=classes)


def frame_of(recording, settings) -> ReferenceFrame:
    """The reference of its only image."""
    return reference_of(recording, SETTINGS[settings])


@pytest.fixture(scope="module")
def recordings():
    return [recording_of(seed) for seed in SEEDS]


@pytest.fixture(scope="module", params=SEEDS)
def recording(request, recordings):
    return recordings[request.param]


@pytest.fixture(scope="module", params=SETTINGS)
def settings(request):
    return request.param


@pytest.fixture(scope="module")
def frame(recording, settings) -> ReferenceFrame:
    return frame_of(recording, settings)


def count(frame, detected):
    return count_frame(frame, detected, component_size_px=100)


def test_the_drives_hold_every_kind_of_object(recordings):
    objects = [item for recording in recordings for item in frame_of(recording, "convex").objects]
    kinds = {(item.status, item.reason.value if item.reason else None) for item in objects}
    assert {status for status, _ in kinds} == set(Status)
    assert {"too_few_points", "beyond_range", "class_not_in_protocol", "out_of_view"} <= {reason for _, reason in kinds}


def test_regions_are_valid_and_no_pixel_is_in_two(frame):
    inside = frame.labels > 0
    assert not (inside & ~frame.valid).any()
    assert not (frame.ignored & ~frame.valid).any()
    assert not (frame.ignored & inside).any()


def test_every_annotated_object_ends_in_one_way(frame):
    assert sorted(item.track_id for item in frame.objects) == [f"object-{i}" for i in range(8)]
    for number, item in enumerate(frame.objects, start=1):
        region_px = int((frame.labels == number).sum())
        assert item.region_px == region_px <= item.polygon_px
        assert (region_px > 0) == (item.status is Status.EVALUATED)
        assert (item.reason is not None) == (item.status is Status.IGNORED)


def assert_same_reference(one, other):
    """Bit by bit, ignored region included."""
    np.testing.assert_array_equal(one.labels, other.labels)
    np.testing.assert_array_equal(one.ignored, other.ignored)
    for mine, its in zip(one.objects, other.objects, strict=True):
        assert (mine.track_id, mine.status, mine.reason, mine.category, mine.region_px, mine.unknown_px) == (
            its.track_id, its.status, its.reason, its.category, its.region_px, its.unknown_px
        )  # fmt: skip
        assert mine.polygon == its.polygon
        assert mine.polygon_px == its.polygon_px


def test_the_order_of_the_annotations_changes_nothing(recording, settings, frame):
    assert_same_reference(frame_of(replace(recording, tracks=recording.tracks[::-1]), settings), frame)


def test_bands_of_static_objects_behind_all_others_are_left_out_and_change_nothing(recordings, monkeypatch):
    banded = []
    monkeypatch.setattr(build, "with_band", lambda region, one: banded.append(one) or with_band(region, one))
    frames = [frame_of(recording, "unknown bands") for recording in recordings]
    needed = len(banded)
    monkeypatch.setattr(build, "without_needless_bands", lambda scanned: scanned)
    for recording, frame in zip(recordings, frames, strict=True):
        assert_same_reference(frame_of(recording, "unknown bands"), frame)
    assert 0 < needed < len(banded) - needed


def test_the_reference_against_itself(frame):
    counts, objects = count(frame, frame.labels > 0)
    assert (counts.tp_px, counts.fn_px, counts.fp_px) == (int((frame.labels > 0).sum()), 0, 0)
    assert all(
        (item.tp, item.fn, item.fp) == (one.region_px, 0, 0) for item, one in zip(objects, frame.objects, strict=True)
    )


def test_nothing_detected(frame):
    counts, objects = count(frame, np.zeros_like(frame.valid))
    assert (counts.tp_px, counts.fp_px, counts.fp_components) == (0, 0, 0)
    assert all((item.tp, item.fp) == (0, 0) for item in objects)


def test_everything_detected(frame):
    counts, objects = count(frame, np.ones_like(frame.valid))
    regions_px = int(((frame.labels > 0) | frame.ignored).sum())
    coverage = Fraction(counts.fp_px, counts.width * counts.height)
    assert coverage == Fraction(int(frame.valid.sum()) - regions_px, frame.valid.size)
    assert all(item.fn == 0 and item.tp == one.region_px for item, one in zip(objects, frame.objects, strict=True))


def test_what_is_detected_on_ignored_objects_is_neutral(frame):
    """Also all of it, over the whole outline: no count but that of detected pixels changes."""
    own = frame.labels > 0
    without, with_ignored = count(frame, own), count(frame, own | frame.ignored)
    assert replace(with_ignored[0], detected_px=0) == replace(without[0], detected_px=0)
    assert with_ignored[1] == without[1]
