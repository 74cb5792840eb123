"""Each fault is really put into a copy of a clean recording, and it alone is told."""

import json
import re
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
from bench.recordings.native import open_native
from bench.validation import Depth, Severity, findings
from bench.validation.fits import box_fit
from bench.validation.quick import boxes
from bench.validation.quick.boxes import check_boxes
from bench.validation.quick.sensors import ImageOrder, seen_road
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


def sweep_of(change, number=3):
    return lambda root: change_sweep(sweep_files(root)[number], with_points(change))


def cuboids(change, only=None):
    """Change the ten numbers of boxes: centre, quaternion x, y, z, w, size; `change(numbers, number of the time)`."""
    return lambda root: change_boxes(root, lambda _name, i, data: change(data["cuboid"][0]["val"], i), only=only)


def shrunk(by_m, only=None):
    def shrink(numbers, _i):
        numbers[7:10] = [size - by_m for size in numbers[7:10]]

    return cuboids(shrink, only=only)


def velocities(change, only):
    def velocity(_name, _i, data):
        (entry,) = [entry for entry in data["vec"] if entry["name"] == "velocity_mps"]
        entry["val"] = change(entry["val"])

    return lambda root: change_boxes(root, velocity, only=only)


def annotations(change):
    return lambda root: change_json(root / "annotations.json", lambda content: change(content["openlabel"]))


def mounting(**values):
    return lambda root: change_mounting(root, **values)


def head(change):
    return lambda root: change_head(root, change)


def together(*plants):
    def plant(root):
        for each in plants:
            each(root)

    return plant


def text_of(finding):
    return f"{finding.file} {finding.field} {finding.expected} {finding.got} {finding.hint} {finding.times} times"


@pytest.mark.parametrize("depth", [Depth.SAMPLED, pytest.param(Depth.DEEP, marks=pytest.mark.slow)])
def test_a_clean_recording_has_no_findings(root, depth):
    assert found(root, depth, static_world=True, returns=True) == []


def test_every_text_belongs_to_a_check(pytestconfig):
    """Kinds of findings in the code, and those in the table, which also names what may follow from what."""
    package = pytestconfig.rootpath / "bench" / "validation"
    code = "\n".join(path.read_text() for path in package.rglob("*.py"))
    kinds = findings._texts()[0]
    assert [kind for kind in kinds if f'"{kind}"' not in code] == []
    checks = {kind.partition(":")[0] for kind in kinds}
    named = {check for cause in findings.causes() for check in (*cause.known_by, *cause.following)}
    assert named <= checks


# ---------------------------------------------------------------- faults that alone are told


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


def smaller_image(root):
    cv2.imwrite(str(images(root)[4]), np.zeros((40, 64), dtype=np.uint8))


def short_image(root):
    images(root)[4].write_bytes(images(root)[4].read_bytes()[:500])


def black_images(root):
    for path in images(root)[3:6]:
        cv2.imwrite(str(path), np.zeros((tiny.HEIGHT, tiny.WIDTH), dtype=np.uint8))


def smaller_mask(root):
    (mask,) = (root / "ego_body").iterdir()
    cv2.imwrite(str(mask), np.zeros((10, 10), dtype=np.uint8))


def key_twice(root):
    """A parser keeps the last of two equal keys and says nothing."""
    file = root / "annotations.json"
    twice = '"objects": {"walker": {"name": "other", "type": "animal"}, "walker": '
    text = json.dumps(json.loads(file.read_text()))
    assert '"objects": {"walker": ' in text
    file.write_text(text.replace('"objects": {"walker": ', twice, 1))


def without_times(sweep):
    return LidarSweep(timestamp_ns=sweep.timestamp_ns, points_lidar=sweep.points_lidar)


def unread_field(root):
    columns = [*((axis, 4, "F", 1) for axis in "xyz"), ("azimuth", 4, "F", 1)]
    for path in sweep_files(root):
        points = read_sweep(path, 0).points_lidar
        body = np.column_stack([points, points[:, 0]]).astype("<f4").tobytes()
        path.with_suffix(".pcd").write_bytes(pcd_of(columns, len(points), body))
        path.unlink()


def without_sweeps(root):
    """At every second sweep there is an image, too, so that its annotations still have a sensor's time."""
    for path in (sweep_files(root)[4], sweep_files(root)[6]):
        path.unlink()


