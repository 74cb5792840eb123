"""From annotations to regions: where every object ends, which pixels it owns, and what holds for any image.

Source:
    metrics.md, regions of one image and checks that must always hold. Counts are checked in tests/evaluation.
"""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from bench.errors import DataError, UsageError
from bench.recordings import ImageRef, ObjectState, PointIndices, Track
from bench.records.recording import ALWAYS_NS, COMPLETELY, NOT_ANNOTATED, Annotated
from bench.records.reference import Category, Direction, IgnoreReason, ReferenceFrame, Status
from bench.reference import build
from bench.reference.bands import with_band
from bench.reference.build import ReferenceBuilder
from bench.reference.motion import AnnotationIndex
from bench.reference.silhouette import TALLEST_M, left_out_pixels
from bench.reference.sweeps import SweepCache
from tests.reference.drives import ERRORS, MS, SETTINGS, Box, camera, circle, drive, reference_of, with_settings

SIZE = (1.0, 1.0, 1.6)
STRAIGHT = circle(5.0, 0.0)
WALKER = Box((8.0, 1.0, 0.8), SIZE, (0.0, -1.4, 0.0))


def frame_of(*boxes, trajectory=STRAIGHT, exposure_ns=30 * MS, settings=SETTINGS, **options) -> ReferenceFrame:
    return reference_of(drive(boxes, trajectory, exposures_ns=(exposure_ns,), **options), settings)


def test_a_crossing_walker_is_evaluated_with_all_its_words():
    frame = frame_of(WALKER)
    (walker,) = frame.objects
    assert (walker.status, walker.reason) == (Status.EVALUATED, None)
    assert walker.category is Category.CROSSING
    assert walker.direction is Direction.LONGITUDINAL  # the host comes nearer faster than the walker crosses
    assert walker.speed_mps == pytest.approx(1.4)
    assert frame.ego_speed_mps == pytest.approx(5.0)
    # Nearest point: x 7.5 of the box, camera at 3.7 + 0.15 after 30 ms at 5 m/s.
    assert walker.range_m == pytest.approx(7.5 - 3.85, abs=0.1)
    np.testing.assert_allclose(walker.centroid_m, [8.0 - 0.15, 1.0 - 1.4 * 0.03], atol=0.1)
    assert 300 < walker.points < 400  # the rest lies within 5 cm of the road
    assert walker.region_px == (frame.labels == 1).sum() == walker.polygon_px > 500
    assert not frame.ignored.any()
    standing = frame_of(WALKER, trajectory=circle(0.0, 0.0)).objects[0]
    assert (standing.category, standing.direction) == (Category.STATIC_EGO, Direction.LATERAL)


def test_the_polygon_lies_on_the_object_at_exposure():
    world_from_camera = STRAIGHT.world_from_vehicle(30 * MS) @ camera().vehicle_from_camera
    corners = WALKER.world_from_box(30 * MS).apply(WALKER.skin(20000, seed=5))
    pixels, _ = camera().model.project(world_from_camera.inverse().apply(corners[corners[:, 2] > 0.05]))
    truth, polygon = shapely.MultiPoint(pixels).convex_hull, frame_of(WALKER).objects[0].polygon
    assert polygon.intersection(truth).area / polygon.union(truth).area > 0.93


@pytest.mark.parametrize(("speed_mps", "status"), [(1.4, Status.EVALUATED), (0.0, Status.STATIC)])
def test_nearer_objects_take_the_pixels_whatever_their_status(speed_mps, status):
    far = Box((9.5, 1.7, 0.8), SIZE, (0.0, -1.4, 0.0))
    alone = frame_of(far).objects[0].region_px
    frame = frame_of(far, Box((7.0, 0.3, 0.8), SIZE, (0.0, speed_mps, 0.0)))
    near, hidden = frame.objects
    assert (near.track_id, near.status, hidden.track_id) == ("object-1", status, "object-0")
    assert 0 < hidden.region_px == (frame.labels == 2).sum() < alone
    assert hidden.polygon_px == pytest.approx(alone, rel=0.02)


