"""The native format: what is written is what is read, and every fault has its line."""

import pickle
import re
from dataclasses import replace
from functools import reduce
from operator import getitem

import cv2
import numpy as np
import pytest

from bench.cameras.model import RollingShutter
from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform
from bench.recordings import RecordingWriter, open_native, read_image, read_truth
from bench.recordings.images import as_seen
from bench.records.recording import frame_gaps
from tests.support import tiny
from tests.support.lenses import LENSES
from tests.support.planting import change_head


def test_the_head_comes_back(root):
    recording = open_native(root)
    camera = recording.cameras["front"]
    assert (recording.name, recording.frame_interval_ns) == ("drive", tiny.STEP_NS)
    assert camera.model == tiny.lens()
    assert camera.stored_size_px == (64, 48)
    assert camera.vehicle_from_camera.matrix == pytest.approx(tiny.FRONT.matrix, abs=1e-15)
    assert camera.road.height_m == pytest.approx(0.65)
    assert camera.road.down == pytest.approx([0.0, 1.0, 0.0], abs=1e-15)
    assert np.array_equal(camera.ego_body, tiny.front_camera().ego_body)
    assert recording.vehicle_from_lidar.matrix == pytest.approx(tiny.VEHICLE_FROM_LIDAR.matrix, abs=1e-15)
    assert np.array_equal(recording.vehicle_outline_m, tiny.OUTLINE_M)
    assert frame_gaps(recording, "front") == {}
    root = tiny.write_recording(root.parent / "Straße 7, 10:30", ground_height_m=-0.1)
    low = open_native(root)
    assert (low.name, low.cameras["front"].road.height_m) == ("Straße 7, 10:30", pytest.approx(0.75))


MODELS = LENSES | {"limited": replace(LENSES["brown_conrady"], radial=(-0.2,), max_angle_rad=0.5)}


@pytest.mark.parametrize("name", MODELS)
def test_every_camera_model_comes_back(tmp_path, name):
    root = tiny.write_recording(tmp_path / "drive", model=MODELS[name])
    assert open_native(root).cameras["front"].model == MODELS[name]


def test_images_truth_and_sweeps_come_back(root):
    recording = open_native(root)
    camera = recording.cameras["front"]
    images = recording.images["front"]
    assert [image.timestamp_ns for image in images] == list(tiny.TIMES_NS)
    for i, image in enumerate(images):
        assert np.array_equal(read_image(image, camera), tiny.pixels(i))
        assert np.array_equal(read_truth(image, camera), tiny.truth(i))
        assert np.array_equal(read_truth(image), tiny.truth(i))
    assert len(recording.sweeps) == 2
    for i, reference in enumerate(recording.sweeps):
        sweep, expected = pickle.loads(pickle.dumps(reference)).read(), tiny.sweep(i)
        assert sweep.timestamp_ns == expected.timestamp_ns
        for field in ("points_lidar", "time_offset_ns", "intensity", "ring"):
            assert np.array_equal(getattr(sweep, field), getattr(expected, field))


def test_ego_motion_comes_back_from_bus_signals_or_poses(root):
    trajectory = open_native(root).trajectory
    assert trajectory.timestamps_ns.tolist() == list(tiny.TIMES_NS)
    assert trajectory.positions_m[-1] == pytest.approx([0.4, 0.0, 0.0], abs=1e-8)
    (root / "egomotion.csv").unlink()
    (root / "truth/poses.csv").rename(root / "poses.csv")
    assert open_native(root).trajectory.positions_m[-1].tolist() == [0.4, 0.0, 0.0]


def test_writing_twice_gives_the_same_bytes(tmp_path):
    one, two = (tiny.write_recording(tmp_path / place / "drive") for place in ("one", "two"))
    files = sorted(path.relative_to(one) for path in one.rglob("*") if path.is_file())
    assert len(files) == 13
    assert files == sorted(path.relative_to(two) for path in two.rglob("*") if path.is_file())
    for file in files:
        assert (one / file).read_bytes() == (two / file).read_bytes(), file


def test_evaluated_at_half_the_size_of_all_cameras_or_of_one(root):
    recording = open_native(root, evaluated_size_px=(32, 24))
    camera, image = recording.cameras["front"], recording.images["front"][0]
    assert (camera.model.width, camera.model.height) == (32, 24)
    assert camera.stored_size_px == (64, 48)
    assert camera.ego_body.shape == (24, 32)
    assert camera.ego_body.sum() == 8 * 40 // 4
    stored = tiny.pixels(0).astype(float)
    means = stored.reshape(24, 2, 32, 2).mean(axis=(1, 3))
    assert np.abs(read_image(image, camera) - means).max() <= 1.0
    assert read_image(image, camera, colour=True).shape == (24, 32, 3)
    assert set(np.unique(read_truth(image, camera))) == {0, 40_000}
    assert open_native(root, evaluated_size_px={"rear": (10, 10)}).cameras["front"].model.width == 64
    assert open_native(root, evaluated_size_px={"front": (32, 24)}).cameras["front"].model.height == 24
    assert open_native(root, evaluated_size_px=(21, 16)).cameras["front"].model.height == 16  # 15.75
    with pytest.raises(DataError, match=r"'front'.*64 x 48 px, got 32 x 18 px.*\{front: \[32, 24\]\}"):
        open_native(root, evaluated_size_px=(32, 18))