def lidar_of_another_day(root):
    for path in sweep_files(root):
        path.rename(path.with_stem(str(int(path.stem) + 100 * 10**9)))


def in_microseconds(sweep):
    offsets_ns = np.linspace(-50_000, 50_000, len(sweep.points_lidar)).astype(np.int64)
    return replace(sweep, time_offset_ns=offsets_ns)


def earlier_once(openlabel):
    openlabel["frames"]["15"]["frame_properties"]["timestamp"] -= 7_000_000


def short_egomotion(root):
    lines = (root / "egomotion.csv").read_text().splitlines()
    (root / "egomotion.csv").write_text("\n".join(lines[:140]) + "\n")


def without_labels(openlabel):
    for number in range(2, 14, 3):
        openlabel["frames"].pop(str(number))


def walker_flickers(openlabel):
    for number in range(2, 14, 3):
        openlabel["frames"][str(number)]["objects"].pop("walker")


ERROR, WARNING = "error", "warning"
UPSIDE_DOWN = drive.quaternion_wxyz(tiny.FRONT, Rotation.from_euler("z", 180, degrees=True))


@pytest.mark.parametrize(
    ("plant", "told", "text"),
    [
        (gap_between_images, {("image-gaps", WARNING)}, "images of front"),
        (slow_clock, {("clock-drift", WARNING)}, "images of front and lidar sweeps"),
        (lambda root: shutil.copy(images(root)[4], images(root)[5]), {("same-image", ERROR)}, "while driving"),
        (lambda root: shutil.copy(images(root)[4], images(root)[15]), {("same-image", ERROR)}, "while driving"),
        (short_image, {("image", ERROR)}, rf"{drive.START_NS + 4 * drive.IMAGE_NS}\.png"),
        (smaller_image, {("image", ERROR)}, "image size .*64 x 40"),
        (black_images, {("black-image", WARNING)}, "3 times"),
        (head(lambda head: head.update(frame_interval_ns=66_667)), {("image-times", ERROR)}, "frame_interval_ns"),
        (mounting(translation_m=[3.7, 0, 65.0]), {("camera-mounting", ERROR)}, "0.1 to 4.5 m above the road 65.00 m"),
        (mounting(translation_m=[37, 0, 0.65]), {("sensor-outside", WARNING)}, "33.2 m outside"),
        (mounting(translation_m=[3.7, 0, -0.5]), {("file", ERROR)}, "vehicle_from_camera.* height of -0.50 m"),
        (mounting(quaternion_wxyz=[1, 0, 0, 0]), {("camera-mounting", ERROR)}, "one 90 degrees above the horizon"),
        (mounting(quaternion_wxyz=UPSIDE_DOWN), {("camera-mounting", ERROR)}, "turned by 180 degrees about"),
        (mounting(quaternion_wxyz=[2, 0, 0, 0]), {("file", ERROR)}, "length 1"),
        (ego_body_inside_out, {("ego-body", ERROR)}, "inverted"),
        (smaller_mask, {("file", ERROR)}, "ego_body/front.png"),
        (sweep_of(lambda points: np.full_like(points, np.nan)), {("sweep", ERROR)}, "points_lidar"),
        (lambda root: change_sweeps(root, without_times), {("point-times-missing", WARNING)}, "16 times"),
        (unread_field, {("point-times-missing", WARNING)}, "fields that are not read: azimuth"),
        (lambda root: change_sweeps(root, in_microseconds), {("time-unit", ERROR), ("point-times", WARNING)},
         "multiply them by 1000"),
        (lambda root: change_sweeps(root, with_points(lambda points: points * 1000)),
         {("length-unit", ERROR), ("sweep-range", WARNING)}, "16 times"),
        (without_sweeps, {("sweep-gaps", WARNING), ("annotation-sweep", WARNING)}, "2 gaps, the longest 200.0 ms"),
        (without_sweeps, {("sweep-gaps", WARNING), ("annotation-sweep", WARNING)}, "2 of 16 annotated times without"),
        (short_egomotion, {("ego-motion-missing", ERROR)}, "images of front"),
        (short_egomotion, {("ego-motion-missing", ERROR)}, "lidar sweeps"),
        (annotations(annotated_later), {("annotation-outside", ERROR)}, "timestamp"),
        (annotations(earlier_once), {("annotation-time", WARNING)}, "1 of 16 annotated times at neither  1 times"),
        (annotations(unknown_category), {("file", ERROR)}, "sideways"),
        (key_twice, {("key-twice", ERROR)}, "'walker'"),
        (head(lambda head: head.update(annotated="none")), {("annotated", WARNING)}, "4 objects, which nothing uses"),
    ],
)  # fmt: skip
def test_a_fault_is_told_and_nothing_else(root, plant, told, text):
    plant(root)
    looked = found(root)
    assert {(finding.check, finding.severity.value) for finding in looked} == told
    assert any(re.search(text, text_of(finding)) for finding in looked), looked


