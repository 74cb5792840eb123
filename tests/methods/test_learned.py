"""The method `learned`: what the network is shown, its answers, and whatever is wrong with its files."""

import hashlib
import json
import pickle
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.errors import DataError, UsageError
from bench.geometry import RigidTransform
from bench.methods import build_method
from bench.methods.learned import method as learned
from bench.methods.learned.inputs import COARSE, FINE, GROUPS, MIRRORED, ZERO, Channels, network_input
from bench.methods.rigid_scene.scene import Views
from bench.recordings import load_card
from tests.conftest import DATASETS
from tests.support.board_scene import crossing, drive, scaled

EARLIER = GROUPS["earlier"]


def channels_of(given):
    found = network_input(Views.of(given))
    channels = dict(zip(COARSE, found.coarse.astype(int) - ZERO, strict=True))
    return channels | dict(zip(FINE, found.fine.astype(int) - ZERO, strict=True))


@pytest.fixture(scope="module")
def scene():
    given, (*_, board) = drive(range(-3, 1), board_m=(5.0, 0.5, 0.0), sideways_m=0.12)
    return given, Views.of(given), channels_of(given), board


def test_channels_have_two_sizes_and_are_given_in_the_order_of_their_names(scene):
    _, views, channels, _ = scene
    assert (views.cell_size_px, views.given.camera.width) == (1, 320)
    assert {channels[name].shape for name in COARSE} == {(240, 320)}
    assert {channels[name].shape for name in FINE} == {(480, 640)}
    some = network_input(views, ("sigmas", "valid"), ("fine_road_difference",))
    np.testing.assert_array_equal(some.coarse.astype(int) - ZERO, [channels["sigmas"], channels["valid"]])
    np.testing.assert_array_equal(some.fine[0].astype(int) - ZERO, channels["fine_road_difference"])
    assert network_input(views, ("valid",), ()).fine.shape == (0, 480, 640)
    np.testing.assert_array_equal(some.coarse[1] > ZERO, views.given.valid)


def test_compensation_leaves_what_moves(scene):
    _, views, channels, board = scene
    road = views.given.valid & (channels["fall"] > 20) & ~board[::2, ::2]  # a cosine of 0.3 to straight down
    left = {name: np.abs(channels[name])[road].mean() for name in ("rotated_difference", "road_difference")}
    assert left["road_difference"] < 0.5 * left["rotated_difference"]
    for name in ("epipolar", "road_difference", "sigmas", "misfit"):
        moving, static = (np.abs(channels[name])[where].mean() for where in (board[::2, ::2], road))
        assert moving > 3 * static, name
    fine_road = road.repeat(2, axis=0).repeat(2, axis=1) & ~board
    fine = np.abs(channels["fine_road_difference"])
    assert fine[board].mean() > 2 * fine[fine_road].mean()


def test_an_earlier_image_tells_slow_objects_from_static_ones():
    left = {}
    for speed in (0.0, 0.02):  # m an image
        given, (*_, board) = drive(range(-3, 1), board_m=(3.0, -0.6, 0.0), sideways_m=speed)
        channels = channels_of(given)
        for name in EARLIER:
            left[name, speed] = np.abs(channels[name])[board if name in FINE else board[::2, ::2]].mean()
    for size in ("", "fine_"):
        road, static = f"{size}earlier_road_difference", f"{size}earlier_static_difference"
        assert left[static, 0.0] < 0.6 * left[road, 0.0], size
        assert left[static, 0.02] > 1.8 * left[static, 0.0], size


def test_at_the_start_of_a_drive_there_is_no_earlier_image(scene):
    given, _, channels, _ = scene
    first = {name: getattr(given, name)[-2:] for name in ("images", "timestamps_ns")}
    found = channels_of(replace(given, **first, current_from_previous=given.current_from_previous[-1:]))
    assert {name for name in found if not np.array_equal(found[name], channels[name])} == {*EARLIER}
    assert not any(found[name].any() for name in EARLIER)


def test_channels_that_change_sign_in_a_mirror_are_listed(scene):
    _, _, channels, _ = scene
    left, right = (slice(60, 200), slice(40, 140)), (slice(60, 200), slice(180, 280))
    signed = [name for name in COARSE if channels[name][left].mean() * channels[name][right].mean() < -25]
    assert set(signed) <= set(MIRRORED)
    assert "parallax_u" in signed


def test_a_stationary_camera_measures_flow():
    still = replace(crossing()[0], current_from_previous=(RigidTransform.identity(),))
    names = ("parallax_u", "parallax_v", "positive_depth", "epipolar", "sigmas")
    channels = network_input(Views.of(still), names).coarse.astype(int) - ZERO
    assert not channels[:3].any()
    assert channels[3].max() > 20
    assert channels[4].max() > 20


