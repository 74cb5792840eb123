"""KITTI-360 through 123D, converted by its own parser, against our own adapter: what is equal, and each difference.

Where both differ, the comment says which is right; `docs/your-data.md` tells users.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from bench.adapters.kitti360 import kitti360_recordings
from bench.adapters.log123d import log123d_recordings
from bench.recordings import load_card, read_image
from tests.support import log123d
from tests.support import tiny_kitti360 as tiny

pytestmark = pytest.mark.slow

CAMERAS = {"image_02": "fmcam_l", "image_03": "fmcam_r"}
AXLE_M = [-0.01, 0.02, 0.0]  # 123D's vehicle frame in ours: KITTI-360 states no rear axle, and each has its own
RIDER_M = [2, 6, 0, 1]  # in the vehicle frame of frame 6


@pytest.fixture(scope="module")
def both(tmp_path_factory, library):
    """A drive read by our adapter, and as a log of 123D."""
    root = tiny.write_data_set(tmp_path_factory.mktemp("both") / "KITTI-360")
    add_boxes(root)
    logs = root.parent / "123d"
    log123d.convert_kitti360(root, logs / "logs", library)
    recordings = []
    for listing, place, name in (
        (kitti360_recordings, root, "kitti-360"),
        (log123d_recordings, logs, "kitti-360-123d"),
    ):
        card = load_card(name)
        options = card.content.options | {"evaluated_size_px": None}
        (handle,) = listing(place, options=options, card=card.file, annotations=None)
        recordings.append(handle.open())
    return SimpleNamespace(own=recordings[0], log=recordings[1])


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


def boxes(recording, track_id, late_us=0):
    """States of a track by frame."""
    track = next(track for track in recording.tracks if track.track_id == track_id)
    return dict(zip(frames(track.states, late_us), track.states, strict=True))


LATE_US = tiny.SCANNER_LATER_NS // 1000  # poses, boxes and sweeps of logs are at the scanner's note of the instant


def test_lenses_and_mountings_are_the_same(both):
    for name, log_name in CAMERAS.items():
        own, log = both.own.cameras[name], both.log.cameras[log_name]
        assert own.model == log.model
        np.testing.assert_allclose(
            log.vehicle_from_camera.translation_m - own.vehicle_from_camera.translation_m, AXLE_M, atol=1e-6
        )
        np.testing.assert_allclose(log.vehicle_from_camera.rotation, own.vehicle_from_camera.rotation, atol=1e-9)
        assert log.road.height_m == pytest.approx(own.road.height_m)
    lidar = both.log.vehicle_from_lidar @ both.log.lidar_from_sensor
    np.testing.assert_allclose(lidar.translation_m - both.own.vehicle_from_lidar.translation_m, AXLE_M, atol=1e-6)


def test_images_are_the_same_but_for_those_without_a_pose_or_annotations(both):
    for name, log_name in CAMERAS.items():
        # Ours: the annotated stretch, frames 1 to 10, also frame 5, of which poses.txt has no pose. 123D: those of
        # poses.txt. Frame 11 is not annotated: what moves there has no box, and is a false positive.
        assert frames(both.own.images[name]) == [*range(1, 11)]
        assert frames(both.log.images[log_name]) == [1, 2, 3, 4, 6, 7, 8, 9, 10, 11]
        for own, log in zip(both.own.images[name][5:], both.log.images[log_name][4:9], strict=True):
            pixels = read_image(own, both.own.cameras[name])
            np.testing.assert_array_equal(pixels, read_image(log, both.log.cameras[log_name]))


def test_poses_and_points_are_the_same(both):
    for n in (1, 4, 6, 11):
        own = both.own.trajectory.world_from_vehicle(tiny.time_ns(n))
        log = both.log.trajectory.world_from_vehicle(tiny.time_ns(n) + tiny.SCANNER_LATER_NS)
        np.testing.assert_allclose(own.rotation, log.rotation, atol=1e-6)
        np.testing.assert_allclose(
            log.translation_m, (tiny.global_from_vehicle(n) @ [*np.negative(AXLE_M), 1])[:3], atol=1e-4
        )
    own, log = both.own.sweeps[5].read(), both.log.sweeps[4].read()  # of frame 6
    points = both.log.vehicle_from_lidar.apply(log.points_lidar.astype(np.float64))
    expected = both.own.vehicle_from_lidar.apply(own.points_lidar.astype(np.float64)) + AXLE_M
    np.testing.assert_allclose(points, expected, atol=1e-5)
    # Ours come from the azimuth, as in kitti360Scripts' curlVelodyneData. 123D has none: all are as of the middle.
    assert log.time_offset_ns is None
    assert np.ptp(own.time_offset_ns) > 0.9 * tiny.PERIOD_S * 1e9


# A moving car, and one of every third frame, whose velocity the writer of logs has no neighbour for and writes as zero.
@pytest.mark.parametrize(
    ("track_id", "own_frames", "log_frames", "speed_mps"),
    [
        ("26003", [*range(1, 11)], [1, 2, 3, 4, 6, 7, 8, 9, 10], 9.0),
        ("26009", [1, 4, 7, 10], [1, 4, 7, 10], 4.0),
    ],
)
def test_boxes_are_the_same_where_both_have_them(both, track_id, own_frames, log_frames, speed_mps):
    own, log = boxes(both.own, track_id), boxes(both.log, track_id, LATE_US)
    assert [[*own], [*log]] == [own_frames, log_frames]
    for n, state in log.items():
        shift = state.shape.vehicle_from_object.translation_m - own[n].shape.vehicle_from_object.translation_m
        np.testing.assert_allclose(shift, AXLE_M, atol=1e-4)
        turn = state.shape.vehicle_from_object.rotation - own[n].shape.vehicle_from_object.rotation
        np.testing.assert_allclose(turn, 0, atol=1e-6)
        np.testing.assert_allclose(state.shape.size_m, own[n].shape.size_m, atol=1e-6)
        np.testing.assert_allclose([state.velocity_mps, own[n].velocity_mps], [[speed_mps, 0, 0]] * 2, atol=1e-3)


def test_which_objects_there_are(both):
    """Logs have rider and bicycle apart, no vehicles of unknown kind, and nothing that stands and no return shows."""
    assert {t.track_id for t in both.own.tracks} == {"26003", "26004", "24001", "25007+33007", "43008", "26009"}
    assert {t.track_id for t in both.log.tracks} == {"26003", "25007", "33007", "26009"}
    assert both.own.annotated == both.log.annotated  # the log of frames without annotations as well, see above