def test_a_rolling_shutter_and_where_the_beams_start_come_back(root):
    """Points of some recordings stand in other axes than the sensor's own."""
    plain = open_native(root)
    assert plain.cameras["front"].rolling_shutter is None
    assert np.array_equal(plain.lidar_from_sensor.matrix, np.eye(4))
    shutter = RollingShutter(readout_s=0.025, direction="left")
    beams = RigidTransform.from_quaternion((0.8, 0.0, 0.0, 0.6), (0.25, -0.5, 2.0))
    cameras = {"front": replace(tiny.front_camera(), rolling_shutter=shutter)}
    tiny.write_head(root, cameras=cameras, lidar_from_sensor=beams)
    for size_px in (None, (32, 24)):
        recording = open_native(root, evaluated_size_px=size_px)
        assert recording.cameras["front"].rolling_shutter == shutter
        assert recording.lidar_from_sensor.matrix == pytest.approx(beams.matrix, abs=1e-12)
        assert recording.vehicle_from_lidar.matrix == pytest.approx(tiny.VEHICLE_FROM_LIDAR.matrix, abs=1e-12)


def test_a_gap_in_time_is_told_but_no_fault_of_opening(root):
    (root / f"images/front/{tiny.TIMES_NS[1]}.png").unlink()
    assert frame_gaps(open_native(root), "front") == {1: tiny.TIMES_NS[2] - tiny.TIMES_NS[0]}


def change(root, path, value):
    """Set a value deep in recording.json; a value of `...` removes it."""
    *parents, last = path.split(".")

    def change_place(head):
        place = reduce(getitem, parents, head)
        place[last] = value
        if value is ...:
            del place[last]

    change_head(root, change_place)


FRONT = "cameras.front"
MASK, MOUNT, SHUTTER = f"{FRONT}.ego_body_mask", f"{FRONT}.vehicle_from_camera", f"{FRONT}.rolling_shutter"
INVERSE = {"quaternion_wxyz": [0.5, 0.5, -0.5, 0.5], "translation_m": [0.0, 0.7, -3.6]}
OUTSIDE = f"{MASK}: expected a relative path without '..'"
HEAD_FAULTS = [
    ("schema_version", 2, "schema_version: expected 1, got 2"),
    ("frame_interval_ns", 0, "frame_interval_ns: expected greater than 0, got 0"),
    ("licence", ..., "licence: expected a value, got nothing"),
    ("name", "drive-7", "name: expected 'drive', as its folder, got 'drive-7'"),
    ("colour", "red", "colour: expected no such key, got 'red'"),
    (f"{FRONT}.image_size", [64, 0], f"{FRONT}.image_size.1: expected greater than 0, got 0"),
    (f"{FRONT}.model.model", "egg", f"{FRONT}.model.model: expected one of brown_conrady, double_sphere"),
    (f"{FRONT}.model.principal_point", [1.0], f"{FRONT}.model.principal_point: expected two numbers, got (1.0,)"),
    (f"{FRONT}.model.coefficients", ["a"], f"{FRONT}.model: expected numbers"),
    (f"{FRONT}.model.width", 64, f"{FRONT}.model.width: expected no such key, got one; image_size says it"),
    (f"{MOUNT}.quaternion_wxyz", [1.0, 1.0, 0.0, 0.0], "quaternion_wxyz: expected a quaternion w, x"),
    (f"{MOUNT}.translation_m", [0.0, 0.0, -1.0], "expected a camera above the road"),
    (MOUNT, INVERSE, "-3.60 m; the inverse of the mounting stands 0.70 m above it: give vehicle_from_camera"),
    ("vehicle.outline_m", [[0.0, 0.0]], "vehicle.outline_m"),
    *((MASK, path, OUTSIDE) for path in ("../outside.png", "/etc/passwd", "a\\..\\b", "C:/x", "", "a\0b")),
    (MASK, "none.png", "none.png: expected an image file"),
    (SHUTTER, {"readout_s": 25.0}, "readout_s: expected less than or equal to 0.2, got 25.0"),
    ("cameras", {}, "cameras: expected"),
]


