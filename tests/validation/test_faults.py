"""Each fault is really put into a copy of a clean recording, and it alone is told."""

import json
import shutil
from copy import deepcopy
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.geometry import RigidTransform
from bench.lidar import LidarSweep, read_sweep
from bench.recordings import Cuboid, ObjectState, RecordingWriter, Track
from bench.recordings.native import native_recordings, open_native
from bench.validation import Depth, Severity, box_fit, boxes
from bench.validation.boxes import check_boxes
from bench.validation.images import ImageOrder
from bench.validation.report import BY_EGO_MOTION
from bench.validation.sweeps import seen_road
from tests.support import tiny
from tests.support.clouds import pcd_of
from tests.support.planting import (
    change_boxes,
    change_bus,
    change_head,
    change_json,
    change_mounting,
    change_sweep,
    change_sweeps,
    sweep_files,
)
from tests.validation import drive
from tests.validation.drive import found, with_points


def images(root):
    return sorted((root / "images" / "front").iterdir())


def sweep_of(change):
    return lambda root: change_sweep(sweep_files(root)[3], with_points(change))


def cuboids(change, only=None):
    """Change the ten numbers of boxes: centre, quaternion x, y, z, w, size; `change(numbers, number of the time)`."""
    return lambda root: change_boxes(root, lambda _name, i, data: change(data["cuboid"][0]["val"], i), only=only)


@pytest.fixture
def root(root):
    """The clean recording with boxes that hold their returns; those of the drive end where the objects do."""

    def grow(numbers, _i):
        numbers[7:10] = [size + 2 * drive.MARGIN_M for size in numbers[7:10]]

    cuboids(grow)(root)
    return root


def velocities(change, only):
    def velocity(_name, _i, data):
        (entry,) = [entry for entry in data["vec"] if entry["name"] == "velocity_mps"]
        entry["val"] = change(entry["val"])

    return lambda root: change_boxes(root, velocity, only=only)


def annotations(change):
    return lambda root: change_json(root / "annotations.json", lambda content: change(content["openlabel"]))


@pytest.mark.parametrize("depth", [Depth.SAMPLED, pytest.param(Depth.DEEP, marks=pytest.mark.slow)])
def test_a_clean_recording_has_no_findings(root, depth):
    assert found(root, depth, static_world=True, returns=True) == []


# ---------------------------------------------------------------- faults of one finding


def gap_between_images(root):
    for path in images(root)[10:13]:
        path.unlink()


def slow_clock(root):
    for path in images(root):
        late_ns = round((int(path.stem) - drive.START_NS) * 4e-3)  # 6 ms over the recording
        path.rename(path.with_stem(str(int(path.stem) + late_ns)))


def ego_body_inside_out(root):
    (mask,) = (root / "ego_body").iterdir()
    cv2.imwrite(str(mask), 255 - cv2.imread(str(mask), cv2.IMREAD_GRAYSCALE))


def annotated_later(openlabel):
    for frame in openlabel["frames"].values():
        frame["frame_properties"]["timestamp"] += 20 * 10**9


def stretched_once(numbers, i):
    numbers[7] *= 2.0 if i == 5 else 1.0


def rotated_by_90_degrees(numbers, _i):
    """Length and width swapped with the heading."""
    rotation = Rotation.from_quat(numbers[3:7]) * Rotation.from_euler("z", 90, degrees=True)
    numbers[3:7], numbers[7], numbers[8] = rotation.as_quat().tolist(), numbers[8], numbers[7]


def twice(openlabel):
    openlabel["objects"]["copy"] = openlabel["objects"]["leader"] | {"name": "copy"}
    for frame in openlabel["frames"].values():
        frame["objects"]["copy"] = frame["objects"]["leader"]


def renamed(openlabel, numbers):
    """The leader's labels under another name in some frames."""
    openlabel["objects"]["other"] = openlabel["objects"]["leader"] | {"name": "other"}
    for number in numbers:
        objects = openlabel["frames"][str(number)]["objects"]
        objects["other"] = objects.pop("leader")


