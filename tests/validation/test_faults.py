"""Each fault is really put into a copy of a clean recording, and it alone is told."""

import re
import shutil
from copy import deepcopy
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.geometry import RigidTransform
from bench.lidar.files import read_sweep
from bench.lidar.sweep import LidarSweep
from bench.recordings import Cuboid, ObjectState, RecordingWriter, Track, load_card, open_dataset
from bench.validation import findings
from bench.validation.findings import Severity
from bench.validation.quick import boxes
from bench.validation.quick.sensors import ImageOrder, seen_road
from bench.validation.report import validate_dataset
from tests.support import drive, tiny
from tests.support.cards import write_card
from tests.support.clouds import pcd_of
from tests.support.drive import with_points
from tests.support.planting import (
    change_boxes,
    change_bus,
    change_head,
    change_json,
    change_mounting,
    change_sweep,
    change_sweeps,
    retime,
    sweep_files,
)
from tests.validation.checking import found


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


def road_at(height_m):
    """Height of the road as the calibration has it; the rays of the drive meet it at 0."""
    return head(lambda head: head["vehicle"].update(ground_height_m=height_m))


def together(*plants):
    def plant(root):
        for each in plants:
            each(root)

    return plant


def text_of(finding):
    return f"{finding.file} {finding.field} {finding.expected} {finding.got} {finding.hint} {finding.times} times"


def plant_and_compare(root, plant, told, text, *, returns=False):
    plant(root)
    looked = found(root, returns=returns)
    assert {(finding.check, finding.severity.value) for finding in looked} == told
    for part in text.split(" & ") if text else ():
        assert any(re.search(part, text_of(finding)) for finding in looked), looked


@pytest.mark.parametrize("deep", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_clean_recording_has_no_findings(root, deep):
    assert found(root, deep=deep, static_world=True, returns=True) == []


def test_every_text_belongs_to_a_check(pytestconfig):
    """Kinds of findings in the code, and those in the table, which also names what may follow from what."""
    package = pytestconfig.rootpath / "bench" / "validation"
    code = "\n".join(path.read_text() for path in package.rglob("*.py"))
    kinds = findings._texts()[0]
    composed = {kind for kind in kinds if kind.startswith("camera-calibration: ")}
    assert [kind for kind in kinds.keys() - composed if f'"{kind}"' not in code] == []
    checks = {kind.partition(":")[0] for kind in kinds}
    named = {check for cause in findings.causes() for check in (*cause.known_by, *cause.following)}
    assert named <= checks


def retimed(folder, later):
    """Files under later times: `later(time)` is added to each, ns."""
    return lambda root: retime(root / folder, lambda time_ns: time_ns + later(time_ns))


def painted(numbers, pixels):
    """Images, or the mask of the ego vehicle's body where no numbers are given, with other pixels."""

    def plant(root):
        files = [images(root)[i] for i in numbers] or [*(root / "ego_body").iterdir()]
        for path in files:
            change = pixels(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) if callable(pixels) else pixels
            cv2.imwrite(str(path), change)

    return plant


def without(numbers, of=images):
    return lambda root: [path.unlink() for i, path in enumerate(of(root)) if i in numbers]


def copied(first, second, of=images):
    return lambda root: shutil.copy(of(root)[first], of(root)[second])


def frames(change):
    """Change the frames of the annotations, `change(number, frame)`."""
    return annotations(lambda openlabel: [change(int(i), frame) for i, frame in openlabel["frames"].items()])


def stretched_once(numbers, i):
    numbers[7] *= 2.0 if i == 5 else 1.0


def rotated_by_90_degrees(numbers, _i):
    """Length and width swapped with the heading."""
    rotation = Rotation.from_quat(numbers[3:7]) * Rotation.from_euler("z", 90, degrees=True)
    numbers[3:7], numbers[7], numbers[8] = rotation.as_quat().tolist(), numbers[8], numbers[7]


def named(name, like):
    """A further object of the class of another."""
    return annotations(
        lambda openlabel: openlabel["objects"].update({name: openlabel["objects"][like] | {"name": name}})
    )


def renamed(numbers):
    """The leader's labels under another name in some frames."""

    def rename(i, frame):
        if i in numbers:
            frame["objects"]["other"] = frame["objects"].pop("leader")

    return together(named("other", "leader"), frames(rename))


def exchanged(i, frame):
    """Two walkers, a metre apart, whose names are exchanged in the second half."""
    friend = deepcopy(frame["objects"]["walker"])
    friend["object_data"]["cuboid"][0]["val"][0] += 1.0
    first, last = ("walker", "friend") if i < 8 else ("friend", "walker")
    frame["objects"] |= {first: frame["objects"]["walker"], last: friend}


def unknown_category(i, frame):
    if i == 3:
        frame["objects"]["walker"]["object_data"]["text"] = [{"name": "category", "val": "sideways"}]


def later_by(offset_ns, only=None):
    def later(i, frame):
        frame["frame_properties"]["timestamp"] += offset_ns if only in (None, i) else 0

    return frames(later)


def walker_flickers(i, frame):
    if i in GAPS:
        frame["objects"].pop("walker")


def without_times(sweep):
    return LidarSweep(timestamp_ns=sweep.timestamp_ns, points_lidar=sweep.points_lidar)


def in_another_unit(sweep, *, factor):
    half = 50_000_000 // factor
    return replace(sweep, time_offset_ns=np.linspace(-half, half, len(sweep.points_lidar)).astype(np.int64))


def turning(sweep, *, mixed=False):
    """Times of points as a lidar that turns has them."""
    points = sweep.points_lidar
    offsets_ns = np.round(np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) * drive.SWEEP_NS).astype(np.int64)
    if mixed:
        np.random.default_rng(0).shuffle(offsets_ns)
    return replace(sweep, time_offset_ns=offsets_ns)