@pytest.mark.parametrize(
    ("box", "options", "reason"),
    [
        (WALKER, {"unclear": True}, IgnoreReason.UNCLEAR),
        (WALKER, {"classes": ["balloon"]}, IgnoreReason.CLASS),
        (WALKER, {"settings": with_settings(categories=(Category.OVERTAKING,))}, IgnoreReason.CATEGORY),
        (Box((-9, 1, 0.8), SIZE, (0, 1, 0)), {}, IgnoreReason.OUT_OF_VIEW),
        (WALKER, {"sweep_ns": ()}, IgnoreReason.NO_SWEEP),
        (Box((14, 1, 0.8), SIZE, (0, 1, 0)), {}, IgnoreReason.RANGE),
        (WALKER, {"settings": with_settings(min_points=401)}, IgnoreReason.FEW_POINTS),
        (WALKER, {"settings": with_settings(min_polygon_px=100000)}, IgnoreReason.SMALL_POLYGON),
    ],
)
def test_reasons_to_ignore(box, options, reason):
    frame = frame_of(box, **options)
    (item,) = frame.objects
    assert (item.status, item.reason, item.region_px) == (Status.IGNORED, reason, 0)
    assert not frame.labels.any()
    # Ignored pixels are there wherever the object is in view, from its outline where points do not suffice.
    assert frame.ignored.any() == (reason is not IgnoreReason.OUT_OF_VIEW)


def test_limits_hold_at_equality():
    (walker,) = frame_of(WALKER).objects
    for name, met, missed, reason in (
        ("range_limit_m", walker.range_m, np.nextafter(walker.range_m, 0.0), IgnoreReason.RANGE),
        ("min_points", walker.points, walker.points + 1, IgnoreReason.FEW_POINTS),
        ("min_polygon_px", walker.polygon_px, walker.polygon_px + 1, IgnoreReason.SMALL_POLYGON),
    ):
        frames = [frame_of(WALKER, settings=with_settings(**{name: limit})) for limit in (met, missed)]
        assert [frame.objects[0].reason for frame in frames] == [None, reason]


def test_static_objects_are_neither_evaluated_nor_ignored_unless_an_annotator_says_that_they_move():
    frame = frame_of(Box((8, 1, 0.8), SIZE, (0.1, 0, 0)))
    assert (frame.objects[0].status, frame.objects[0].category) == (Status.STATIC, None)
    assert not frame.ignored.any()
    assert frame_of(Box((8, 1, 0.8), SIZE, (0, 0, 0)), category="crossing").objects[0].status is Status.EVALUATED
    assert frame_of(WALKER, category="approaching").objects[0].category is Category.APPROACHING


def test_annotations_and_sweeps_too_far_in_time_are_not_of_this_image():
    """The exposure is at 30 ms, and 100 ms are near enough."""
    for apart_ns, near in ((100 * MS, True), (100 * MS + 1, False)):
        for time_ns in (30 * MS - apart_ns, 30 * MS + apart_ns):
            assert len(frame_of(WALKER, state_ns=(time_ns,)).objects) == near
            (walker,) = frame_of(WALKER, sweep_ns=(time_ns,)).objects
            assert (walker.reason is IgnoreReason.NO_SWEEP) == (not near)


def test_of_annotations_or_sweeps_equally_near_the_earlier_counts():
    recording = drive([WALKER], STRAIGHT, state_ns=(0, 60 * MS), sweep_ns=(0, 60 * MS))
    for exposure_ns, nearest_ns in ((30 * MS, 0), (30 * MS + 1, 60 * MS)):
        (annotated,) = AnnotationIndex(recording, SETTINGS).at(exposure_ns)
        assert annotated.state.timestamp_ns == nearest_ns
        assert SweepCache(recording, 100 * MS).nearest(None, exposure_ns).sweep.timestamp_ns == nearest_ns


