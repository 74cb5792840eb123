"""The KITTI-360 adapter: a miniature with known truth, and the real calibration and scans."""

import shutil
from functools import partial

import numpy as np
import pytest

from bench.adapters.kitti360_boxes import read_boxes
from bench.adapters.kitti_files import read_clock
from bench.errors import DataError
from bench.evaluation.protocol import load_protocol
from bench.recordings import load_card, open_dataset
from bench.records.recording import COMPLETELY, NOT_ANNOTATED
from bench.records.reference import IgnoreReason, Status
from bench.reference.build import ReferenceBuilder
from tests.support import data_sets
from tests.support import tiny_kitti360 as tiny
from tests.support.real import REAL, needs_real


@pytest.fixture
def root(tmp_path):
    return tiny.write_data_set(tmp_path / "KITTI-360")


opened = partial(data_sets.opened, "kitti360", **tiny.OPTIONS)


def boxes_file(root):
    return root / "data_3d_bboxes" / "train" / f"{tiny.SEQUENCE}.xml"


def test_sensors_stand_where_calibration_and_sensor_plan_put_them_and_a_frame_is_one_instant(root):
    recording = opened(root)
    assert recording.vehicle_from_lidar.matrix == pytest.approx(tiny.VEHICLE_FROM_LIDAR)
    left, right = (recording.cameras[name].vehicle_from_camera for name in ("image_02", "image_03"))
    assert left.translation_m == pytest.approx([0.69, 0.45, 1.97])
    assert right.translation_m == pytest.approx([0.66, -0.45, 1.98])
    assert left.rotation[:, 2] == pytest.approx([0, 1, 0])  # looks to the left
    assert right.rotation[:, 2] == pytest.approx([0, -1, 0])
    assert right.rotation[:, 1] == pytest.approx([0, 0, -1])  # y down
    assert recording.cameras["image_03"].road.height_m == pytest.approx(1.98)
    model = recording.cameras["image_03"].model
    assert (model.xi, model.radial, model.tangential) == (2.2, (0.016, 1.65), (0.0042, -0.003))
    assert (model.focal, model.principal_point) == ((133.0, 132.0), (70.5, 69.0))
    assert recording.frame_interval_ns == pytest.approx(103_600_000, abs=1)
    annotated_ns = [tiny.time_ns(n) for n in range(1, 11)]
    for refs in (*recording.images.values(), recording.sweeps):
        assert [ref.timestamp_ns for ref in refs] == annotated_ns


def test_the_host_drives_and_a_missing_pose_is_filled(root):
    trajectory = opened(root).trajectory
    for n in range(1, 12):
        pose = trajectory.world_from_vehicle(tiny.time_ns(n))
        assert pose.translation_m[2] == pytest.approx(0, abs=1e-6)
        assert trajectory.velocity_vehicle_mps(tiny.time_ns(n)) == pytest.approx([tiny.EGO_MPS, 0, 0], abs=1e-4)
    with pytest.raises(DataError, match=r"poses\.txt: timestamp_ns: expected ego-motion at"):
        trajectory.world_from_vehicle(tiny.time_ns(0))


def test_the_moving_car_is_one_track_that_is_where_it_was(root):
    track = next(t for t in opened(root).tracks if t.track_id == "26003")
    assert (track.object_class, len(track.states)) == ("vehicle", 10)
    for n, state in enumerate(track.states, start=1):
        assert state.timestamp_ns == tiny.time_ns(n)
        box = state.shape
        assert box.size_m == pytest.approx(tiny.CAR_SIZE)
        assert box.vehicle_from_object.translation_m == pytest.approx(tiny.in_vehicle(n, tiny.car_centre(n)), abs=1e-4)
        assert box.vehicle_from_object.rotation == pytest.approx(np.eye(3), abs=1e-6)
        assert state.velocity_mps == pytest.approx([tiny.CAR_MPS, 0, 0], abs=1e-3)
        assert not state.unclear


