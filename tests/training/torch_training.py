"""Training on PyTorch: call it by its name, `pytest tests/training/torch_training.py`, with the extra `train`.

It is no part of the other tests, since PyTorch takes a gigabyte; a job of its own runs it on CI.
"""

import json
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
import torch

from bench.errors import UsageError
from bench.methods import build_method
from bench.methods.learned.inputs import COARSE, FINE, GROUPS, Channels
from bench.training.network import MotionNetwork, begin_with
from bench.training.pairs import prepare
from bench.training.train import SMALL_WEIGHT, Batches, Plan, export, loss_of, small_weight, train

PLAN = Plan(epochs=2, batch=4, crop_px=(96, 128))  # the tiny images are half as large as those of the training data


@pytest.fixture(scope="module")
def drives(tiny_card, tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    return prepare(tiny_card, "all", folder, disturbed=True, workers=1, progress=lambda *_: None)


@pytest.fixture(scope="module")
def trained(drives, tmp_path_factory):
    out = tmp_path_factory.mktemp("trained")
    return out, train(PLAN, drives, drives[:1], out)


@pytest.mark.parametrize("without", [(), ("fine",), ("earlier",), ("scene", "constraints")])
def test_the_network_is_small_and_answers_at_the_fine_size(without):
    plan = replace(PLAN, without=without)
    assert not {*plan.coarse, *plan.fine} & {name for group in without for name in GROUPS[group]}
    network = MotionNetwork(len(plan.coarse), len(plan.fine))
    assert sum(parameter.numel() for parameter in network.parameters()) <= 1_000_000
    coarse = torch.zeros(2, len(plan.coarse), 48, 64, dtype=torch.uint8)
    fine = torch.zeros(2, len(plan.fine), 96, 128, dtype=torch.uint8)
    assert network(coarse, fine).shape == (2, 96, 128)


def test_batches_follow_from_seed_epoch_and_losses(drives):
    batches = Batches(drives, PLAN)
    same, hard = np.ones(batches.images), np.ones(batches.images)
    hard[2] = 1e9
    first, again, other = (next(batches.epoch(number, same)) for number in (0, 0, 1))
    rows, columns = PLAN.crop_px
    assert first.coarse.shape == (4, len(COARSE), rows, columns)
    assert first.fine.shape == (4, len(FINE), 2 * rows, 2 * columns)
    assert first.target.shape == first.weight.shape == (4, 2 * rows, 2 * columns)
    assert torch.equal(first.fine, again.fine)
    assert not torch.equal(first.fine, other.fine)
    drawn = np.concatenate([next(batches.epoch(number, hard)).images for number in range(20)])
    assert (drawn == 2).mean() == pytest.approx(0.5, abs=0.2)


def test_mirrored_crops_change_the_sign_of_what_points_sideways(drives):
    batches, row = Batches(drives, PLAN), COARSE.index("parallax_u")
    whole = drives[0].coarse()[0][row].astype(int) - 128
    assert whole[50:100, 20:70].mean() * whole[50:100, 90:140].mean() < 0
    sides = {
        np.sign(float(crop[row, :, :30].float().mean() - crop[row, :, -30:].float().mean()))
        for epoch in range(8)
        for batch in batches.epoch(epoch, np.ones(batches.images))
        for crop in batch.coarse
    }
    assert len(sides - {0.0}) == 1  # mirrored or not, points on the left move as points on the left do


def test_crops_of_strange_contrast_move_as_they_did(drives, monkeypatch):
    batches, grey, crops = Batches(drives, PLAN), COARSE.index("current"), []
    for share in (0.0, 1.0):
        monkeypatch.setattr("bench.training.train.STRANGE", share)
        drawn = [next(batches.epoch(epoch, np.ones(batches.images))).coarse.numpy() for epoch in range(8)]
        crops.append(np.concatenate(drawn))
    usual, strange = crops
    np.testing.assert_array_equal(np.delete(usual, grey, 1), np.delete(strange, grey, 1))
    looks = (part[:, grey].reshape(len(part), -1) for part in crops)
    slopes = [np.polyfit(*pair, 1)[0] for pair in zip(*looks, strict=True)]
    assert min(slopes) < -0.5
    assert max(slopes) > 0.5
    assert np.abs(slopes).min() < 0.2


def test_small_objects_weigh_more():
    target = np.zeros((200, 200), np.uint8)
    target[10:14, 10:14] = target[50:150, 50:150] = 255
    weights = small_weight(target)
    assert (weights[0, 0], weights[100, 100], weights[12, 12]) == (1, 1, SMALL_WEIGHT)


def test_the_loss_is_least_where_everything_is_right():
    target = torch.zeros(1, 96, 96)
    target[0, 24:56, 24:56] = 1
    right, wrong = 20 * (2 * target - 1), torch.zeros_like(target)
    valid = torch.ones_like(target)
    assert loss_of(right, target, valid) < 1e-3 < loss_of(wrong, target, valid)
    outside = valid.clone()
    outside[0, 72:] = 0
    spoiled = right.clone()
    spoiled[0, 72:] = 20
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
    assert {path.name for path in out.iterdir()} >= {"checkpoint.pt", "log.csv"}
    with pytest.raises(UsageError, match="use a new --out"):
        train(replace(PLAN, seed=9), *held, out)
    with pytest.raises(UsageError, match=r"expected the plan .*'images': 6}, got .*'images': 9}; use a new --out"):
        train(PLAN, drives[:2], drives[:1], out)


def test_what_is_exported_answers_as_the_network_does(drives, trained, tmp_path):
    _, (network, found, log) = trained
    export(network, PLAN, found, log, provenance={"dataset": "tiny"}, out=tmp_path)
    card = json.loads((tmp_path / "learned.json").read_text())
    assert (card["coarse"], card["fine"]) == (list(COARSE), list(FINE))
    method = build_method("bench.methods.learned.method:LearnedMethod", {"weights": str(tmp_path / "learned.onnx")})
    channels = Channels(coarse=drives[0].coarse()[0][:, :112], fine=drives[0].fine()[0][:-1, :224])  # multiples of 16
    with torch.no_grad():
        given = (torch.from_numpy(part[None].copy()) for part in (channels.coarse, channels.fine))
        expected = torch.sigmoid(network(*given))[0].numpy()
    np.testing.assert_allclose(method.scores(channels), expected, atol=1e-4)


def test_training_begins_with_the_answers_of_an_exported_network(drives, tmp_path):
    less = replace(PLAN, epochs=1, without=("scene",))
    exported, *reached = train(less, drives, drives[:1], tmp_path)
    export(exported, less, *reached, provenance={}, out=tmp_path)
    batches = Batches(drives, PLAN)
    crops, unseen = islice(batches.epoch(0, np.ones(batches.images)), 2)
    network = MotionNetwork(len(COARSE), len(FINE))
    shown = {"coarse": COARSE, "fine": FINE}
    begin_with(network, tmp_path / "learned.onnx", shown, (crops.coarse, crops.fine))
    seen = [COARSE.index(name) for name in less.coarse]
    with torch.no_grad():
        expected = exported(unseen.coarse[:, seen], unseen.fine)
        torch.testing.assert_close(network(unseen.coarse, unseen.fine), expected, atol=1e-3, rtol=1e-3)
        begun = [norm for norm in network.modules() if isinstance(norm, torch.nn.BatchNorm2d)]
        assert min(norm.weight.min() for norm in begun) > 0  # normalised by what they answer
    with pytest.raises(UsageError, match="expected channels that the network is shown, got earlier_road"):
        begin_with(network, tmp_path / "learned.onnx", shown | {"coarse": less.coarse[:-2]}, (crops.coarse, crops.fine))