def exchanged(openlabel):
    """Two walkers, a metre apart, whose names are exchanged in the second half."""
    openlabel["objects"]["friend"] = openlabel["objects"]["walker"] | {"name": "friend"}
    for number, frame in openlabel["frames"].items():
        friend = deepcopy(frame["objects"]["walker"])
        friend["object_data"]["cuboid"][0]["val"][0] += 1.0
        first, last = ("walker", "friend") if int(number) < 8 else ("friend", "walker")
        frame["objects"] |= {first: frame["objects"]["walker"], last: friend}


def unknown_category(openlabel):
    state = openlabel["frames"]["3"]["objects"]["walker"]["object_data"]
    state["text"] = [{"name": "category", "val": "sideways"}]


OF_IMAGES = {"image-gaps", "clock-drift", "same-image", "camera-mounting", "sensor-outside", "ego-body"}


@pytest.mark.parametrize(
    ("plant", "severity", "check"),
    [
        (gap_between_images, "warning", "image-gaps"),
        (slow_clock, "warning", "clock-drift"),
        (lambda root: shutil.copy(images(root)[4], images(root)[5]), "error", "same-image"),
        (lambda root: shutil.copy(images(root)[4], images(root)[15]), "error", "same-image"),
        (annotations(annotated_later), "error", "annotation-outside"),
        (sweep_of(lambda points: points[:0]), "error", "empty-sweep"),
        (sweep_of(lambda points: points[::50]), "warning", "thin-sweep"),
        (sweep_of(lambda points: points[::2]), "warning", "uneven-sweeps"),
        (sweep_of(lambda points: np.vstack([points, points[::10]])), "warning", "points-twice"),
        (sweep_of(lambda points: np.vstack([points, np.zeros((500, 3), np.float32)])), "warning", "lost-returns"),
        (lambda root: change_mounting(root, translation_m=[3.7, 0, 65.0]), "error", "camera-mounting"),
        (lambda root: change_mounting(root, translation_m=[37, 0, 0.65]), "warning", "sensor-outside"),
        (ego_body_inside_out, "error", "ego-body"),
        (cuboids(stretched_once, only="leader"), "warning", "box-grows"),
        (cuboids(rotated_by_90_degrees, only="leader"), "error", "heading"),
        (annotations(twice), "error", "same-object"),
        (annotations(lambda o: renamed(o, range(8, 16))), "warning", "object-name"),
        (annotations(lambda o: [o["frames"].pop(str(i)) for i in range(2, 14, 3)]), "warning", "label-gaps"),
        (annotations(lambda o: [o["frames"][str(i)]["objects"].pop("walker") for i in range(2, 14, 3)]), "warning",
         "label-gaps"),
        (annotations(lambda o: o["objects"].update(ghost={"name": "ghost", "type": "animal"})), "warning",
         "object-without-frames"),
        (annotations(unknown_category), "error", "file"),
    ],
)  # fmt: skip
def test_a_fault_is_told_and_nothing_else(root, plant, severity, check):
    plant(root)
    told = found(root, returns=check not in OF_IMAGES)
    assert {(finding.check, finding.severity) for finding in told} == {(check, severity)}


def test_names_that_are_exchanged(root):
    annotations(exchanged)(root)
    (finding,) = [finding for finding in found(root) if finding.check == "object-name"]
    assert (finding.field, finding.times) == ("objects 'friend' and 'walker'", 1)


@pytest.mark.parametrize(("mixed", "told"), [(False, set()), (True, {"mixed-times"})])
def test_times_of_points_that_do_not_follow_their_direction(root, mixed, told):
    def turn(sweep):
        points = sweep.points_lidar
        offsets_ns = np.round(np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) * drive.SWEEP_NS).astype(np.int64)
        if mixed:
            np.random.default_rng(0).shuffle(offsets_ns)
        return replace(sweep, time_offset_ns=offsets_ns)

    change_sweeps(root, turn)
    assert {finding.check for finding in found(root)} == told