def test_a_car_drawn_backwards_along_another_axis_drives_forward(root):
    axes = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]  # the box's y is behind
    boxes_file(root).write_text(tiny.boxes_xml(axes=axes))
    track = next(t for t in opened(root).tracks if t.track_id == "26003")
    for state in track.states:
        assert state.shape.size_m == pytest.approx(tiny.CAR_SIZE)
        assert state.shape.vehicle_from_object.rotation == pytest.approx(np.eye(3), abs=1e-6)


def test_what_stands_stands_at_every_frame_near_it(root):
    tracks = {track.track_id: track for track in opened(root).tracks}
    assert set(tracks) == {"26003", "26004", "24001"}  # neither the building nor the car 600 m away
    parked = tracks["26004"].states
    assert len(parked) == 10
    for n, state in enumerate(parked, start=1):
        expected = tiny.in_vehicle(n, (tiny.global_from_vehicle(6) @ [8, 4, 0.8, 1])[:3])
        assert state.shape.vehicle_from_object.translation_m == pytest.approx(expected, abs=1e-4)
        assert state.velocity_mps.tolist() == [0, 0, 0]
        assert not state.unclear
    assert all(state.unclear for state in tracks["24001"].states)  # people without "dynamic" may walk all the same


def test_a_rider_and_their_bicycle_are_one_cyclist(root):
    """Both boxes move together, the bicycle's is missing once; the rider passes another bicycle, which is parked."""
    forward = tiny.rotation_z(tiny.HEADING_RAD) @ [6.0 * tiny.PERIOD_S, 0.0, 0.0]
    start = (tiny.global_from_vehicle(1) @ [10.0, 4.0, 0.0, 1.0])[:3]
    rows = []
    for n in range(1, 11):
        wheels = start + forward * (n - 1)
        boxes = {"rider": (20, [-0.2, 0.0, 1.3], (0.7, 0.6, 1.0)), "bicycle": (18, [0.0, 0.0, 0.5], (1.8, 0.5, 1.0))}
        for label, (semantic, offset, size) in boxes.items():
            if (label, n) != ("bicycle", 4):
                centre = wheels + tiny.rotation_z(tiny.HEADING_RAD) @ offset
                kind = {"label": label, "semantic": semantic, "instance": 7}
                rows.append(tiny.object_xml(100 * n + semantic, **kind, centre=centre, size=size, frame=n))
    parked = {"label": "bicycle", "semantic": 18, "instance": 8, "centre": start + forward * 5 + [0.0, 0.0, 0.5]}
    rows.append(tiny.object_xml(90, **parked, size=(1.8, 0.5, 1.0), frame=-1))
    boxes_file(root).write_text(tiny.boxes_xml(more="".join(rows)))
    cyclists = {t.track_id: t for t in opened(root).tracks if t.object_class == "cyclist"}
    assert set(cyclists) == {"25007+33007", "33008"}
    states = cyclists["25007+33007"].states
    assert len(states) == 10
    assert states[0].shape.size_m == pytest.approx([1.8, 0.6, 1.8])
    assert states[3].shape.size_m == pytest.approx([0.7, 0.6, 1.0])  # the rider alone
    bottom = states[0].shape.vehicle_from_object.translation_m[2] - 0.9
    assert bottom == pytest.approx(0.0, abs=1e-6)
    assert states[6].velocity_mps == pytest.approx([6.0, 0.0, 0.0], abs=1e-3)


