"""The WoodScape adapter: a miniature with known truth, and the real calibrations."""

import cv2
import numpy as np
import pytest

from bench.adapters.woodscape import WoodscapeOptions, read_camera, woodscape_recordings
from bench.errors import DataError
from bench.evaluation.protocol import load_protocol
from bench.harness.run import cut_tasks
from bench.methods import build_method
from bench.recordings import load_card, open_dataset, read_image
from bench.records.reference import IgnoreReason, Status
from bench.reference.build import ReferenceBuilder
from tests.support import tiny_woodscape as tiny
from tests.support.planting import change_json
from tests.support.real import REAL, needs_real


@pytest.fixture
def root(tmp_path):
    return tiny.write_data_set(tmp_path / "WoodScape")


def handles(root, **options):
    return woodscape_recordings(root, options=tiny.OPTIONS | options, card=root / "card.yaml", annotations=None)


def opened(root, number=0, **options):
    return handles(root, **options)[number].open()


def reference_of(recording, protocol="masks-v1"):
    (camera,) = recording.cameras
    builder = ReferenceBuilder(recording, camera, load_protocol(protocol).reference)
    return builder.build(recording.images[camera][1])


def test_a_pair_is_a_recording(root):
    assert [handle.name for handle in handles(root)] == list(tiny.NAMES)
    recording = opened(root)
    before, now = recording.images["FV"]
    assert (before.scored, now.scored) == (False, True)
    assert now.timestamp_ns == tiny.TIME_US * 1000
    assert now.timestamp_ns - before.timestamp_ns == recording.frame_interval_ns == tiny.WAIT_US * 1000
    for name in ("nothing", "frame-difference"):  # only the later image is scored
        (task,) = cut_tasks(None, recording, None, build_method(name))
        assert (task.start, task.stop) == (1, 2)
    pixels = read_image(now, recording.cameras["FV"])
    assert np.roll(pixels, 1, axis=1) == pytest.approx(read_image(before, recording.cameras["FV"]))


def test_camera(root):
    camera = opened(root).cameras["FV"]
    assert camera.model.coefficients == (17.0, -1.6, 2.4, -0.36)
    assert camera.model.principal_point == pytest.approx((31.7, 23.4))  # offset + middle - half a pixel
    assert camera.vehicle_from_camera.rotation[:, 2] == pytest.approx([1, 0, 0])
    assert camera.vehicle_from_camera.rotation[:, 0] == pytest.approx([0, -1, 0])
    mirror = opened(root, 1).cameras["MVR"].vehicle_from_camera
    assert mirror.rotation[:, 2] == pytest.approx([0, 1, 0])
    assert camera.road.height_m == pytest.approx(0.66)


@pytest.mark.parametrize(("side", "sign", "gear"), [("left", 1, "D"), ("right", -1, "D"), ("left", 1, "R")])
def test_speed_is_in_kmh_backwards_in_reverse_and_yaw_rate_in_degrees(root, side, sign, gear):
    for folder in ("rgb_images", "previous_images"):
        change_json(root / "vehicle_data" / folder / "00000_FV.json", lambda content: content.update(ego_gear=gear))
    recording = opened(root, yaw_rate_positive=side)
    before, now = recording.images["FV"]
    speed_mps = -10.0 if gear == "R" else 10.0
    assert recording.trajectory.velocity_vehicle_mps(before.timestamp_ns)[0] == pytest.approx(speed_mps, rel=1e-4)
    pose = recording.trajectory.world_from_vehicle(now.timestamp_ns)
    # 0.3332 m, as the data set's own ego_distance has it, and 9 degrees a second for 33 ms.
    assert np.linalg.norm(pose.translation_m) == pytest.approx(0.3332, abs=1e-5)
    assert np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]) == pytest.approx(sign * np.radians(9.0) * 0.03332)


def test_objects_are_the_connected_components_of_the_mask(root):
    reference = reference_of(opened(root))
    # 80 + 16 px joined by a corner, 60 px, a speck of one; the part on the ego vehicle's body is not in V.
    assert [(o.polygon_px, o.status) for o in reference.objects] == [
        (96, Status.EVALUATED),
        (60, Status.EVALUATED),
        (1, Status.IGNORED),
    ]
    assert reference.objects[2].reason is IgnoreReason.SMALL_POLYGON
    assert {o.category.value for o in reference.objects} == {"moving"}
    assert np.isnan([o.range_m for o in reference.objects]).all()
    expected = tiny.motion("FV") > 0
    expected[44:] = False
    assert ((reference.labels > 0) | reference.ignored).tolist() == expected.tolist()
    assert (reference.labels == 1).sum() == 96
    assert reference.ego_speed_mps == pytest.approx(10.0, rel=1e-4)
    reference = reference_of(opened(root), "paper-v1")  # protocols of polygons ignore masks
    assert {o.reason for o in reference.objects} == {IgnoreReason.CLASS}
    assert not reference.labels.any()


