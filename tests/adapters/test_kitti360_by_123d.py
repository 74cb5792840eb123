"""KITTI-360 through 123D, converted by its own parser, against our own adapter: what is equal, and each difference.

Where both differ, the comment says which is right; `docs/your-data.md` tells users.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from bench.adapters.kitti360.adapter import kitti360_recordings
from bench.adapters.log123d.adapter import log123d_recordings
from bench.evaluation import load_protocol
from bench.recordings import load_card, read_image
from bench.records.recording import Recording
from bench.reference import ReferenceBuilder, Status
from tests.support import log123d
from tests.support import tiny_kitti360 as tiny

pytestmark = pytest.mark.slow

CAMERAS = {"image_02": "fmcam_l", "image_03": "fmcam_r"}
LATE_US = tiny.SCANNER_LATER_NS // 1000
SEEN = (4, 6, 7)  # frames in which the parked car and the person have returns
PARKED_M, PERSON_M, RIDER_M = [8, 4, 0.8, 1], [3, -9, 0.9, 1], [2, 6, 0, 1]  # in the vehicle frame of frame 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Both:
    """A drive read by our adapter, and as a log of 123D."""

    own: Recording
    log: Recording

    def tracks(self, track_id):
        return tuple(next((t for t in r.tracks if t.track_id == track_id), None) for r in (self.own, self.log))


@pytest.fixture(scope="module")
def both(tmp_path_factory, library):
    root = tiny.write_data_set(tmp_path_factory.mktemp("both") / "KITTI-360")
    for frame in SEEN:
        add_returns(root, frame, PARKED_M, (4.0, 1.7, 1.4))
        add_returns(root, frame, PERSON_M, (0.6, 0.5, 1.8))
    add_boxes(root)
    logs = root.parent / "123d"
    log123d.convert_kitti360(root, logs / "logs", library)
    own, log = load_card("kitti-360"), load_card("kitti-360-123d")
    stored = {"evaluated_size_px": None}
    (own,) = kitti360_recordings(root, options=own.content.options | stored, card=own.file, annotations=None)
    (log,) = log123d_recordings(logs, options=log.content.options | stored, card=log.file, annotations=None)
    return Both(own=own.open(), log=log.open())


def add_returns(root, frame, place, size):
    """60 returns in a box, so that the parser takes it for seen, which needs more than 40."""
    inside = np.random.default_rng(frame).uniform(-0.4, 0.4, (60, 3)) * size
    centre = tiny.global_from_vehicle(6) @ place
    world = np.column_stack([inside @ tiny.rotation_z(tiny.HEADING_RAD).T + centre[:3], np.ones(60)])
    lidar_from_global = np.linalg.inv(tiny.global_from_vehicle(frame) @ tiny.VEHICLE_FROM_LIDAR)
    file = root / "data_3d_raw" / tiny.SEQUENCE / "velodyne_points" / "data" / f"{frame:010d}.bin"
    points = np.column_stack([(world @ lidar_from_global.T)[:, :3], np.full(60, 0.3)])
    file.write_bytes(file.read_bytes() + points.astype("<f4").tobytes())


def add_boxes(root):
    """A rider on a bicycle, a vehicle of unknown kind, and a car that is annotated in every third frame only."""
    ahead = tiny.rotation_z(tiny.HEADING_RAD)[:, 0] * 4.0 * tiny.PERIOD_S
    start = (tiny.global_from_vehicle(6) @ RIDER_M)[:3]
    rows = []
    for n in range(1, 11):
        kinds = [("rider", 20, 7, 1.2, (0.7, 0.6, 1.2)), ("bicycle", 18, 7, 0.5, (1.8, 0.5, 1.0))]
        kinds += [("unknownVehicle", 36, 8, 3.8, (2.0, 1.0, 1.0))]
        kinds += [("car", 13, 9, 6.8, (4.0, 1.8, 1.5))] if n % 3 == 1 else []
        for label, semantic, instance, up_m, size in kinds:
            kind = {"label": label, "semantic": semantic, "instance": instance, "size": size, "frame": n}
            rows.append(tiny.object_xml(1000 + len(rows), **kind, centre=start + ahead * n + [0, 0, up_m]))
    file = root / "data_3d_bboxes" / "train" / f"{tiny.SEQUENCE}.xml"
    file.write_text(file.read_text().replace("</opencv_storage>", "".join(rows) + "</opencv_storage>"))


def frames(refs, late_us=0):
    """Numbers of frames by their time, which 123D has in whole microseconds."""
    by_us = {tiny.time_ns(n) // 1000 + late_us: n for n in range(tiny.FRAMES)}
    return [by_us[ref.timestamp_ns // 1000] for ref in refs]


def test_lenses_and_mountings_are_the_same_but_for_the_rear_axle(both):
    for name, log_name in CAMERAS.items():
        own, log = both.own.cameras[name], both.log.cameras[log_name]
        assert own.model == log.model
        assert own.model.tangential == (0.0042, -0.003)
        shift = log.vehicle_from_camera.translation_m - own.vehicle_from_camera.translation_m
        np.testing.assert_allclose(shift, [-0.01, 0.02, 0], atol=1e-6)
        np.testing.assert_allclose(log.vehicle_from_camera.rotation, own.vehicle_from_camera.rotation, atol=1e-9)
        assert log.road.height_m == pytest.approx(own.road.height_m)
    # KITTI-360 states no rear axle. 123D has it 0.05 m ahead and 0.32 m to the right of the inertial sensor; we have
    # the scanner 0.76 m ahead of it in the middle of the car. All sensors are shifted together, which moves no pixel.
    lidar = both.log.vehicle_from_lidar @ both.log.lidar_from_sensor
    shift = lidar.translation_m - both.own.vehicle_from_lidar.translation_m
    np.testing.assert_allclose(shift, [-0.01, 0.02, 0], atol=1e-6)
    np.testing.assert_allclose(
        both.log.vehicle_outline_m.max(axis=0) - both.log.vehicle_outline_m.min(axis=0), [4.775, 1.82]
    )


def test_images_are_those_with_a_pose_with_or_without_annotations(both):
    for name, log_name in CAMERAS.items():
        # Ours: the annotated stretch, frames 1 to 10, also frame 5, of which poses.txt has no pose.
        assert frames(both.own.images[name]) == [*range(1, 11)]
        # 123D: those of poses.txt. Frame 11 is not annotated: what moves there has no box, and is a false positive.
        assert frames(both.log.images[log_name]) == [1, 2, 3, 4, 6, 7, 8, 9, 10, 11]
        cameras = both.own.cameras[name], both.log.cameras[log_name]
        pairs = zip(both.own.images[name][5:], both.log.images[log_name][4:9], strict=True)
        for images in pairs:
            np.testing.assert_array_equal(*(read_image(i, c) for i, c in zip(images, cameras, strict=True)))
            assert 0 <= images[0].timestamp_ns - images[1].timestamp_ns < 1000


def test_poses_boxes_and_sweeps_are_at_the_scanners_time(both):
    """Its note of a frame's instant, which is not the camera's: a frame is one instant, as poses by frame say."""
    poses = both.log.trajectory
    for n in (1, 4, 6, 11):
        noted_ns = tiny.time_ns(n) + tiny.SCANNER_LATER_NS
        own, log = both.own.trajectory.world_from_vehicle(tiny.time_ns(n)), poses.world_from_vehicle(noted_ns)
        np.testing.assert_allclose(log.rotation, tiny.global_from_vehicle(n)[:3, :3], atol=1e-6)
        np.testing.assert_allclose(own.rotation, log.rotation, atol=1e-6)
        axle = [0.01, -0.02, 0, 1]
        np.testing.assert_allclose(log.translation_m, (tiny.global_from_vehicle(n) @ axle)[:3], atol=1e-4)
        # At the time of the image the car of the log is 6 ms behind: 3 cm at 5 m/s.
        behind = log.translation_m - poses.world_from_vehicle(tiny.time_ns(n)).translation_m
        assert np.linalg.norm(behind) == pytest.approx(tiny.EGO_MPS * tiny.SCANNER_LATER_NS / 1e9, abs=1e-4)
    assert frames(both.log.sweeps, LATE_US) == [1, 2, 3, 4, 6, 7, 8, 9, 10, 11]
    own, log = both.tracks("26003")
    assert frames(own.states) == [*range(1, 11)]
    assert frames(log.states, LATE_US) == [1, 2, 3, 4, 6, 7, 8, 9, 10]


def test_points_are_the_same_without_their_times_and_with_coarse_intensity(both):
    own, log = (r.sweeps[5 - ours].read() for r, ours in ((both.own, 0), (both.log, 1)))  # of frame 6
    points = both.log.vehicle_from_lidar.apply(log.points_lidar.astype(np.float64))
    expected = both.own.vehicle_from_lidar.apply(own.points_lidar.astype(np.float64))
    np.testing.assert_allclose(points - expected, np.broadcast_to([-0.01, 0.02, 0.0], points.shape), atol=1e-5)
    # Ours come from the azimuth, as in kitti360Scripts' curlVelodyneData. 123D has none: all are as of the middle.
    assert log.time_offset_ns is None
    assert np.ptp(own.time_offset_ns) > 0.9 * tiny.PERIOD_S * 1e9
    np.testing.assert_array_equal(log.intensity, np.floor(own.intensity * 255).astype(np.float32) / np.float32(255))


def test_the_reference_of_a_car_that_passes_differs_by_a_tenth(both):
    """It passes 5 m beside the ego vehicle with 4 m/s; without times of points, a fifth of them leaves its box."""
    rules = load_protocol("paper-v1").reference_settings()
    builders = ReferenceBuilder(both.own, "image_03", rules), ReferenceBuilder(both.log, "fmcam_r", rules)
    for frame in (8, 9):
        images = both.own.images["image_03"][frame - 1], both.log.images["fmcam_r"][frame - 2]
        assert [*map(frames, ([image] for image in images))] == [[frame], [frame]]
        found = [builder.build(image) for builder, image in zip(builders, images, strict=True)]
        cars = [next(o for o in reference.objects if o.track_id == "26003") for reference in found]
        assert [car.status for car in cars] == [Status.EVALUATED] * 2
        assert cars[1].points == pytest.approx(0.8 * cars[0].points, rel=0.05)
        own, log = (reference.labels > 0 for reference in found)
        assert (own & log).sum() / (own | log).sum() == pytest.approx(0.92, abs=0.02)


def test_boxes_are_the_same_where_both_have_them(both):
    own, log = both.tracks("26003")
    later = dict(zip(frames(log.states, LATE_US), log.states, strict=True))
    for n, state in zip(frames(own.states), own.states, strict=True):
        if n in later:
            shift = later[n].shape.vehicle_from_object.translation_m - state.shape.vehicle_from_object.translation_m
            np.testing.assert_allclose(shift, [-0.01, 0.02, 0], atol=1e-4)
            np.testing.assert_allclose(
                later[n].shape.vehicle_from_object.rotation, state.shape.vehicle_from_object.rotation, atol=1e-6
            )
            np.testing.assert_allclose(later[n].shape.size_m, state.shape.size_m, atol=1e-6)
            np.testing.assert_allclose(later[n].velocity_mps, state.velocity_mps, atol=1e-3)
    assert own.object_class == log.object_class == "vehicle"


def test_what_stands_has_boxes_only_where_the_scanner_saw_it(both):
    """Ours has it at every frame near it, since it also hides what moves where returns are few."""
    own, log = both.tracks("26004")
    assert frames(own.states) == [*range(1, 11)]
    assert frames(log.states, LATE_US) == [*SEEN]
    for n, state in zip(SEEN, log.states, strict=True):
        expected = own.states[n - 1].shape
        shift = state.shape.vehicle_from_object.translation_m - expected.vehicle_from_object.translation_m
        np.testing.assert_allclose(shift, [-0.01, 0.02, 0], atol=1e-4)
        np.testing.assert_allclose(state.shape.size_m, expected.size_m)
        np.testing.assert_allclose(state.velocity_mps, 0, atol=1e-9)


def test_people_who_are_not_marked_dynamic_stand_in_logs(both):
    """Ours ignores them, since some of them do walk (kitti360Scripts #77); logs do not say what was marked."""
    own, log = both.tracks("24001")
    assert all(state.unclear for state in own.states)
    assert not any(state.unclear for state in log.states)


def test_a_rider_and_the_bicycle_are_two_cyclists_in_logs(both):
    cyclists = [[t.track_id for t in r.tracks if t.object_class == "cyclist"] for r in (both.own, both.log)]
    assert cyclists == [["25007+33007"], ["25007", "33007"]]


def test_vehicles_of_unknown_kind_are_not_in_logs(both):
    assert [t is None for t in both.tracks("43008")] == [False, True]


def test_a_velocity_that_the_writer_had_no_neighbour_for_is_not_zero(both):
    """123D writes zero where the frames before and after have no box of an object."""
    own, log = both.tracks("26009")
    assert frames(log.states, LATE_US) == [1, 4, 7, 10]
    for track in (own, log):
        for state in track.states:
            np.testing.assert_allclose(state.velocity_mps, [4.0, 0, 0], atol=1e-3)


def test_nothing_else_differs_in_which_objects_there_are(both):
    assert {t.track_id for t in both.own.tracks} == {"26003", "26004", "24001", "25007+33007", "43008", "26009"}
    assert {t.track_id for t in both.log.tracks} == {"26003", "26004", "24001", "25007", "33007", "26009"}
    assert both.own.annotated == both.log.annotated  # the log of frames without annotations as well, see above