# What the middle one of nine images of a moving edge is replaced by, or exchanged with: findings, and their images.
ORDERS = {
    "as taken": (lambda images: images, [], []),
    "two swapped": (lambda images: images[[0, 1, 2, 3, 5, 4, 6, 7, 8]], [], [4]),
    "the first two swapped": (lambda images: images[[1, 0, 2, 3, 4, 5, 6, 7, 8]], [], [0]),
    "two swapped that are no neighbours": (lambda images: images[[0, 7, 2, 3, 4, 5, 6, 1, 8]], [1, 7], []),
    "one mirrored": (lambda images: np.concatenate([images[:4], images[4:5, :, ::-1], images[5:]]), [4], []),
    "one of another scene": (lambda images: np.concatenate([images[:4], 255 - images[4:5], images[5:]]), [4], []),
}


@pytest.mark.parametrize("name", ORDERS)
def test_images_that_are_out_of_order(name):
    u = np.arange(96, dtype=np.float64)
    edges = np.array([np.tile(255 / (1 + np.exp((20 + 2 * i - u) / 3)), (64, 1)) for i in range(9)])
    change, foreign, swapped = ORDERS[name]
    order = ImageOrder(drive.IMAGE_NS)
    for row, image in enumerate(change(edges).astype(np.uint8)):
        order.add(row, row * drive.IMAGE_NS, image)
    assert (order.foreign(), order.swapped()) == (foreign, swapped)


def times_of_arrival(root):
    rng = np.random.default_rng(0)
    for path in images(root)[1:]:
        path.rename(path.with_stem(str(int(path.stem) + int(rng.integers(0, 33_000_000)))))


def nodding_lidar(root):
    turned = drive.quaternion_wxyz(tiny.VEHICLE_FROM_LIDAR, Rotation.from_euler("y", 6, degrees=True))
    change_head(root, lambda head: head["lidar"]["vehicle_from_lidar"].update(quaternion_wxyz=turned))


def offset_from_the_middle(head):
    head["cameras"]["front"]["model"].update(principal_point=[-3.0, 2.0])


def quaternion_of_another_order(numbers, _i):
    x, y, z, w = numbers[3:7]
    numbers[3:7] = [w, x, y, z]


def bottom_for_centre(numbers, _i):
    numbers[2] -= numbers[9] / 2


def in_the_ego_vehicle(numbers, _i):
    numbers[:2] = [1.0, 0.0]


def turns_in_degrees(root):
    rate = [{"name": "yaw_rate_radps", "val": 40.0}]
    change_boxes(root, lambda _name, _i, data: data.update(num=rate), only="parked")


@pytest.mark.parametrize(
    ("plant", "severity", "check"),
    [
        (lambda root: change_bus(root, lambda row: row.update(speed_mps="120")), "error", "ego-speed"),
        (times_of_arrival, "warning", "irregular-times"),
        (lambda root: shutil.copy(sweep_files(root)[3], sweep_files(root)[4]), "error", "same-sweep"),
        (nodding_lidar, "warning", "road-tilt"),
        (lambda root: change_head(root, offset_from_the_middle), "error", "principal-point"),
        (velocities(lambda _: [0.0, -20.0, 0.0], only="walker"), "error", "object-speed"),
        (turns_in_degrees, "error", "object-turn"),
        (annotations(lambda o: renamed(o, range(1, 16, 2))), "warning", "object-name"),
        (cuboids(quaternion_of_another_order, only="parked"), "error", "box-tilt"),
        (cuboids(bottom_for_centre), "error", "box-height"),
        (cuboids(in_the_ego_vehicle, only="walker"), "error", "object-in-ego"),
    ],
)
def test_a_fault_is_told_beside_what_follows_from_it(root, plant, severity, check):
    plant(root)
    assert (check, severity) in {(finding.check, finding.severity) for finding in found(root)}


# ---------------------------------------------------------------- ego-motion


@pytest.mark.parametrize("stated_mps", [4.0, 4.0 * 3.6])
def test_between_plain_walls_the_lidar_cannot_tell_the_speed(monkeypatch, tmp_path, stated_mps):
    """Where beams of a vehicle that stands would hit the same places again, though it drives at 4 m/s."""
    walls = [(RigidTransform.from_yaw(0.0, (0.0, y, 1.5)), np.array([400.0, 0.2, 3.0])) for y in (-9.1, 9.1)]
    for name, value in {"SPEED_MPS": 4.0, "TURN_RADPS": 0.0, "OBJECTS": {}, "scenery": lambda: walls}.items():
        monkeypatch.setattr(drive, name, value)
    corridor = drive.write_drive(tmp_path / "drive")
    change_bus(corridor, lambda row: row.update(speed_mps=str(stated_mps)))
    assert "ego-motion-unit" not in {finding.check for finding in found(corridor, static_world=True)}