def test_an_image_in_which_nothing_moves_and_half_the_size(root):
    assert reference_of(opened(root, 1)).objects == ()
    reference = reference_of(opened(root, evaluated_size_px=[32, 24]))
    assert reference.labels.shape == (24, 32)
    assert [o.polygon_px for o in reference.objects][:1] == [24]


CALIBRATION, VEHICLE = "calibration_data/calibration/00000_FV.json", "vehicle_data/rgb_images/00000_FV.json"
PREVIOUS, MASK = "previous_images/00000_FV_prev.png", "motion_annotations/gtLabels/00000_FV.png"


@pytest.mark.parametrize("file", [PREVIOUS, MASK, VEHICLE, CALIBRATION])
def test_a_missing_file_says_where_it_was_looked_for(root, file):
    (root / file).unlink()
    with pytest.raises(DataError, match=r"expected a file in .*, got none of this name"):
        opened(root)
    assert opened(root, 1).name == tiny.NAMES[1]


def test_a_mask_in_colours_is_refused(root):
    recording = opened(root)
    cv2.imwrite(str(root / MASK), np.zeros((48, 64, 3), dtype=np.uint8))
    with pytest.raises(DataError, match=r"gtLabels/00000_FV\.png: expected an 8-bit grey PNG"):
        reference_of(recording)


def test_annotations_apart_are_refused_and_the_card_finds_the_pairs(tmp_path, root, monkeypatch):
    with pytest.raises(DataError, match=r"annotations: expected none: this data set has masks"):
        woodscape_recordings(root, options={}, card=tmp_path / "x.yaml", annotations=tmp_path)
    monkeypatch.setenv("WOODSCAPE_DATASET", str(root))
    assert [handle.name for handle in open_dataset(load_card("woodscape"))] == list(tiny.NAMES)


@needs_real
@pytest.mark.parametrize(
    ("name", "height_m", "looks"),
    [
        ("00000_FV", 0.66, [1, 0]),
        ("00086_RV", None, [-1, 0]),
        ("00096_MVR", None, [-0.37, -0.93]),
        ("00141_MVL", None, [-0.31, 0.95]),
    ],
)
def test_the_real_calibrations(name, height_m, looks):
    folder = REAL / "woodscape/calibration"
    camera = read_camera(folder / f"{name}.json", name, WoodscapeOptions())
    assert (camera.name, camera.stored_size_px) == (name.split("_")[1], (1280, 966))
    along = camera.vehicle_from_camera.rotation[:2, 2]
    assert along / np.linalg.norm(along) == pytest.approx(looks, abs=0.05)
    assert camera.road.height_m == pytest.approx(0.9 if height_m is None else height_m, abs=0.01 if height_m else 0.3)
    pixels = np.array([[640.0, 480.0], [100.0, 200.0], [1200.0, 900.0]])
    rays, valid = camera.model.unproject(pixels)
    assert valid.all()
    assert camera.model.project(rays)[0] == pytest.approx(pixels, abs=1e-6)


@pytest.mark.parametrize(
    ("file", "elsewhere"),
    [
        (PREVIOUS, "previous_images/00000_FV_PREV.png"),
        ("rgb_images/00000_FV.png", "rgb_images/rgb_images/00000_FV.png"),
        (MASK, "motion_annotations/motion_annotations/gtLabels/00000_FV.png"),
        (CALIBRATION, "calibration/00000_FV.json"),
        (CALIBRATION, "calibration_data/00000_FV.json"),
        (VEHICLE, "vehicle_info/rgb_images/00000_FV.json"),
        (VEHICLE, "vehicle_data/00000_FV.json"),
        ("vehicle_data/previous_images/00000_FV.json", "vehicle_info/previous_images/00000_FV.json"),
    ],
)
def test_every_variant_of_the_folders(root, file, elsewhere):
    (root / elsewhere).parent.mkdir(parents=True, exist_ok=True)
    (root / file).rename(root / elsewhere)
    recording = opened(root)
    assert recording.name == "00000_FV"
    before, now = recording.images["FV"]
    assert all(path.is_file() for path in (before.path, now.path, now.moving_path))