def sweeps(change):
    return lambda root: change_sweeps(root, change)


def indices_that_no_sweep_has(_name, i, data):
    data.pop("cuboid")
    time_ns = drive.START_NS + i * drive.SWEEP_NS
    data["vec"].append({"name": "point_indices", "val": [1, 2, 10**6 if i == 3 else 5]})
    data["num"] = [{"name": "sweep_timestamp_ns", "val": time_ns + (1 if i == 4 else 0)}]


def unread_field(root):
    columns = [*((axis, 4, "F", 1) for axis in "xyz"), ("azimuth", 4, "F", 1)]
    for path in sweep_files(root):
        points = read_sweep(path, 0).points_lidar
        body = np.column_stack([points, points[:, 0]]).astype("<f4").tobytes()
        path.with_suffix(".pcd").write_bytes(pcd_of(columns, len(points), body))
        path.unlink()


def broken_bus(root):
    rows = (root / "egomotion.csv").read_text().splitlines()
    rows[5], rows[9] = rows[5].replace("8.0", "fast"), rows[9].replace("0.2", "nan")
    (root / "egomotion.csv").write_text("\n".join(rows) + "\n")


def short_egomotion(root):
    lines = (root / "egomotion.csv").read_text().splitlines()
    (root / "egomotion.csv").write_text("\n".join(lines[:140]) + "\n")


GAPS = range(2, 14, 3)
ERROR, WARNING = "error", "warning"
UPSIDE_DOWN = drive.quaternion_wxyz(tiny.FRONT, Rotation.from_euler("z", 180, degrees=True))