@pytest.mark.slow
def test_reverse_gear_while_driving_forwards(root):
    change_bus(root, lambda row: row.update(gear="R"))
    (told,) = [finding for finding in found(root, static_world=True) if finding.check == "ego-motion-unit"]
    assert "gear" in told.field


@pytest.mark.slow
def test_degrees_per_second(root):
    change_bus(root, lambda row: row.update(yaw_rate_radps=str(np.degrees(drive.TURN_RADPS))))
    cause, *others = found(root, static_world=True, returns=True)
    assert (cause.check, cause.severity) == ("ego-turn", Severity.ERROR)
    labels = [finding for finding in others if finding.check in BY_EGO_MOTION]
    assert labels
    assert {(finding.severity, finding.hint) for finding in labels} == {
        (Severity.WARNING, "may follow from the ego-motion: correct that, validate again")
    }


def test_ego_motion_that_ends_early(root):
    lines = (root / "egomotion.csv").read_text().splitlines()
    (root / "egomotion.csv").write_text("\n".join(lines[:140]) + "\n")
    told = {(finding.check, finding.field) for finding in found(root, returns=True)}
    assert told == {("ego-motion-missing", "images of front"), ("ego-motion-missing", "lidar sweeps")}


def test_annotations_that_nothing_uses(root):
    change_head(root, lambda head: head.update(annotated="none"))
    (unused,) = [fault for fault in found(root) if fault.check == "annotated"]
    assert (unused.severity, unused.got) == (Severity.WARNING, "4 objects, which nothing uses")


# ---------------------------------------------------------------- clocks


def test_frame_interval_in_microseconds(root):
    change_head(root, lambda head: head.update(frame_interval_ns=66_667))
    (told,) = found(root)
    assert (told.check, told.field) == ("image-times", "frame_interval_ns")


def test_a_sweep_that_is_missing(root):
    """At every second sweep there is an image, too, so that its annotations still have a sensor's time."""
    sweeps = sorted((root / "lidar").iterdir())
    sweeps[4].unlink()
    sweeps[6].unlink()
    gaps, annotated = found(root, returns=True)
    assert (gaps.check, gaps.file, gaps.got) == ("sweep-gaps", str(sweeps[5]), "2 gaps, the longest 200.0 ms")
    assert (annotated.check, annotated.got) == ("annotation-sweep", "2 of 16 annotated times without one")
    assert {gaps.severity, annotated.severity} == {Severity.WARNING}


def test_lidar_on_another_clock(root):
    for path in sorted((root / "lidar").iterdir()):
        path.rename(path.with_stem(str(int(path.stem) + 100 * 10**9)))
    told = {finding.check for finding in found(root, returns=True) if finding.severity is Severity.ERROR}
    assert told == {"sensor-overlap", "ego-motion-missing"}


def test_annotations_between_the_sensors(root):
    def earlier(openlabel):
        openlabel["frames"]["15"]["frame_properties"]["timestamp"] -= 7_000_000

    annotations(earlier)(root)
    (told,) = found(root, returns=True)
    assert (told.check, told.severity, told.times, told.hint) == ("annotation-time", Severity.WARNING, 1, "")


def test_sweeps_on_a_clock_that_is_a_little_late(root):
    """Annotated times are those of the sweeps, so all are as far from the nearest one."""
    for path in sorted((root / "lidar").iterdir(), reverse=True):
        path.rename(path.with_stem(str(int(path.stem) + 7_000_000)))
    told = next(finding for finding in found(root) if finding.check == "annotation-time")
    assert told.hint == (
        "each is 7.0 ms from the nearest sweep: the clock of the sweeps is late by that, or the boxes are early"
    )


# ---------------------------------------------------------------- images


def test_an_image_cut_short(root):
    images(root)[4].write_bytes(images(root)[4].read_bytes()[:500])
    (told,) = found(root)
    assert (told.check, told.file) == ("image", str(images(root)[4]))
    assert told.timestamp_ns == int(images(root)[4].stem)


