"""Training on PyTorch: call it by its name, `pytest tests/training/torch_training.py`, with the extra `train`.

It is no part of the other tests, since PyTorch takes a gigabyte; a job of its own runs it on CI.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from bench.errors import UsageError
from bench.methods import build_method
from bench.methods.learned.inputs import ALL_CHANNELS, CHANNELS, INPUT_SETS, MIRRORED
from bench.training.network import MotionNetwork
from bench.training.prepared import prepare
from bench.training.train import CROP_PX, Batches, Plan, export, loss_of, train

PLAN = Plan(epochs=2, batch=4, inputs="likelihood")


@pytest.fixture(scope="module")
def drives(tiny_card, tmp_path_factory):
    return prepare(tiny_card, "all", tmp_path_factory.mktemp("inputs"), workers=1, progress=lambda *_: None)


@pytest.fixture(scope="module")
def trained(drives, tmp_path_factory):
    out = tmp_path_factory.mktemp("trained")
    return out, train(PLAN, drives, drives[:1], out)


@pytest.mark.parametrize("inputs", INPUT_SETS)
def test_the_network_is_small_and_keeps_the_size(inputs):
    network = MotionNetwork(len(CHANNELS[inputs]))
    assert sum(parameter.numel() for parameter in network.parameters()) <= 1_000_000
    assert network(torch.zeros(2, len(CHANNELS[inputs]), 48, 64, dtype=torch.uint8)).shape == (2, 48, 64)


def test_batches_follow_from_seed_and_epoch(drives):
    batches = Batches(drives, CHANNELS["likelihood"], PLAN)
    (first,), (again,), (other,) = (list(batches.epoch(number)) for number in (0, 0, 1))
    assert first.shape == (4, len(CHANNELS["likelihood"]) + 1, *CROP_PX)
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_mirrored_crops_change_the_sign_of_what_points_sideways(drives):
    channels = (*MIRRORED, "valid")
    batches = Batches(drives, channels, PLAN)
    whole = drives[0].arrays()[0][ALL_CHANNELS.index("parallax_u")].astype(int) - 128
    assert whole[100:200, 40:140].mean() * whole[100:200, 180:280].mean() < 0
    sides = {
        np.sign(float(crop[0, :, :60].float().mean() - crop[0, :, -60:].float().mean()))
        for epoch in range(8)
        for batch in batches.epoch(epoch)
        for crop in batch
    }
    assert len(sides - {0.0}) == 1  # mirrored or not, points on the left move as points on the left do


def test_the_loss_is_least_where_everything_is_right():
    target = torch.zeros(1, 16, 16)
    target[0, 4:8, 4:8] = 1
    right, wrong = 20 * (2 * target - 1), torch.zeros_like(target)
    valid = torch.ones_like(target)
    assert loss_of(right, target, valid) < 1e-3 < loss_of(wrong, target, valid)
    outside = valid.clone()
    outside[0, 12:] = 0
    spoiled = right.clone()
    spoiled[0, 12:] = 20
    assert loss_of(spoiled, target, outside) < 1e-3


def test_training_goes_on_where_it_was_interrupted(drives, trained, tmp_path):
    out, (whole, _, log) = trained
    held = (drives, drives[:1])
    rounds = []

    def stop_after_one(*_):
        rounds.append(1)
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("bench.training.train.write_log", stop_after_one)
        with pytest.raises(KeyboardInterrupt):
            train(PLAN, *held, tmp_path)
    continued, _, again = train(PLAN, *held, tmp_path)
    assert [line["epoch"] for line in again] == [line["epoch"] for line in log] == [1, 2]
    for one, other in zip(whole.parameters(), continued.parameters(), strict=True):
        assert torch.equal(one, other)
    assert {path.name for path in out.iterdir()} >= {"checkpoint.pt", "log.csv", "curves.png"}
    with pytest.raises(UsageError, match="use a new --out"):
        train(replace(PLAN, seed=9), *held, out)


def test_what_is_exported_answers_as_the_network_does(drives, trained, tmp_path):
    _, (network, found, log) = trained
    export(network, PLAN, found, log, provenance={"dataset": "tiny"}, out=tmp_path)
    card = json.loads((tmp_path / "learned.json").read_text())
    assert card["channels"] == list(CHANNELS["likelihood"])
    method = build_method("bench.methods.learned.method:LearnedMethod", {"weights": str(tmp_path / "learned.onnx")})
    channels = drives[0].arrays()[0][[ALL_CHANNELS.index(name) for name in CHANNELS["likelihood"]]]
    with torch.no_grad():
        expected = torch.sigmoid(network(torch.from_numpy(channels[None].copy())))[0].numpy()
    np.testing.assert_allclose(method.scores(channels), expected, atol=1e-4)