@pytest.mark.parametrize("frame", [3, 8])
def test_the_reference_lies_on_the_car_in_the_image(root, frame):
    """The returns come from a clockwise scan by a moving vehicle of a moving car; the truth is the car at exposure."""
    recording = opened(root)
    camera = recording.cameras["image_03"]
    image = next(i for i in recording.images["image_03"] if i.timestamp_ns == tiny.time_ns(frame))
    builder = ReferenceBuilder(recording, "image_03", load_protocol("paper-v1").reference)
    seen = builder.geometry("26003", image)
    assert len(seen.cluster_vehicle) == len(tiny.surface())
    assert seen.cluster_vehicle == pytest.approx(tiny.car_at(frame), abs=0.02)  # uncorrected: up to 0.5 m off
    pixels, valid = camera.model.project(camera.vehicle_from_camera.inverse().apply(tiny.car_at(frame)))
    assert valid.all()
    assert seen.pixels == pytest.approx(pixels, abs=0.5)
    reference = builder.build(image)
    found = {item.track_id: item for item in reference.objects}
    assert found["26003"].status is Status.EVALUATED
    assert found["26003"].category == "overtaking"
    assert found["26004"].status is Status.STATIC
    assert found["24001"].reason is IgnoreReason.UNCLEAR


def test_excluded_frames_are_named_by_their_number(root):
    excluded = [
        {"sequence": "0003", "frames": [0, 4], "reason": "not labelled"},
        {"sequence": "0000", "frames": [0, 249], "reason": "of a sequence that is not there"},
    ]
    recording = opened(root, excluded_frames=excluded)
    assert recording.images["image_02"][0].timestamp_ns == tiny.time_ns(5)


def test_a_long_gap_stays_open_unless_the_car_stood_and_one_pose_is_none(root):
    poses, times_ns = root / "data_poses" / tiny.SEQUENCE / "poses.txt", np.array([tiny.time_ns(n) for n in range(12)])
    first, *_, last = poses.read_text().splitlines()
    poses.write_text(f"{first}\n{last}\n")
    assert opened(root).trajectory.at(times_ns)[2].tolist() == [False, True, *[False] * 9, True]
    poses.write_text(f"{first}\n{last.split()[0]} {first.split(' ', 1)[1]}\n")  # where it was before
    trajectory = opened(root).trajectory
    assert trajectory.at(times_ns)[2].tolist() == [False, *[True] * 11]
    assert trajectory.velocity_vehicle_mps(tiny.time_ns(6)) == pytest.approx([0, 0, 0], abs=1e-9)
    poses.write_text(f"{first}\n")
    with pytest.raises(DataError, match=r"poses\.txt: expected at least two poses, got 1"):
        opened(root)


def test_a_drive_whose_first_frames_were_cut_off(tmp_path):
    file = tmp_path / "timestamps.txt"
    file.write_text("".join(f"{tiny.stamp(n)}\n" for n in range(3)))
    clock = read_clock(file, [4391, 4392, 4394])
    assert clock.times_ns == {4391: tiny.time_ns(0), 4392: tiny.time_ns(1), 4394: tiny.time_ns(2)}
    with pytest.raises(DataError, match=r"timestamps\.txt: expected a line for each frame up to 9, got 3 lines"):
        read_clock(file, [8, 9])


def test_an_object_without_end_is_not_held_in_memory(tmp_path):
    file = tmp_path / "endless.xml"
    file.write_text("<opencv_storage><object1><data>" + "1.0 " * 10_000_000)
    with pytest.raises(DataError, match=r"expected objects of at most 32000000 bytes, got a longer one"):
        read_boxes(file)


def test_boxes_that_were_not_named_but_move_are_unclear(root):
    """In some files semanticId is missing, and the label or dynamicSeq has to do."""
    text = boxes_file(root).read_text()
    without = text.replace("<semanticId>13</semanticId>", "")
    boxes_file(root).write_text(without)
    tracks = {track.track_id: track for track in opened(root).tracks}
    assert len(tracks["dynamic-0"].states) == 10
    assert not any(state.unclear for state in tracks["dynamic-0"].states)
    boxes_file(root).write_text(without.replace("<label>car</label>", "<label>cart</label>"))
    tracks = {track.track_id: track for track in opened(root).tracks}
    assert all(state.unclear for state in tracks["dynamic-0"].states)


