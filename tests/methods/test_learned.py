"""The method `learned`: the network of the package runs, and whatever is wrong with its files is told."""

import hashlib
import json
import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest

from bench.errors import DataError, UsageError
from bench.methods import build_method
from bench.methods.learned import method as learned
from bench.methods.learned.inputs import Channels
from bench.methods.rigid_scene.scene import Views
from bench.recordings import load_card
from tests.conftest import DATASETS
from tests.support.board_scene import STEP, crossing, frame


@pytest.fixture
def weights(tmp_path):
    """A copy of the network of the package."""
    for suffix in (".onnx", ".json"):
        shutil.copy(learned.SHIPPED.with_suffix(suffix), tmp_path)
    return tmp_path / "learned.onnx"


def test_it_finds_a_board_that_crosses_and_answers_the_same_in_another_process():
    previous, current, board = crossing()
    method, given = build_method("learned"), frame(previous, current, STEP)
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


def test_large_images_are_answered_on_cells():
    small = frame(*crossing()[:2], STEP)
    large = replace(
        small,
        images=tuple(image.repeat(2, axis=0).repeat(2, axis=1) for image in small.images),
        valid=small.valid.repeat(2, axis=0).repeat(2, axis=1),
        camera=small.camera.scaled(1280, 960),
    )
    found = build_method("learned").segment(large)
    assert (found.cell_size_px, found.mask.shape) == (2, (480, 640))


def test_sides_that_are_no_multiple_of_32():
    method = build_method("learned")
    channels = learned.network_input(Views.of(frame(*crossing()[:2], STEP)), method.trained.coarse, method.trained.fine)
    odd = Channels(coarse=channels.coarse[:, :235, :309], fine=channels.fine[:, :471, :619])
    assert method.scores(odd).shape == (471, 619)


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


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"coarse": ["current", "taste"]}, "expected channels of this version, got taste"),
        ({"threshold": "high"}, r"learned\.json: threshold: expected a valid number"),
        ({"sha256": None}, r"learned\.json: sha256: expected a valid string"),
    ],
)
def test_a_card_that_does_not_fit(weights, changed, message):
    card = weights.with_suffix(".json")
    card.write_text(json.dumps(json.loads(card.read_text()) | changed))
    with pytest.raises(DataError, match=message):
        build_method("learned", {"weights": str(weights)})


def test_a_file_that_is_no_network(weights):
    weights.write_bytes(b"no network")
    card = weights.with_suffix(".json")
    digest = hashlib.sha256(b"no network").hexdigest()
    card.write_text(json.dumps(json.loads(card.read_text()) | {"sha256": digest}))
    method = build_method("learned", {"weights": str(weights)})
    with pytest.raises(DataError, match="expected an ONNX network"):
        method.segment(frame(*crossing()[:2], STEP))


def test_without_onnx_runtime_the_command_that_installs_it_is_named(monkeypatch):
    monkeypatch.setattr(learned, "onnxruntime", None)
    with pytest.raises(UsageError, match=r"pip install 'fisheye-bench\[learned\]'"):
        build_method("learned")


def test_a_threshold_is_a_score():
    with pytest.raises(UsageError, match=r"expected a number in \[0, 1\), got 1"):
        build_method("learned", {"threshold": 1})
