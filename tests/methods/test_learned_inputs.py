"""What the network sees: geometry takes the static world out of the difference of two images."""

from dataclasses import replace

import numpy as np
import pytest

from bench.geometry import RigidTransform
from bench.methods import UnansweredImage
from bench.methods.learned.inputs import ALL_CHANNELS, CHANNELS, MIRRORED, ZERO, network_input, working_pair
from tests.support.board_scene import STEP, crossing, frame


@pytest.fixture(scope="module")
def scene():
    previous, current, board = crossing()
    given = frame(previous, current, STEP)
    pair = working_pair(given)
    channels = network_input(pair, ALL_CHANNELS)
    return given, pair, dict(zip(ALL_CHANNELS, channels.astype(int) - ZERO, strict=True)), board[::2, ::2]


def test_everything_is_at_the_working_size(scene):
    given, pair, channels, _ = scene
    assert (pair.cell_size_px, pair.valid.shape, pair.given.camera.width) == (2, (240, 320), 320)
    assert {channel.shape for channel in channels.values()} == {(240, 320)}
    for names in CHANNELS.values():
        assert network_input(pair, names).shape == (len(names), 240, 320)
    np.testing.assert_array_equal(network_input(working_pair(given), CHANNELS["images"])[-1] > ZERO, pair.valid)


def test_compensation_leaves_what_moves(scene):
    _, pair, channels, board = scene
    road = pair.valid & (channels["fall"] > 20) & ~board  # a cosine of 0.3 to straight down
    left = {name: np.abs(channels[name])[road].mean() for name in ("rotated_difference", "road_difference")}
    assert left["road_difference"] < 0.5 * left["rotated_difference"]
    for name in ("epipolar", "road_difference"):
        assert np.abs(channels[name])[board].mean() > 3 * np.abs(channels[name])[road].mean(), name


def test_channels_that_change_sign_in_a_mirror_are_listed(scene):
    _, _, channels, _ = scene
    left, right = (slice(60, 200), slice(40, 140)), (slice(60, 200), slice(180, 280))
    signed = [name for name in ALL_CHANNELS if channels[name][left].mean() * channels[name][right].mean() < -25]
    assert set(signed) <= set(MIRRORED)
    assert "parallax_u" in signed


def test_without_motion_there_are_images_only(scene):
    given, _, _, _ = scene
    bare = working_pair(replace(given, current_from_previous=()))
    assert network_input(bare, CHANNELS["images"]).shape[0] == 4
    with pytest.raises(UnansweredImage, match="ego-motion"):
        network_input(bare, CHANNELS["geometry"])


def test_a_stationary_camera_measures_flow(scene):
    given, *_ = scene
    still = working_pair(replace(given, current_from_previous=(RigidTransform.identity(),)))
    channels = network_input(still, ("parallax_u", "parallax_v", "positive_depth", "epipolar")).astype(int) - ZERO
    assert not channels[:3].any()
    assert channels[3].max() > 20


# Mean and standard deviation, in bytes, of each channel of the scene as the shipped network was trained on it. Where a
# change of flow, motion or camera models moves them, the network must be trained anew, or at least scored anew.
TRAINED_ON = {
    "current": (128.0, 31.9),
    "previous": (128.0, 32.0),
    "difference": (128.0, 17.2),
    "valid": (160.0, 0.0),
    "rotated": (128.0, 32.0),
    "on_road": (128.1, 30.9),
    "rotated_difference": (128.0, 40.4),
    "road_difference": (128.2, 17.9),
    "angle": (210.2, 28.1),
    "fall": (136.4, 37.0),
    "road_parallax": (181.8, 52.1),
    "parallax_u": (128.0, 50.4),
    "parallax_v": (107.2, 41.5),
    "flow_u": (130.6, 23.6),
    "flow_v": (131.3, 7.7),
    "flow_difference": (128.0, 12.9),
    "epipolar": (131.0, 9.8),
    "positive_depth": (129.6, 11.3),
    "positive_height": (128.2, 1.5),
    "anti_parallel": (128.3, 2.9),
}


def test_channels_are_those_that_the_network_was_trained_on(scene):
    _, _, channels, _ = scene
    assert set(TRAINED_ON) == set(ALL_CHANNELS)
    for name, expected in TRAINED_ON.items():
        found = channels[name].mean() + ZERO, channels[name].std()
        assert found == pytest.approx(expected, abs=0.3), name