def test_the_card_of_the_data_set_opens_a_part_of_it(root, monkeypatch):
    monkeypatch.setenv("KITTI360_DATASET", str(root))
    card = load_card("kitti-360")
    (handle,) = open_dataset(card)
    recording = handle.open()
    assert (recording.name, recording.annotated) == (tiny.SEQUENCE, COMPLETELY)
    boxes_file(root).unlink()
    assert handle.open().annotated == NOT_ANNOTATED
    ranges = {(e["sequence"], *e["frames"]) for e in card.content.options["excluded_frames"]}
    assert ranges == {("0000", 0, 249), ("0004", 0, 2896)}


@pytest.fixture
def real_root(root):
    """The miniature with the real calibration and two real scans in its place."""
    for path in (REAL / "kitti360/calibration").iterdir():
        target = root / "calibration" / path.name
        target.unlink(missing_ok=True)
        shutil.copyfile(path, target)
    scans = root / "data_3d_raw" / tiny.SEQUENCE / "velodyne_points/data"
    for frame, path in ((6, "0000003000.bin"), (7, "0000003001.bin")):
        shutil.copyfile(REAL / "kitti360/data_3d_raw/velodyne_points" / path, scans / f"{frame:010d}.bin")
    return root


@needs_real
def test_the_real_calibration(real_root):
    recording = opened(real_root)
    left, right = recording.cameras["image_02"], recording.cameras["image_03"]
    assert left.model.tangential == (4.2223943394772046e-04, 4.2462134260997584e-04)
    assert (left.model.width, left.model.height) == (1400, 1400)
    assert np.degrees(left.model.limit_angle_rad) == pytest.approx(116.9, abs=0.1)
    # On either side of the roof, level, looking away from each other.
    assert left.vehicle_from_camera.translation_m == pytest.approx([0.72, 0.45, 1.96], abs=0.02)
    assert right.vehicle_from_camera.translation_m == pytest.approx([0.69, -0.45, 1.97], abs=0.02)
    assert left.vehicle_from_camera.rotation[:, 2] == pytest.approx([-0.03, 1.0, 0], abs=0.015)
    assert right.vehicle_from_camera.rotation[:, 2] == pytest.approx([-0.025, -1.0, 0], abs=0.01)
    assert recording.vehicle_from_lidar.translation_m == pytest.approx([0.76, 0, 1.73])
    pixels = np.array([[700.0, 700.0], [100.0, 700.0], [700.0, 1300.0], [1250.0, 250.0]])
    rays, valid = right.model.unproject(pixels)
    assert valid.all()
    assert right.model.project(rays)[0] == pytest.approx(pixels, abs=1e-6)


@needs_real
def test_the_real_scans(real_root):
    recording = opened(real_root)
    for frame, points in ((6, 111_883), (7, 113_489)):
        sweep = recording.sweeps[frame - 1].read()
        assert sweep.points_lidar.shape == (points, 3)
        # A whole turn around the time of the frame; ahead at 0, the left before the right.
        assert sweep.time_offset_ns.min() == pytest.approx(-51.8e6, abs=0.2e6)
        assert sweep.time_offset_ns.max() == pytest.approx(51.8e6, abs=0.2e6)
        x, y, _ = sweep.points_lidar.T
        assert np.abs(sweep.time_offset_ns[(x > 5) & (np.abs(y) < 0.05)]).max() < 0.3e6
        assert (sweep.time_offset_ns[(y > 0.1) & (x > 0)] < 0).all()
        road = recording.vehicle_from_lidar.apply(sweep.points_lidar.astype(np.float64))
        near = road[(np.abs(road[:, 0]) < 8) & (np.abs(road[:, 1]) < 3) & (np.abs(road[:, 2]) < 0.5)]
        # The road is where the vehicle frame has it, as far as it is flat.
        assert len(near) > 5000
        assert np.median(near[:, 2]) == pytest.approx(0, abs=0.08)
