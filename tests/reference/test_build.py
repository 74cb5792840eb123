"""From annotations to regions: where every object ends, and which pixels it owns."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from bench.errors import DataError, UsageError
from bench.recordings import ImageRef, ObjectState, PointIndices, Track
from bench.reference import Category, Direction, IgnoreReason, ReferenceBuilder, Status
from bench.reference.motion import AnnotationIndex
from bench.reference.sweeps import SweepCache
from tests.reference.drives import MS, SETTINGS, Box, camera, circle, drive, reference_of, with_settings

SIZE = (1.0, 1.0, 1.6)
EGO = {"speed_mps": 5.0, "yaw_rate_radps": 0.0}
WALKER = Box((8.0, 1.0, 0.8), SIZE, (0.0, -1.4, 0.0))


def build(boxes, trajectory=None, *, exposure_ns=30 * MS, settings=SETTINGS, **options):
    return reference_of(drive(boxes, trajectory or circle(**EGO), exposures_ns=(exposure_ns,), **options), settings)


def test_a_crossing_walker_is_evaluated_with_all_its_words():
    frame = build([WALKER])
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


def test_the_polygon_lies_on_the_object_at_exposure():
    trajectory = circle(**EGO)
    frame = build([WALKER], trajectory)
    mounted = camera()
    world_from_camera = trajectory.world_from_vehicle(30 * MS) @ mounted.vehicle_from_camera
    corners = WALKER.world_from_box(30 * MS).apply(WALKER.skin(20000, seed=5))
    corners = corners[corners[:, 2] > 0.05]
    pixels, _ = mounted.model.project(world_from_camera.inverse().apply(corners))
    truth = shapely.MultiPoint(pixels).convex_hull
    polygon = frame.objects[0].polygon
    assert polygon.intersection(truth).area / polygon.union(truth).area > 0.93


def test_nearer_objects_take_the_pixels_whatever_their_status():
    far = Box((9.5, 1.7, 0.8), SIZE, (0.0, -1.4, 0.0))
    alone = build([far]).objects[0].region_px
    for velocity, status in (((0.0, 1.4, 0.0), Status.EVALUATED), ((0.0, 0.0, 0.0), Status.STATIC)):
        near = Box((7.0, 0.3, 0.8), SIZE, velocity)
        frame = build([far, near])
        assert [item.track_id for item in frame.objects] == ["object-1", "object-0"]
        assert frame.objects[0].status is status
        assert 0 < frame.objects[1].region_px < alone
        assert frame.objects[1].polygon_px == pytest.approx(alone, rel=0.02)
        assert (frame.labels == 2).sum() == frame.objects[1].region_px


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
    frame = build([box], **options)
    (found,) = frame.objects
    assert (found.status, found.reason) == (Status.IGNORED, reason)
    assert found.region_px == 0
    assert not frame.labels.any()
    # Ignored pixels are there wherever the object is in view, from its outline where points do not suffice.
    assert frame.ignored.any() == (reason is not IgnoreReason.OUT_OF_VIEW)


def test_limits_hold_at_equality():
    """Range, points and pixels of an object are still within a limit that they meet."""
    (walker,) = build([WALKER]).objects
    limits = {
        "range_limit_m": (walker.range_m, np.nextafter(walker.range_m, 0.0), IgnoreReason.RANGE),
        "min_points": (walker.points, walker.points + 1, IgnoreReason.FEW_POINTS),
        "min_polygon_px": (walker.polygon_px, walker.polygon_px + 1, IgnoreReason.SMALL_POLYGON),
    }
    for name, (met, missed, reason) in limits.items():
        reasons = [
            build([WALKER], settings=with_settings(**{name: limit})).objects[0].reason for limit in (met, missed)
        ]
        assert reasons == [None, reason]


def test_static_objects_are_neither_evaluated_nor_ignored():
    frame = build([Box((8, 1, 0.8), SIZE, (0.1, 0, 0))])
    assert (frame.objects[0].status, frame.objects[0].category) == (Status.STATIC, None)
    assert not frame.ignored.any()


def test_the_annotators_word_decides_the_category():
    assert build([WALKER], category="approaching").objects[0].category is Category.APPROACHING
    still = Box((8, 1, 0.8), SIZE, (0, 0, 0))
    assert build([still], category="crossing").objects[0].status is Status.EVALUATED


def test_stationary_ego_vehicle():
    frame = build([WALKER], circle(0.0, 0.0))
    assert frame.objects[0].category is Category.STATIC_EGO
    assert frame.objects[0].direction is Direction.LATERAL


def test_annotations_and_sweeps_too_far_in_time_are_not_of_this_image():
    """The exposure is at 30 ms, and 100 ms are near enough."""
    for apart_ns, near in ((100 * MS, True), (100 * MS + 1, False)):
        for time_ns in (30 * MS - apart_ns, 30 * MS + apart_ns):
            assert len(build([WALKER], state_ns=(time_ns,)).objects) == near
            (walker,) = build([WALKER], sweep_ns=(time_ns,)).objects
            assert (walker.reason is IgnoreReason.NO_SWEEP) == (not near)
    assert len(build([WALKER], state_ns=(-60 * MS, 100 * MS)).objects) == 1


def test_of_annotations_or_sweeps_equally_near_the_earlier_counts():
    recording = drive([WALKER], circle(**EGO), state_ns=(0, 60 * MS), sweep_ns=(0, 60 * MS))
    for exposure_ns, nearest_ns in ((30 * MS, 0), (30 * MS + 1, 60 * MS)):
        (annotated,) = AnnotationIndex(recording, SETTINGS).at(exposure_ns)
        assert annotated.state.timestamp_ns == nearest_ns
        assert SweepCache(recording, 100 * MS).nearest(None, exposure_ns).sweep.timestamp_ns == nearest_ns


def test_the_ego_vehicles_own_body_is_no_reference():
    body = np.zeros((480, 640), dtype=bool)
    body[300:] = True
    recording = drive([WALKER], circle(**EGO), exposures_ns=(30 * MS,))
    whole = reference_of(recording)
    recording.cameras["front"] = camera(ego_body=body)
    cut = reference_of(recording)
    assert not cut.valid[300:].any()
    assert cut.objects[0].region_px == (whole.labels[:300] == 1).sum()


def test_point_indices_without_velocity_say_nothing_about_motion():
    recording = drive([WALKER], circle(**EGO), exposures_ns=(30 * MS,))
    shape = PointIndices(indices=np.arange(400), sweep_timestamp_ns=0)
    state = ObjectState(timestamp_ns=0, shape=shape, velocity_mps=np.full(3, np.nan))
    named = replace(state, category="crossing")
    lost = replace(state, shape=replace(shape, sweep_timestamp_ns=7))

    def frame(chosen):
        return reference_of(replace(recording, tracks=(Track(track_id="p", object_class="vehicle", states=(chosen,)),)))

    assert frame(state).objects[0].reason is IgnoreReason.MOTION_UNKNOWN
    assert frame(named).objects[0].status is Status.EVALUATED
    with pytest.raises(DataError, match="a lidar sweep at 7"):
        frame(lost)


def test_no_ego_motion_is_a_clear_error():
    recording = drive([WALKER], circle(**EGO), exposures_ns=(9000 * MS,))
    builder = ReferenceBuilder(recording, "front", SETTINGS)
    with pytest.raises(DataError, match="expected ego-motion at 9000000000"):
        builder.build(ImageRef(camera="front", timestamp_ns=9000 * MS, path=recording.images["front"][0].path))


def test_geometry_to_look_at():
    recording = drive([WALKER], circle(**EGO), exposures_ns=(30 * MS,))
    builder, image = ReferenceBuilder(recording, "front", SETTINGS), recording.images["front"][0]
    found = builder.geometry("object-0", image)
    assert len(found.cluster_vehicle) == len(found.pixels) > 300
    assert len(found.surroundings_vehicle) == 600
    # Seen from above: a square of a metre around the walker, where it is 30 ms later.
    np.testing.assert_allclose(found.outline_m.mean(axis=0), [8.0 - 0.15, 1.0 - 0.042], atol=1e-6)
    np.testing.assert_allclose(np.ptp(found.outline_m, axis=0), [1.0, 1.0], atol=1e-6)
    with pytest.raises(UsageError, match="nobody"):
        builder.geometry("nobody", image)