def test_the_ego_vehicles_own_body_is_no_reference():
    body = np.zeros((480, 640), dtype=bool)
    body[300:] = True
    recording = drive([WALKER], STRAIGHT, exposures_ns=(30 * MS,))
    whole = reference_of(recording)
    cut = reference_of(replace(recording, cameras={"front": camera(ego_body=body)}))
    assert not cut.valid[300:].any()
    assert cut.objects[0].region_px == (whole.labels[:300] == 1).sum()


def test_point_indices_without_velocity_say_nothing_about_motion():
    recording = drive([WALKER], STRAIGHT, exposures_ns=(30 * MS,))
    shape = PointIndices(indices=np.arange(400), sweep_timestamp_ns=0)
    state = ObjectState(timestamp_ns=0, shape=shape, velocity_mps=np.full(3, np.nan))

    def built(chosen):
        track = Track(track_id="p", object_class="vehicle", states=(chosen,))
        return reference_of(replace(recording, tracks=(track,))).objects[0]

    assert built(state).reason is IgnoreReason.MOTION_UNKNOWN
    assert built(replace(state, category="crossing")).status is Status.EVALUATED
    with pytest.raises(DataError, match="a lidar sweep at 7"):
        built(replace(state, shape=replace(shape, sweep_timestamp_ns=7)))


def test_no_ego_motion_is_a_clear_error():
    builder = ReferenceBuilder(drive([WALKER], STRAIGHT), "front", SETTINGS)
    with pytest.raises(DataError, match="expected ego-motion at 9000000000"):
        builder.build(ImageRef(camera="front", timestamp_ns=9000 * MS, path=builder.recording.root))


def test_geometry_to_look_at():
    recording = drive([WALKER], STRAIGHT, exposures_ns=(30 * MS,))
    builder, image = ReferenceBuilder(recording, "front", SETTINGS), recording.images["front"][0]
    shown = builder.geometry("object-0", image)
    assert len(shown.cluster_vehicle) == len(shown.pixels) > 300
    assert len(shown.surroundings_vehicle) == 600
    # Seen from above: a square of a metre around the walker, where it is 30 ms later.
    np.testing.assert_allclose(shown.outline_m.mean(axis=0), [8.0 - 0.15, 1.0 - 0.042], atol=1e-6)
    np.testing.assert_allclose(np.ptp(shown.outline_m, axis=0), [1.0, 1.0], atol=1e-6)
    with pytest.raises(UsageError, match="nobody"):
        builder.geometry("nobody", image)


# Areas and times that the annotations leave out: nothing there is right or wrong.
LEFT = ((-300.0, 3.0), (300.0, 3.0), (300.0, 60.0), (-300.0, 60.0))  # an opposite carriageway
LEFT_OUT = Annotated(spans_ns=(ALWAYS_NS,), left_out_m=(LEFT,))


def test_objects_and_pixels_of_an_area_are_ignored():
    there = Box((7.0, 4.5, 0.8), SIZE, (0.0, -1.4, 0.0))
    whole, partly = (frame_of(WALKER, there, annotated=annotated) for annotated in (COMPLETELY, LEFT_OUT))
    assert [item.status for item in whole.objects] == [Status.EVALUATED] * 2
    reasons = {item.track_id: (number, item.reason) for number, item in enumerate(partly.objects, start=1)}
    (here, reason), (other, other_reason) = reasons["object-0"], reasons["object-1"]
    assert (reason, other_reason) == (None, IgnoreReason.NOT_ANNOTATED)
    assert (partly.labels == here).sum() == (whole.labels == here).sum() > 0
    assert partly.ignored[whole.labels == other].all(), "what may be seen there counts neither way"
    assert not (partly.ignored & ((partly.labels > 0) | ~partly.valid)).any()
    assert partly.left_out.any()
    assert not (partly.left_out & ~partly.ignored).any()
    assert not partly.left_out[whole.labels == other].any(), "an ignored object is told from its area"
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
    pixel, _ = mounted.model.project(mounted.vehicle_from_camera.inverse().apply(np.array([point_m])))
    u, v = pixel.round().astype(int)[0]
    assert left_out_pixels(LEFT_OUT, mounted)[v, u] == inside