def test_an_image_of_another_size(root):
    cv2.imwrite(str(images(root)[4]), np.zeros((40, 64), dtype=np.uint8))
    (told,) = found(root)
    assert (told.check, told.field, told.got) == ("image", "image size", "64 x 40")


def test_black_images(root):
    for path in images(root)[3:6]:
        cv2.imwrite(str(path), np.zeros((tiny.HEIGHT, tiny.WIDTH), dtype=np.uint8))
    (told,) = found(root)
    assert (told.check, told.times) == ("black-image", 3)


# ---------------------------------------------------------------- lidar


def test_points_that_are_not_finite(root):
    sweep_of(lambda points: np.full_like(points, np.nan))(root)
    (told,) = found(root)
    assert (told.check, told.field) == ("sweep", "points_lidar")


def test_millimetres(root):
    change_sweeps(root, with_points(lambda points: points * 1000))
    cause, told = found(root, returns=True)
    assert (cause.check, cause.severity) == ("length-unit", Severity.ERROR)
    assert (told.check, told.times) == ("sweep-range", drive.SWEEPS)


def test_point_times_in_microseconds(root):
    def timed(sweep):
        offsets_ns = np.linspace(-50_000, 50_000, len(sweep.points_lidar)).astype(np.int64)
        return LidarSweep(timestamp_ns=sweep.timestamp_ns, points_lidar=sweep.points_lidar, time_offset_ns=offsets_ns)

    change_sweeps(root, timed)
    cause, told = found(root, returns=True)
    assert (cause.check, cause.severity, cause.hint) == ("time-unit", Severity.ERROR, "multiply them by 1000")
    assert (told.check, told.severity) == ("point-times", Severity.WARNING)


def test_a_lidar_mounted_too_low(root):
    change_head(root, lambda head: head["lidar"]["vehicle_from_lidar"].update(translation_m=[1.2, 0.0, 1.3]))
    (told,) = [finding for finding in found(root) if finding.check == "road-height"]
    assert "-0.50 m" in told.got


def test_a_road_that_the_calibration_puts_8_cm_off(root):
    change_head(root, lambda head: head["vehicle"].update(ground_height_m=-0.08))
    (told,) = [finding for finding in found(root) if finding.check == "road-height"]
    assert (told.severity, told.times) == (Severity.WARNING, drive.SWEEPS)
    assert told.expected.startswith("the road at -0.08 m")
    assert float(told.got.split()[0]) == pytest.approx(0.0, abs=0.01)  # where the rays of the drive meet it


@pytest.mark.parametrize("ground_height_m", [-0.03, 0.03])
def test_a_road_3_cm_off_is_within_suspension_travel(root, ground_height_m):
    change_head(root, lambda head: head["vehicle"].update(ground_height_m=ground_height_m))
    assert "road-height" not in {finding.check for finding in found(root)}


def test_neither_pavements_nor_scatter_nor_the_car_ahead_move_the_lane():
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-13, 13, (2, 40_000))
    z = np.where(np.abs(y) > 2.0, 0.10, -0.04) + rng.normal(0, 0.02, x.size)
    car = (x > 7.0) & (np.abs(y) < 0.9)
    z[car] = rng.uniform(0.15, 1.5, car.sum())
    road = seen_road(np.column_stack([x, y, z]))
    assert road.lane_height_m == pytest.approx(-0.04, abs=0.005)
    assert abs(road.height_m + 0.04) > 0.05  # the lowest points of all cells tell less


def test_a_lane_that_is_not_seen_has_no_height():
    x, y = np.random.default_rng(3).uniform(-13, 13, (2, 40_000))
    beside = np.abs(y) > 1.5
    assert np.isnan(seen_road(np.column_stack([x, y, 0.0 * x])[beside]).lane_height_m)