@pytest.mark.parametrize(
    ("plant", "told", "text"),
    [
        (
            together(
                sweep_of(lambda points: points[:0], 1),
                sweep_of(lambda points: points[::50], 3),
                sweep_of(lambda points: points[::2], 6),
                sweep_of(lambda points: np.vstack([points, points[::10]]), 9),
                sweep_of(lambda points: np.vstack([points, np.zeros((500, 3), np.float32)]), 12),
            ),
            {("empty-sweep", ERROR)}
            | {(check, WARNING) for check in ("thin-sweep", "uneven-sweeps", "points-twice", "lost-returns")},
            "2 times",  # uneven: with the one before and the one after
        ),
        (
            together(
                cuboids(stretched_once, only="leader"),
                annotations(lambda o: o["objects"].update(ghost={"name": "ghost", "type": "animal"})),
                annotations(walker_flickers),
            ),
            {(check, WARNING) for check in ("box-grows", "object-without-frames", "label-gaps")},
            "'walker'.* none for one or two times, 4 times",
        ),
        (
            together(
                cuboids(rotated_by_90_degrees, only="leader"),
                cuboids(lambda numbers, _i: numbers.__setitem__(8, 2.0), only="walker"),
            ),
            {("heading", ERROR), ("box-size", ERROR)},
            r"object 'walker' \(pedestrian\): longer side .* 16 times",
        ),
        (
            together(annotations(twice), annotations(without_labels)),
            {("same-object", ERROR), ("label-gaps", WARNING)},
            "objects 'leader' and 'copy'",
        ),
        (annotations(lambda o: renamed(o, range(8, 16))), {("object-name", WARNING)}, "goes on at 1 times"),
        (cuboids(lambda numbers, _i: numbers.__setitem__(1, numbers[1] + 5.0), only="leader"),
         {("empty-box", ERROR)}, r"object 'leader' \(vehicle\)"),
        (shrunk(0.16, only="leader"), {("tight-box", WARNING)}, r"leader.* 0 points in (\d+) of 16 sweeps .* \1 times"),
        (shrunk(2 * drive.MARGIN_M), {("tight-boxes", WARNING)}, "with 2 cm more on each side"),
    ],
)  # fmt: skip
def test_a_fault_that_returns_could_see_is_told_and_nothing_else(root, plant, told, text):
    plant(root)
    looked = found(root, returns=True)
    assert {(finding.check, finding.severity.value) for finding in looked} == told
    assert any(re.search(text, text_of(finding)) for finding in looked)


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


def jump(numbers, i):
    numbers[0] += 4.0 if i >= 8 else 0.0


def packed_sweeps(root):
    for path in sweep_files(root)[:5]:
        path.rename(path.with_name(f"{path.stem}.PCD.gz"))


def lidar_at(height_m):
    return head(lambda head: head["lidar"]["vehicle_from_lidar"].update(translation_m=[1.2, 0.0, height_m]))


def bus(**columns):
    return lambda root: change_bus(root, lambda row: row.update(columns))