@pytest.mark.parametrize(("path", "value", "message"), HEAD_FAULTS, ids=[f"{p}={v}" for p, v, _ in HEAD_FAULTS])
def test_faults_of_the_head_name_file_and_field(root, path, value, message):
    change(root, path, value)
    with pytest.raises(DataError) as caught:
        open_native(root)
    assert str(root) in str(caught.value)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_nan_and_broken_json_are_refused(root):
    file = root / "recording.json"
    file.write_text(file.read_text().replace("1.2", "NaN", 1))
    with pytest.raises(DataError, match=r"json: lidar.vehicle_from_lidar.translation_m.0: expected a finite number"):
        open_native(root)
    file.write_text(file.read_text()[:50])
    with pytest.raises(DataError, match=r"recording\.json: expected JSON"):
        open_native(root)


FILES = [  # what is made, what is removed, and what is said
    ("images/rear/x", "", "cameras.rear: expected a calibration for images/rear, got none"),
    ("", "images/front/*", "images/front: expected images named <timestamp_ns>"),
    (f"images/front/{tiny.TIMES_NS[0]}.jpg", "", "expected one file for each time"),
    ("poses.csv", "", "expected one of egomotion.csv and poses.csv, got both"),
    ("", "egomotion.csv", "got neither; the reference cannot do without"),
    ("", "recording.json", "recording.json: expected a readable file"),
    ("images/front/1.5.png", "", "got '1.5'; these would be seconds: multiply them by 1000000000"),
    *(
        (f"images/front/{name}.png", "", f"expected a name that is a time in nanoseconds, got '{name}'")
        for name in ("first", "1.5", "-3", 2**62 + 1)
    ),
]


@pytest.mark.parametrize(("made", "removed", "told"), FILES, ids=[told for _, _, told in FILES])
def test_files_that_are_missing_doubled_or_called_by_no_time_are_named(root, made, removed, told):
    if made:
        (root / made).parent.mkdir(exist_ok=True)
        (root / made).write_bytes(b"")
    for path in root.glob(removed or "nothing"):
        path.unlink()
    with pytest.raises(DataError, match=re.escape(told)):
        open_native(root)


def test_columns_of_bin_are_those_of_the_card(root):
    rows = np.column_stack([tiny.sweep(0).points_lidar, np.arange(30), np.arange(30)]).astype("<f4")
    (root / f"lidar/{tiny.TIMES_NS[2]}.bin").write_bytes(rows.tobytes())
    sweep = open_native(root, bin_columns=["x", "y", "z", "intensity", "ring"]).sweeps[2].read()
    assert np.array_equal(sweep.points_lidar, tiny.sweep(0).points_lidar)


def test_the_writer_refuses_what_the_format_cannot_hold(tmp_path):
    with pytest.raises(ShapeError, match="expected an image of uint8, got float64"):
        RecordingWriter(tmp_path / "drive").image("front", 0, np.zeros((4, 4)))
    with pytest.raises(ShapeError, match=r"rotations: expected scipy's Rotation, .*, got ndarray"):
        RecordingWriter(tmp_path / "drive").poses(np.zeros(1), np.array([[0, 0, 0, 1]]), np.zeros((1, 3)))
    assert not (tmp_path / "drive").exists()
    with pytest.raises(DataError, match=r"recording\.json: frame_interval_ns: expected greater than 0, got 0$"):
        tiny.write_head(tmp_path / "drive", frame_interval_ns=0)


@pytest.mark.parametrize("jpeg_quality", [None, 100])
def test_colour_images_are_bgr_on_both_ways(root, jpeg_quality):
    time_ns = tiny.TIMES_NS[0] - 1
    pixels = np.full((48, 64, 3), (10, 20, 30), np.uint8)
    RecordingWriter(root).image("front", time_ns, pixels, jpeg_quality=jpeg_quality)
    recording = open_native(root)
    image = recording.images["front"][0]
    assert (image.timestamp_ns, image.path.suffix) == (time_ns, ".png" if jpeg_quality is None else ".jpg")
    assert read_image(image, recording.cameras["front"], colour=True)[5, 5] == pytest.approx([10, 20, 30], abs=2)


@pytest.mark.parametrize("file", ["recording.json", "annotations.json", "egomotion.csv", "truth/poses.csv"])
def test_a_byte_order_mark_changes_nothing(root, file):
    (root / file).write_bytes(b"\xef\xbb\xbf" + (root / file).read_bytes())
    marked = open_native(root, ego_motion="exact" if "truth" in file else "recorded")
    assert [track.track_id for track in marked.tracks] == ["van", "walker"]
    assert marked.trajectory.positions_m[-1] == pytest.approx([0.4, 0.0, 0.0], abs=1e-8)