# Mean and standard deviation, in bytes, of each channel of the scene as the shipped network was trained on it. Where a
# change of flow, motion or camera models moves them, the network must be trained anew, or at least scored anew.
TRAINED_ON = {
    "valid": (160.0, 0.0),
    "angle": (210.2, 28.1),
    "fall": (136.4, 37.0),
    "road_parallax": (181.8, 52.1),
    "parallax_u": (128.0, 50.4),
    "parallax_v": (107.2, 41.5),
    "current": (128.0, 31.9),
    "rotated_difference": (127.5, 42.8),
    "road_difference": (128.1, 17.5),
    "flow_u": (128.5, 17.6),
    "flow_v": (130.8, 7.0),
    "flow_difference": (128.0, 13.7),
    "epipolar": (130.0, 4.4),
    "positive_depth": (128.1, 1.5),
    "positive_height": (128.1, 1.1),
    "anti_parallel": (128.5, 3.7),
    "sigmas": (130.0, 4.4),
    "misfit": (126.2, 7.9),
    "texture": (202.8, 12.4),
    "road_seen": (144.6, 16.0),
    "inverse_depth": (185.8, 37.2),
    "from_road": (141.0, 12.9),
    "earlier_road_difference": (128.1, 20.6),
    "earlier_static_difference": (128.0, 11.3),
    "fine_earlier_road_difference": (128.1, 27.7),
    "fine_earlier_static_difference": (128.1, 14.4),
    "fine_current": (128.0, 31.9),
    "fine_rotated_difference": (127.5, 48.8),
    "fine_road_difference": (128.1, 26.6),
    "fine_flow_difference": (128.0, 17.8),
}


def test_channels_are_those_that_the_network_was_trained_on(scene):
    _, _, channels, _ = scene
    assert set(TRAINED_ON) == {*COARSE, *FINE}
    for name, expected in TRAINED_ON.items():
        found = channels[name].mean() + ZERO, channels[name].std()
        assert found == pytest.approx(expected, abs=0.3), name


@pytest.fixture
def weights(tmp_path):
    """A copy of the network of the package."""
    for suffix in (".onnx", ".json"):
        shutil.copy(learned.SHIPPED.with_suffix(suffix), tmp_path)
    return tmp_path / "learned.onnx"


def test_it_finds_a_board_that_crosses_and_answers_the_same_in_another_process():
    method, (given, board) = build_method("learned"), crossing()
    found = method.segment(given)
    assert (found.cell_size_px, found.likelihood_is_score) == (1, True)
    scores = found.likelihood
    assert 0 <= scores.min() <= scores.max() <= 1
    assert not scores[found.undefined].any()
    assert scores[board].mean() > 2 * scores[~board].mean()
    travelled = pickle.loads(pickle.dumps(method)).segment(given)
    np.testing.assert_array_equal(travelled.likelihood, scores)
    strict = build_method("learned", {"threshold": 0.999}).segment(given)
    assert strict.mask.sum() < found.mask.sum()
    assert strict.threshold == 0.999
    np.testing.assert_array_equal(found.mask, scores > found.threshold)


def test_sides_are_any_and_large_images_are_answered_on_cells():
    small, method = crossing()[0], build_method("learned")
    channels = learned.network_input(Views.of(small), method.trained.coarse, method.trained.fine)
    odd = Channels(coarse=channels.coarse[:, :235, :309], fine=channels.fine[:, :471, :619])
    assert method.scores(odd).shape == (471, 619)
    found = method.segment(scaled(small, 1280, 960))
    assert (found.cell_size_px, found.mask.shape) == (2, (480, 640))


def test_a_score_that_rounding_takes_above_1_is_1(monkeypatch):
    above, shape = np.nextafter(np.float32(1), np.float32(2)), (480, 640)  # as ONNX Runtime's sigmoid gives, if rarely
    session = SimpleNamespace(run=lambda *_: [np.full((1, *shape), above)])
    monkeypatch.setattr(learned, "_session", lambda *_: session)
    channels = Channels(coarse=np.zeros((1, 240, 320), np.uint8), fine=np.zeros((1, *shape), np.uint8))
    np.testing.assert_array_equal(build_method("learned").scores(channels), np.ones(shape, np.float32))


def test_the_card_tells_where_the_network_comes_from():
    card = json.loads(learned.SHIPPED.with_suffix(".json").read_text())
    assert card["sha256"] == hashlib.sha256(learned.SHIPPED.read_bytes()).hexdigest()
    assert card["weights"] <= 1_000_000
    assert card["licence"]
    assert card["training"]["dataset"] == "training"
    data = load_card(DATASETS / "training.yaml")
    assert card["training"]["scenario_sha256"] == hashlib.sha256(data.scenario.read_bytes()).hexdigest()
    assert card["validation"]["drives"] == len(data.content.splits["validation"])


def test_other_weights_beside_their_card(weights):
    method = build_method("learned", {"weights": str(weights)})
    assert method.files == (weights, weights.with_suffix(".json"))
    weights.write_bytes(weights.read_bytes()[:-10])
    with pytest.raises(DataError, match="restore both files"):
        build_method("learned", {"weights": str(weights)})
    weights.unlink()
    with pytest.raises(DataError, match="expected the network of its card, got No such file"):
        build_method("learned", {"weights": str(weights)})


NOTHING = b"no network"


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"coarse": ["current", "taste"]}, "expected channels of this version, got taste"),
        ({"threshold": "high"}, r"learned\.json: threshold: expected a valid number"),
        ({"sha256": None}, r"learned\.json: sha256: expected a valid string"),
        ({"sha256": hashlib.sha256(NOTHING).hexdigest()}, "expected an ONNX network"),
    ],
)
def test_a_card_or_a_network_that_does_not_fit(weights, changed, message):
    card = weights.with_suffix(".json")
    card.write_text(json.dumps(json.loads(card.read_text()) | changed))
    if "ONNX" in message:
        weights.write_bytes(NOTHING)
    with pytest.raises(DataError, match=message):
        build_method("learned", {"weights": str(weights)}).segment(crossing()[0])


def test_without_onnx_runtime_the_command_that_installs_it_is_named(monkeypatch):
    monkeypatch.setattr(learned, "onnxruntime", None)
    with pytest.raises(UsageError, match=r"pip install 'fisheye-bench\[learned\]'"):
        build_method("learned")