@pytest.mark.parametrize(
    ("annotated", "scored"),
    [
        (Annotated(spans_ns=((30 * MS, 30 * MS),)), True),
        (Annotated(spans_ns=((0, 30 * MS - 1), (30 * MS + 1, 300 * MS))), False),
        (NOT_ANNOTATED, False),
    ],
)
def test_other_times_and_recordings_without_annotations_have_no_scores(annotated, scored):
    frame = frame_of(WALKER, annotated=annotated)
    assert frame.annotated == bool(frame.objects) == frame.labels.any() == scored
    assert (frame.ignored == frame.valid).all() == (frame.left_out == frame.valid).all() == (not scored)


SEEDS = range(12)
KINDS = {
    "convex": with_settings(min_points=200),  # of 400 on each object
    "unknown bands": with_settings(min_points=200, polygon_kind="surface-patches", unknown_band=ERRORS),
}


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
    return drive(boxes, host, exposures_ns=(40 * MS,), classes=classes)


@pytest.fixture(scope="module")
def recordings():
    return [recording_of(seed) for seed in SEEDS]


@pytest.fixture(scope="module", params=KINDS)
def frames(request, recordings):
    """The references of the recordings, and by which settings."""
    return [reference_of(recording, KINDS[request.param]) for recording in recordings], KINDS[request.param]


def test_the_drives_hold_every_kind_of_object(frames):
    kinds = {(item.status, item.reason) for frame in frames[0] for item in frame.objects}
    assert {status for status, _ in kinds} == set(Status)
    expected = {IgnoreReason.FEW_POINTS, IgnoreReason.RANGE, IgnoreReason.CLASS, IgnoreReason.OUT_OF_VIEW}
    assert expected <= {reason for _, reason in kinds}


@pytest.mark.parametrize("seed", SEEDS)
def test_no_pixel_is_in_two_regions_and_every_annotated_object_ends_in_one_way(frames, seed):
    frame = frames[0][seed]
    inside = frame.labels > 0
    assert not ((inside | frame.ignored) & ~frame.valid).any()
    assert not (frame.ignored & inside).any()
    assert sorted(item.track_id for item in frame.objects) == [f"object-{i}" for i in range(8)]
    for number, item in enumerate(frame.objects, start=1):
        assert item.region_px == (frame.labels == number).sum() <= item.polygon_px
        assert (item.region_px > 0) == (item.status is Status.EVALUATED)
        assert (item.reason is not None) == (item.status is Status.IGNORED)


def assert_same_reference(one, other):
    """Bit by bit, ignored region included."""
    np.testing.assert_array_equal(one.labels, other.labels)
    np.testing.assert_array_equal(one.ignored, other.ignored)
    names = ("track_id", "status", "reason", "category", "region_px", "unknown_px", "polygon", "polygon_px")
    for mine, its in zip(one.objects, other.objects, strict=True):
        assert all(getattr(mine, name) == getattr(its, name) for name in names)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_order_of_the_annotations_changes_nothing(recordings, frames, seed):
    turned = replace(recordings[seed], tracks=recordings[seed].tracks[::-1])
    assert_same_reference(reference_of(turned, frames[1]), frames[0][seed])


def test_bands_of_static_objects_behind_all_others_are_left_out_and_change_nothing(recordings, monkeypatch):
    banded = []
    monkeypatch.setattr(build, "with_band", lambda region, one: banded.append(one) or with_band(region, one))
    frames = [reference_of(recording, KINDS["unknown bands"]) for recording in recordings]
    needed = len(banded)
    monkeypatch.setattr(build, "without_needless_bands", lambda scanned: scanned)
    for recording, frame in zip(recordings, frames, strict=True):
        assert_same_reference(reference_of(recording, KINDS["unknown bands"]), frame)
    assert 0 < needed < len(banded) - needed