@pytest.mark.parametrize(
    ("plant", "told", "text"),
    [
        (without(range(10, 13)), {("image-gaps", WARNING)}, "images of front"),
        (retimed("images/front", lambda t: round((t - drive.START_NS) * 4e-3)), {("clock-drift", WARNING)},
         "images of front and lidar sweeps"),
        (copied(4, 5), {("same-image", ERROR)}, "while driving"),
        (copied(4, 15), {("same-image", ERROR)}, "while driving"),
        (lambda root: images(root)[4].write_bytes(images(root)[4].read_bytes()[:500]), {("image", ERROR)},
         rf"{drive.START_NS + 4 * drive.IMAGE_NS}\.png"),
        (painted([4], np.zeros((40, 64), np.uint8)), {("image", ERROR)}, "image size .*64 x 40"),
        (painted([3, 4, 5], np.zeros((tiny.HEIGHT, tiny.WIDTH), np.uint8)), {("black-image", WARNING)}, "3 times"),
        (head(lambda head: head.update(frame_interval_ns=66_667)), {("image-times", ERROR)}, "frame_interval_ns"),
        (mounting(translation_m=[3.7, 0, 65.0]), {("camera-mounting", ERROR)}, "0.1 to 4.5 m above the road 65.00 m"),
        (mounting(translation_m=[37, 0, 0.65]), {("sensor-outside", WARNING)}, "33.2 m outside"),
        (mounting(translation_m=[3.7, 0, -0.5]), {("file", ERROR)}, "vehicle_from_camera.* height of -0.50 m"),
        (mounting(quaternion_wxyz=[1, 0, 0, 0]), {("camera-mounting", ERROR)}, "one 90 degrees above the horizon"),
        (mounting(quaternion_wxyz=UPSIDE_DOWN), {("camera-mounting", ERROR)}, "turned by 180 degrees about"),
        (mounting(quaternion_wxyz=[2, 0, 0, 0]), {("file", ERROR)}, "length 1"),
        (painted([], lambda mask: 255 - mask), {("ego-body", ERROR)}, "inverted"),
        (painted([], np.zeros((10, 10), np.uint8)), {("file", ERROR)}, "ego_body/front.png"),
        (sweep_of(lambda points: np.full_like(points, np.nan)), {("sweep", ERROR)}, "points_lidar"),
        (sweeps(without_times), {("point-times-missing", WARNING)}, "16 times"),
        (sweeps(turning), set(), ""),
        (sweeps(partial(turning, mixed=True)), {("mixed-times", WARNING)}, "16 times"),
        (broken_bus, {("file", ERROR)}, "speed_mps, row 5 & yaw_rate_radps, row 9"),
        (unread_field, {("point-times-missing", WARNING)}, "fields that are not read: azimuth"),
        (sweeps(partial(in_another_unit, factor=10**3)), {("time-unit", ERROR), ("point-times", WARNING)},
         "times of the points .* microseconds.* multiply them by 1000 "),
        (sweeps(partial(in_another_unit, factor=10**6)), {("time-unit", ERROR), ("point-times", WARNING)},
         "times of the points .* milliseconds.* multiply them by 1000000 "),
        (sweeps(with_points(lambda points: points * 1000)), {("length-unit", ERROR), ("sweep-range", WARNING)},
         "16 times"),
        (without((4, 6), sweep_files), {("sweep-gaps", WARNING), ("annotation-sweep", WARNING)},
         "2 gaps, the longest 200.0 ms & 2 of 16 annotated times without"),
        (short_egomotion, {("ego-motion-missing", ERROR)}, "images of front & lidar sweeps"),
        (later_by(20 * 10**9), {("annotation-outside", ERROR)}, "timestamp"),
        (later_by(10**9, only=15), {("annotation-outside", WARNING), ("label-gaps", WARNING)},
         "1 of 16 annotated times outside"),
        (later_by(-7_000_000, only=15), {("annotation-time", WARNING)}, "1 of 16 annotated times at neither  1 times"),
        (frames(unknown_category), {("file", ERROR)}, "sideways"),
        (head(lambda head: head.update(annotated="none")), {("annotated", WARNING)}, "4 objects, which nothing uses"),
        (together(lambda root: images(root)[2].write_bytes(b"\x89PNG\r\n\x1a\n"), sweep_of(lambda points: points[:0]),
                  lambda root: sweep_files(root)[5].write_bytes(b"PK")),
         {("image", ERROR), ("sweep", ERROR), ("empty-sweep", ERROR)}, ""),  # files are read one by one
        (road_at(-0.08), {("road-height", WARNING)}, r"at -0.08 m.* [+-]0.0[01] m in the vehicle's lane.* 16 times"),
        (road_at(-0.03), set(), ""),  # within suspension travel
        (road_at(0.03), set(), ""),
    ],
)  # fmt: skip
def test_a_fault_is_told_and_nothing_else(root, plant, told, text):
    plant_and_compare(root, plant, told, text)


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
                frames(walker_flickers),
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
            together(
                named("copy", "leader"),
                frames(lambda _, frame: frame["objects"].update(copy=frame["objects"]["leader"])),
                annotations(lambda o: [o["frames"].pop(str(i)) for i in GAPS]),
            ),
            {("same-object", ERROR), ("label-gaps", WARNING)},
            "objects 'leader' and 'copy'",
        ),
        (renamed(range(8, 16)), {("object-name", WARNING)}, "goes on at 1 time "),
        (cuboids(lambda numbers, _i: numbers.__setitem__(1, numbers[1] + 5.0), only="leader"),
         {("empty-box", ERROR)}, r"object 'leader' \(vehicle\)"),
        (sweeps(with_points(lambda points: points * np.float32([1, -1, 1]))), {("box-reading", ERROR)},
         "the lidar's y has the wrong sign"),
        (lambda root: change_boxes(root, indices_that_no_sweep_has, only="walker"), {("point-indices", ERROR)},
         "a time at which there is no sweep  1 times & row 1000000 of a sweep of"),
        (shrunk(0.16, only="leader"), {("tight-box", WARNING)}, r"leader.* 0 points in (\d+) of 16 sweeps .* \1 times"),
        (shrunk(2 * drive.MARGIN_M), {("tight-boxes", WARNING)}, "with 2 cm more on each side"),
        (shrunk(2 * drive.MARGIN_M + 0.08), {("tight-boxes", WARNING)}, "with [67] cm more on each side"),
    ],
)  # fmt: skip
def test_a_fault_that_returns_could_see_is_told_and_nothing_else(root, plant, told, text):
    plant_and_compare(root, plant, told, text, returns=True)