@pytest.mark.parametrize("white", [1023, 16383])
@pytest.mark.parametrize("colour", [False, True])
def test_images_of_more_bits_are_read_by_their_white_level(root, white, colour):
    values = np.random.default_rng(white).integers(0, white + 1, (tiny.HEIGHT, tiny.WIDTH), dtype=np.uint16)
    for path in (root / "images/front").iterdir():
        cv2.imwrite(str(path), values)
    change_head(root, lambda head: head["cameras"]["front"].update(white_level=white))
    recording = pickle.loads(pickle.dumps(open_native(root)))
    image = recording.images["front"][0]
    seen = read_image(image, recording.cameras["front"], colour=colour)
    wanted = np.round(values.astype(np.float64) * 255 / white)
    assert np.array_equal(as_seen(values, white), wanted)
    assert np.abs(seen.astype(float) - (wanted[..., None] if colour else wanted)).max() <= 1
    before = image.stored.content()
    change_head(root, lambda head: head["cameras"]["front"].update(white_level=white + 1))
    assert open_native(root).images["front"][0].stored.content() != before


def test_what_of_a_recording_is_read_and_what_is_not(root):
    (root / "notes.txt").write_text("x")
    (root / "images/front/.12.abc.png").write_bytes(b"")  # hidden: not finished, and passed over
    for name in ("1.PCD.gz", "2.PCD.gz", "3.npy"):
        (root / "lidar" / name).write_bytes(b"")
    contents = {content.what: content for content in open_native(root).contents}
    assert (contents["lidar/*.npz"].count, contents["lidar/*.npz"].read_as) == (2, "sweeps")
    assert (contents["lidar/*.gz"].count, contents["lidar/*.gz"].suspect) == (2, True)
    assert contents["lidar/3.npy"].why == "no .npz or .bin or .pcd or .las or .laz"
    assert (contents["notes.txt"].read_as, contents["notes.txt"].suspect) == ("", False)
    assert contents["images/front/*.png"].count == 3


# The exact truth of a synthetic recording instead of what its car reports

OFF = RigidTransform.from_yaw(0.01, (0.003, -0.002, 0.001))


@pytest.fixture
def truthful(root):
    """The tiny recording, whose camera and lidar sit a little off."""
    camera = tiny.front_camera()
    writer = RecordingWriter(root)
    moved = replace(camera, vehicle_from_camera=OFF @ tiny.FRONT)
    writer.true_calibration(cameras={"front": moved}, vehicle_from_lidar=OFF @ tiny.VEHICLE_FROM_LIDAR)
    file = root / "egomotion.csv"
    file.write_text(file.read_text().replace(",3.0,", ",2.7,"), encoding="utf-8")
    return root


def test_each_option_changes_its_own_part(truthful):
    change(truthful, "lidar.lidar_from_sensor", {"quaternion_wxyz": [1, 0, 0, 0], "translation_m": [0, 0, 2]})
    for motion in ("recorded", "exact"):
        for calibration, off in (("recorded", RigidTransform.identity()), ("exact", OFF)):
            recording = open_native(truthful, ego_motion=motion, calibration=calibration)
            camera = recording.cameras["front"]
            assert recording.trajectory.positions_m[-1, 0] == pytest.approx(0.36 if motion == "recorded" else 0.4)
            assert camera.vehicle_from_camera.matrix == pytest.approx((off @ tiny.FRONT).matrix, abs=1e-12)
            assert camera.road.height_m == pytest.approx(0.65 + off.translation_m[2])
            assert camera.model == tiny.lens()
            assert np.array_equal(camera.ego_body, tiny.front_camera().ego_body)
            lidar = (off @ tiny.VEHICLE_FROM_LIDAR).matrix
            assert recording.vehicle_from_lidar.matrix == pytest.approx(lidar, abs=1e-12)
            assert recording.lidar_from_sensor.translation_m.tolist() == [0, 0, 2]
    with pytest.raises(DataError, match=r"options.ego_motion: expected 'recorded' or 'exact', got 'true'"):
        open_native(truthful, ego_motion="true")
    file = truthful / "truth/calibration.json"
    file.write_text(file.read_text().replace('"front"', '"rear"'))
    with pytest.raises(DataError, match=r"vehicle_from_camera: expected the cameras of .*: front, got rear"):
        open_native(truthful, calibration="exact")


@pytest.mark.parametrize(
    ("option", "file"), [("ego_motion", "truth/poses.csv"), ("calibration", "truth/calibration.json")]
)
def test_missing_truth_is_told_with_what_to_do(truthful, option, file):
    (truthful / file).unlink()
    open_native(truthful)
    with pytest.raises(DataError, match=rf"{file}: expected the truth for {option}: exact, got no such file.*recorded"):
        open_native(truthful, **{option: "exact"})