@pytest.mark.parametrize(
    ("plant", "severity", "check", "text"),
    [
        (bus(speed_mps="120"), ERROR, "ego-speed", "at most 75 m/s up to 120 m/s"),
        (times_of_arrival, WARNING, "irregular-times", "images of front"),
        (lambda root: shutil.copy(sweep_files(root)[3], sweep_files(root)[4]), ERROR, "same-sweep", ""),
        (packed_sweeps, WARNING, "not-read", r"lidar/\*.PCD.gz .*5 that are passed over: no .npz or .bin.* 5 times"),
        (lidar_of_another_day, ERROR, "sensor-overlap", "same epoch"),
        (lidar_of_another_day, ERROR, "ego-motion-missing", "lidar sweeps"),
        (lidar_at(1.3), ERROR, "road-height", "-0.50 m"),
        (nodding_lidar, WARNING, "road-tilt", ""),
        (head(offset_from_the_middle), ERROR, "principal-point", r"\(-3.0, 2.0\)"),
        (velocities(lambda _: [0.0, -20.0, 0.0], only="walker"), ERROR, "object-speed", "20.0 m/s as stated"),
        (turns_in_degrees, ERROR, "object-turn", "'parked'"),
        (annotations(lambda o: renamed(o, range(1, 16, 2))), WARNING, "object-name", "'leader' and 'other'"),
        (annotations(exchanged), WARNING, "object-name", "'friend' and 'walker' .* 1 times"),
        (cuboids(quaternion_of_another_order, only="parked"), ERROR, "box-tilt", ""),
        (cuboids(bottom_for_centre), ERROR, "box-height", "below it, median of 4 objects"),
        (cuboids(in_the_ego_vehicle, only="walker"), ERROR, "object-in-ego", ""),
        (cuboids(jump, only="parked"), ERROR, "object-jump", "'parked'"),
        (velocities(lambda v: [3.6 * x for x in v], only="leader"), ERROR, "velocity", "km/h instead of m/s"),
        (velocities(lambda v: [v[0] - drive.SPEED_MPS, *v[1:]], only="leader"), ERROR, "velocity",
         "relative to the vehicle instead of over the ground"),
        (velocities(lambda v: [-x for x in v], only="leader"), ERROR, "velocity", "the sign is reversed"),
    ],
)  # fmt: skip
def test_a_fault_is_told_beside_what_follows_from_it(root, plant, severity, check, text):
    plant(root)
    told = [text_of(finding) for finding in found(root) if (finding.check, finding.severity) == (check, severity)]
    assert any(re.search(text, line) for line in told), told


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
    (following,) = (cause.following for cause in findings.causes() if cause.name == "the ego-motion")
    labels = [finding for finding in others if finding.check in following]
    assert labels
    assert {(finding.severity, finding.hint) for finding in labels} == {
        (Severity.WARNING, "may follow from the ego-motion: correct that, validate again")
    }


def test_sweeps_on_a_clock_that_is_a_little_late(root):
    """Annotated times are those of the sweeps, so all are as far from the nearest one."""
    for path in sorted((root / "lidar").iterdir(), reverse=True):
        path.rename(path.with_stem(str(int(path.stem) + 7_000_000)))
    told = next(finding for finding in found(root) if finding.check == "annotation-time")
    assert told.hint == (
        "each is 7.0 ms from the nearest sweep: the clock of the sweeps is late by that, or the boxes are early"
    )


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


# ---------------------------------------------------------------- boxes


def test_a_lidar_that_is_mirrored_left_to_right(root):
    change_sweeps(root, with_points(lambda points: points * np.float32([1, -1, 1])))
    (told,) = drive.box_fit_of(root).findings()
    assert (told.check, told.hint.split(":")[0]) == ("box-reading", "the lidar's y has the wrong sign")


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
    assert crowded[0].got == "more; later ones were not compared"
    assert crowded[0].timestamp_ns == tiny.TIMES_NS[1]
    assert crowded[1].got == "more; in 70 boxes no points were looked for"


def test_boxes_that_were_looked_at_least_come_first(monkeypatch, tiny_recording):
    monkeypatch.setattr(box_fit, "MOST_BOXES", 30)
    write_heap(tiny_recording, objects=60)
    assert {tally.tried for tally in drive.box_fit_of(tiny_recording)._tallies} == {1}


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
    recording = open_native(root)
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


@pytest.mark.parametrize("bits", [10, 12])
def test_bits_that_are_read_as_sixteen(root, bits):
    for number, path in enumerate(images(root)):
        values = np.random.default_rng(number).integers(0, 2**bits, (drive.HEIGHT, drive.WIDTH), dtype=np.uint16)
        cv2.imwrite(str(path), values)
    told = [finding for finding in found(root) if finding.check == "grey-levels"]
    assert [finding.severity for finding in told] == ([Severity.WARNING] if bits == 12 else [])
    change_head(root, lambda head: head["cameras"]["front"].update(white_level=2**bits - 1))
    assert found(root) == []