def arriving(time_ns):
    """Late by up to a third of a frame."""
    return int(np.random.default_rng(time_ns % 1000).integers(0, 33_000_000)) if time_ns > drive.START_NS else 0


def nodding_lidar(root):
    turned = drive.quaternion_wxyz(tiny.VEHICLE_FROM_LIDAR, Rotation.from_euler("y", 6, degrees=True))
    change_head(root, lambda head: head["lidar"]["vehicle_from_lidar"].update(quaternion_wxyz=turned))


def quaternion_of_another_order(numbers, _i):
    x, y, z, w = numbers[3:7]
    numbers[3:7] = [w, x, y, z]


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
        (bus(yaw_rate_radps="11.5"), ERROR, "ego-turn", "yaw rate"),
        (bus(yaw_rate_radps="11.5"), WARNING, "object-jump", "may follow from the ego-motion: correct that"),
        (retimed("images/front", arriving), WARNING, "irregular-times", "images of front"),
        (copied(3, 4, sweep_files), ERROR, "same-sweep", ""),
        (packed_sweeps, WARNING, "not-read", r"lidar/\*.*gz .*5 that are passed over: no .npz or .bin.* 5 times"),
        (retimed("lidar", lambda _: 100 * 10**9), ERROR, "sensor-overlap", "same epoch"),
        (retimed("lidar", lambda _: 100 * 10**9), ERROR, "ego-motion-missing", "lidar sweeps"),
        (lidar_at(1.3), ERROR, "road-height", "-0.50 m"),
        (together(lidar_at(1.3), cuboids(jump, only="parked")), WARNING, "object-jump",
         "may follow from the lidar's mounting: correct that, validate again"),
        (retimed("lidar", lambda _: 7_000_000), WARNING, "annotation-time",
         "each is 7.0 ms from the nearest sweep: the clock of the sweeps is late by that, or the boxes are early"),
        (nodding_lidar, WARNING, "road-tilt", ""),
        (head(lambda head: head["cameras"]["front"]["model"].update(principal_point=[-3.0, 2.0])),
         ERROR, "principal-point", r"\(-3.0, 2.0\)"),
        (velocities(lambda _: [0.0, -20.0, 0.0], only="walker"), ERROR, "object-speed", "20.0 m/s as stated"),
        (turns_in_degrees, ERROR, "object-turn", "'parked'"),
        (renamed(range(1, 16, 2)), WARNING, "object-name", "'leader' and 'other'"),
        (together(named("friend", "walker"), frames(exchanged)), WARNING, "object-name",
         "'friend' and 'walker' .* 1 times"),
        (cuboids(quaternion_of_another_order, only="parked"), ERROR, "box-tilt", ""),
        (cuboids(in_the_ego_vehicle, only="walker"), ERROR, "object-in-ego", ""),
        (cuboids(jump, only="parked"), ERROR, "object-jump", "'parked'"),
        (velocities(lambda v: [3.6 * x for x in v], only="leader"), ERROR, "velocity", "km/h instead of m/s"),
        (velocities(lambda v: [v[0] - drive.SPEED_MPS, *v[1:]], only="leader"), ERROR, "velocity",
         "relative to the vehicle instead of over the ground"),
    ],
)  # fmt: skip
def test_a_fault_is_told_beside_what_follows_from_it(root, plant, severity, check, text):
    plant(root)
    told = [text_of(finding) for finding in found(root) if (finding.check, finding.severity) == (check, severity)]
    assert any(re.search(text, line) for line in told), told


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


@pytest.mark.parametrize("stated_mps", [4.0 * 3.6, pytest.param(4.0, marks=pytest.mark.slow)])
def test_between_plain_walls_the_lidar_cannot_tell_the_speed(monkeypatch, tmp_path, stated_mps):
    """Where beams of a vehicle that stands would hit the same places again, though it drives at 4 m/s."""
    walls = [(RigidTransform.from_yaw(0.0, (0.0, y, 1.5)), np.array([400.0, 0.2, 3.0])) for y in (-9.1, 9.1)]
    for name, value in {"SPEED_MPS": 4.0, "TURN_RADPS": 0.0, "OBJECTS": {}, "scenery": lambda: walls}.items():
        monkeypatch.setattr(drive, name, value)
    corridor = drive.write_drive(tmp_path / "drive")
    change_bus(corridor, lambda row: row.update(speed_mps=str(stated_mps)))
    assert "ego-motion-unit" not in {finding.check for finding in found(corridor, static_world=True)}