def test_a_lane_that_leads_over_a_kerb_tells_no_height():
    """A plane through the road ahead and the pavement behind a kerb would lie below the road at the vehicle."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(2.6, 13.0, 0.2), np.arange(-6.0, 6.0, 0.2)))
    kerb = np.where(x > 5.0 + y, 0.12, 0.0)
    assert seen_road(np.column_stack([x, y, 0.0 * x])).lane_height_m == pytest.approx(0.0, abs=0.005)
    assert np.isnan(seen_road(np.column_stack([x, y, kerb])).lane_height_m)


# ---------------------------------------------------------------- calibration


def test_a_camera_in_the_ground(root):
    change_mounting(root, translation_m=[3.7, 0, -0.5])
    (told,) = found(root)
    assert told.check == "file"
    assert told.field.startswith("cameras.front.vehicle_from_camera")
    assert "height of -0.50 m" in told.got


def test_a_camera_that_looks_up(root):
    change_mounting(root, quaternion_wxyz=[1.0, 0.0, 0.0, 0.0])
    (told,) = found(root)
    assert told.check == "camera-mounting"
    assert told.got == "one 90 degrees above the horizon"


def test_a_camera_upside_down(root):
    turned = drive.quaternion_wxyz(tiny.FRONT, Rotation.from_euler("z", 180, degrees=True))
    change_mounting(root, quaternion_wxyz=turned)
    (told,) = found(root)
    assert told.got == "one turned by 180 degrees about the optical axis"


def test_no_unit_quaternion(root):
    change_mounting(root, quaternion_wxyz=[2.0, 0.0, 0.0, 0.0])
    (told,) = found(root)
    assert "length 1" in told.expected


def test_a_mask_of_another_size(root):
    (mask,) = (root / "ego_body").iterdir()
    cv2.imwrite(str(mask), np.zeros((10, 10), dtype=np.uint8))
    (told,) = found(root)
    assert (told.check, told.file) == ("file", str(mask))


# ---------------------------------------------------------------- boxes


def test_a_pedestrian_two_metres_wide(root):
    cuboids(lambda numbers, _i: numbers.__setitem__(8, 2.0), only="walker")(root)
    (told,) = found(root, returns=True)
    assert (told.check, told.field, told.times) == ("box-size", "object 'walker' (pedestrian): longer side", 16)


def test_a_box_without_points(root):
    cuboids(lambda numbers, _i: numbers.__setitem__(1, numbers[1] + 5.0), only="leader")(root)
    (told,) = found(root, returns=True)
    assert (told.check, told.severity, told.field) == ("empty-box", Severity.ERROR, "object 'leader' (vehicle)")


def test_a_box_whose_points_lie_on_and_outside_of_its_faces(root):
    def shrink(numbers, _i):
        numbers[7:10] = [size - 0.16 for size in numbers[7:10]]

    cuboids(shrink, only="leader")(root)
    (told,) = found(root, returns=True)
    assert (told.check, told.severity, told.field) == ("tight-box", Severity.WARNING, "object 'leader' (vehicle)")
    assert told.got == f"0 points in {told.times} of 16 sweeps that see it, and more within 10 cm outside"


@pytest.mark.parametrize(("tighter_m", "margin_cm"), [(2 * drive.MARGIN_M, 2), (0.0, None)])
def test_boxes_that_are_all_tight_by_centimetres(root, tighter_m: float, margin_cm: int | None):
    def shrink(numbers, _i):
        numbers[7:10] = [size - tighter_m for size in numbers[7:10]]

    cuboids(shrink)(root)
    told = [finding.got for finding in found(root, returns=True) if finding.check == "tight-boxes"]
    assert [f"with {margin_cm} cm more on each side" in got for got in told] == [True] * bool(margin_cm), told


def test_a_lidar_that_is_mirrored_left_to_right(root):
    change_sweeps(root, with_points(lambda points: points * np.float32([1, -1, 1])))
    recording = open_native(root)
    looked = box_fit.BoxFit(recording)
    for sweep in recording.sweeps:
        looked.add(sweep.read())
    (told,) = looked.findings()
    assert (told.check, told.hint.split(":")[0]) == ("box-reading", "the lidar's y has the wrong sign")


def test_an_object_that_jumps(root):
    def jump(numbers, i):
        numbers[0] += 4.0 if i >= 8 else 0.0

    cuboids(jump, only="parked")(root)
    told = found(root, returns=True)
    assert ("object-jump", Severity.ERROR) in {(finding.check, finding.severity) for finding in told}
    assert {finding.check for finding in told} <= {"object-jump", "empty-box", "velocity"}


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda v: [3.6 * x for x in v], "km/h instead of m/s"),
        (lambda v: [v[0] - drive.SPEED_MPS, v[1], v[2]], "relative to the vehicle instead of over the ground"),
        (lambda v: [-x for x in v], "the sign is reversed"),
    ],
)
def test_velocities_of_another_kind(root, change, cause):
    velocities(change, only="leader")(root)
    velocity = [finding for finding in found(root) if finding.check == "velocity"]
    assert [finding.hint for finding in velocity] == [cause]


def test_many_boxes_at_one_place_are_told_in_bounded_work(monkeypatch, tiny_recording):
    """All of 60 overlap with each other: 1770 pairs at each of three times, of which 2000 in all are looked at."""
    monkeypatch.setattr(boxes, "MOST_PAIRS", 2000)
    monkeypatch.setattr(box_fit, "MOST_BOXES", 25)
    write_heap(tiny_recording, objects=60)
    told = found(tiny_recording, depth=Depth.DEEP, returns=True)
    same = [finding for finding in told if finding.check == "same-object"]
    assert len(same) == boxes.MOST_PAIRS_LISTED + 1
    assert (
        same[-1].got
        == f"boxes that overlap by more than half in {1770 - boxes.MOST_PAIRS_LISTED} more pairs of objects"
    )
    assert {finding.times for finding in same[:-1]} == {2}  # of 230 pairs that were looked at twice
    crowded = [finding for finding in told if finding.check == "crowded-boxes"]
    assert [finding.severity for finding in crowded] == [Severity.WARNING] * 2
    assert crowded[0].got == "more; at 2 of 3 times not all were compared"
    assert crowded[1].got == "more; in 70 boxes no points were looked for"


def test_boxes_that_were_looked_at_least_come_first(monkeypatch, tiny_recording):
    monkeypatch.setattr(box_fit, "MOST_BOXES", 30)
    write_heap(tiny_recording, objects=60)
    (handle,) = native_recordings(tiny_recording, options={}, card=tiny_recording / "card.yaml", annotations=None)
    recording = handle.open()
    looked = box_fit.BoxFit(recording)
    for sweep in recording.sweeps:
        looked.add(sweep.read())
    assert {tally.tried for tally in looked._tallies.values()} == {1}


def test_boxes_that_touch_are_not_one_object(tiny_recording):
    write_heap(tiny_recording, objects=4, apart_m=1.5)
    checks = {finding.check for finding in found(tiny_recording, returns=True)}
    assert not {"same-object", "crowded-boxes"} & checks


def write_heap(root, *, objects, apart_m=0.0):
    """Cars of 5.2 x 2 m beside each other, or all at one place."""
    writer = RecordingWriter(root)
    size_m = np.array([5.2, 2.0, 2.1])
    writer.annotations(
        [
            Track(
                track_id=f"car {i}",
                object_class="vehicle",
                states=tuple(
                    ObjectState(
                        timestamp_ns=time_ns,
                        shape=Cuboid(
                            vehicle_from_object=RigidTransform.from_yaw(0.0, (9.0, 4.0 + apart_m * i, 1.05)),
                            size_m=size_m,
                        ),
                        velocity_mps=np.zeros(3),
                    )
                    for time_ns in tiny.TIMES_NS
                ),
            )
            for i in range(objects)
        ]
    )


@pytest.fixture
def tiny_recording(tmp_path):
    return tiny.write_recording(tmp_path / "tiny")


def test_an_unknown_category_from_an_adapter_that_does_not_look(root):
    (handle,) = native_recordings(root, options={}, card=root, annotations=None)
    recording = handle.open()
    track = recording.tracks[0]
    states = (replace(track.states[0], category="sideways"), *track.states[1:])
    odd = replace(recording, tracks=(replace(track, states=states), *recording.tracks[1:]))
    assert [finding.got for finding in check_boxes(odd) if finding.check == "category"] == ["sideways"]


def test_point_indices_beyond_the_sweep(root):
    def listed(name, i, data):
        data.pop("cuboid")
        time_ns = drive.START_NS + i * drive.SWEEP_NS
        data["vec"].append({"name": "point_indices", "val": [1, 2, 10**6 if i == 3 else 5]})
        data["num"] = [{"name": "sweep_timestamp_ns", "val": time_ns + (1 if i == 4 else 0)}]

    change_boxes(root, listed, only="walker")
    told = found(root, returns=True)
    assert [finding.check for finding in told] == ["point-indices", "point-indices"]


# ---------------------------------------------------------------- files that do not open


def test_every_fault_of_the_bus_signals_is_told(root):
    rows = (root / "egomotion.csv").read_text().splitlines()
    rows[5], rows[9] = rows[5].replace("8.0", "fast"), rows[9].replace("0.2", "nan")
    (root / "egomotion.csv").write_text("\n".join(rows) + "\n")
    told = [f"{finding.file}: {finding.field}" for finding in found(root, static_world=True, returns=True)]
    for part in ("speed_mps, row 5", "yaw_rate_radps, row 9"):
        assert any(part in line for line in told), part


def test_images_and_sweeps_are_read_file_by_file(root):
    image, sweep = images(root)[2], sweep_files(root)[3]
    image.write_bytes(b"\x89PNG\r\n\x1a\n")
    change_sweep(sweep, with_points(lambda points: points[:0]))
    sweep_files(root)[5].write_bytes(b"PK")
    told = {finding.file for finding in found(root)}
    assert {str(image), str(sweep), str(sweep_files(root)[5])} <= told


def test_every_fault_of_a_head_is_told(root):
    def wrong(head):
        head["frame_interval_ns"] = -1
        head["licence"] = 5
        head["colour"] = "red"

    change_head(root, wrong)
    assert {finding.field for finding in found(root)} == {"frame_interval_ns", "licence", "colour"}


def test_a_name_that_stands_twice_in_the_annotations(root):
    """A parser keeps the last of two equal keys and says nothing."""
    file = root / "annotations.json"
    twice = '"objects": {"walker": {"name": "other", "type": "animal"}, "walker": '
    text = json.dumps(json.loads(file.read_text()))
    assert '"objects": {"walker": ' in text
    file.write_text(text.replace('"objects": {"walker": ', twice, 1))
    (told,) = found(root)
    assert (told.check, told.field) == ("key-twice", "'walker'")


# ---------------------------------------------------------------- what is there and not read


def test_files_among_the_sweeps_that_nobody_reads(root):
    for path in sweep_files(root)[:5]:
        path.rename(path.with_name(f"{path.stem}.PCD.gz"))
    (told,) = [finding for finding in found(root) if finding.check == "not-read"]
    assert (told.field, told.times, told.severity) == ("lidar/*.PCD.gz", 5, Severity.WARNING)
    assert "5 that are passed over: no .npz or .bin" in told.got


def test_points_without_times(root):
    def without(sweep):
        return LidarSweep(timestamp_ns=sweep.timestamp_ns, points_lidar=sweep.points_lidar)

    change_sweeps(root, without)
    (told,) = found(root)
    assert (told.check, told.severity, told.times) == ("point-times-missing", Severity.WARNING, drive.SWEEPS)


def test_fields_of_points_that_nobody_reads_are_listed(root):
    columns = [*((axis, 4, "F", 1) for axis in "xyz"), ("azimuth", 4, "F", 1)]
    for path in sweep_files(root):
        points = read_sweep(path, 0).points_lidar
        body = np.column_stack([points, points[:, 0]]).astype("<f4").tobytes()
        path.with_suffix(".pcd").write_bytes(pcd_of(columns, len(points), body))
        path.unlink()
    (told,) = found(root)
    assert told.hint.endswith("fields that are not read: azimuth")


@pytest.mark.parametrize("bits", [10, 12])
def test_bits_that_are_read_as_sixteen(root, bits):
    for number, path in enumerate(images(root)):
        values = np.random.default_rng(number).integers(0, 2**bits, (drive.HEIGHT, drive.WIDTH), dtype=np.uint16)
        cv2.imwrite(str(path), values)
    told = [finding for finding in found(root) if finding.check == "grey-levels"]
    assert [finding.severity for finding in told] == ([Severity.WARNING] if bits == 12 else [])
    change_head(root, lambda head: head["cameras"]["front"].update(white_level=2**bits - 1))
    assert found(root) == []