def test_neither_pavements_nor_scatter_nor_the_car_ahead_move_the_lane():
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-13, 13, (2, 40_000))
    z = np.where(np.abs(y) > 2.0, 0.10, -0.04) + rng.normal(0, 0.02, x.size)
    car = (x > 7.0) & (np.abs(y) < 0.9)
    z[car] = rng.uniform(0.15, 1.5, car.sum())
    height_m, _, lane_height_m = seen_road(np.column_stack([x, y, z]))
    assert lane_height_m == pytest.approx(-0.04, abs=0.005)
    assert abs(height_m + 0.04) > 0.05  # the lowest points of all cells tell less


def test_a_lane_that_is_not_seen_or_leads_over_a_kerb_tells_no_height():
    """A plane through the road ahead and the pavement behind a kerb would lie below the road at the vehicle."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(2.6, 13.0, 0.2), np.arange(-6.0, 6.0, 0.2)))
    flat = np.column_stack([x, y, 0.0 * x])
    assert seen_road(flat)[2] == pytest.approx(0.0, abs=0.005)
    assert np.isnan(seen_road(flat[np.abs(y) > 1.5])[2])
    assert np.isnan(seen_road(flat + np.outer(np.where(x > 5.0 + y, 0.12, 0.0), [0, 0, 1]))[2])


def test_of_many_boxes_at_one_place_some_pairs_are_listed_and_none_of_boxes_that_touch(tmp_path):
    def same_objects(cars, *, apart_m):
        """What is told of cars of 5.2 x 2 m beside each other."""
        tracks, size_m = [], np.array([5.2, 2.0, 2.1])
        for i in range(cars):
            place = RigidTransform.from_yaw(0.0, (9.0, 4.0 + apart_m * i, 1.05))
            box = Cuboid(vehicle_from_object=place, size_m=size_m)
            states = [ObjectState(timestamp_ns=t, shape=box, velocity_mps=np.zeros(3)) for t in tiny.TIMES_NS]
            tracks.append(Track(track_id=f"car {i}", object_class="vehicle", states=tuple(states)))
        root = tiny.write_recording(tmp_path / f"{cars} cars")
        RecordingWriter(root).annotations(tracks)
        return [finding for finding in found(root, deep=True) if finding.check == "same-object"]

    same = same_objects(15, apart_m=0.0)
    assert len(same) == boxes.MOST_PAIRS_LISTED + 1
    assert f" in {105 - boxes.MOST_PAIRS_LISTED} more pairs" in same[-1].got
    assert {finding.times for finding in same[:-1]} == {len(tiny.TIMES_NS)}
    assert same_objects(4, apart_m=1.5) == []


@pytest.mark.parametrize("bits", [10, 12])
def test_bits_that_are_read_as_sixteen(root, bits):
    for number, path in enumerate(images(root)):
        values = np.random.default_rng(number).integers(0, 2**bits, (tiny.HEIGHT, tiny.WIDTH), dtype=np.uint16)
        cv2.imwrite(str(path), values)
    told = [finding for finding in found(root) if finding.check == "grey-levels"]
    assert [finding.severity for finding in told] == ([Severity.WARNING] if bits == 12 else [])
    change_head(root, lambda head: head["cameras"]["front"].update(white_level=2**bits - 1))
    assert found(root) == []


def test_the_same_drive_under_two_names_is_found_by_its_content(tmp_path):
    for name in ("a", "b", "other"):
        tiny.write_recording(tmp_path / "data" / name)
    changed = RecordingWriter(tmp_path / "data" / "other")
    changed.image("front", tiny.TIMES_NS[1], np.zeros((tiny.HEIGHT, tiny.WIDTH), dtype=np.uint8))
    report = validate_dataset("x", open_dataset(load_card(write_card(tmp_path))))
    same = {of.name: [f.got for f in of.findings if f.check == "same-drive"] for of in report.recordings}
    assert same == {"a": [], "b": ["the images and the sweep of 'a' in the middle of it"], "other": []}
    (alone,) = validate_dataset("x", open_dataset(load_card(write_card(tmp_path)), "a")).recordings
    assert "same-drive" not in [finding.check for finding in alone.findings]
