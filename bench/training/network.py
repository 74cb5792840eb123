"""The network of the method `learned`: a small encoder-decoder over channels of bytes of two sizes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import pixel_shuffle, relu

from bench.errors import UsageError
from bench.methods.learned.inputs import ZERO
from bench.methods.learned.method import MULTIPLE_PX, read_card

FIRST_WIDTH = 16  # channels at the size of geometry and flow; multiples of 16 are what processors compute at once
WIDTHS = (32, 48, 64, 96)  # channels at a half, a quarter, an eighth and a sixteenth of it
DILATIONS = (1, 2, 4)  # at the coarsest size, so that a vehicle beside the camera is seen as a whole
FEW = -3.0  # bias of the head's logits: few pixels move

assert 2 ** (len(WIDTHS) + 1) == MULTIPLE_PX


def _linear(before: int, after: int, *, stride: int = 1, dilation: int = 1, side: int = 3) -> nn.Sequential:
    padding = dilation * (side // 2)
    return nn.Sequential(
        nn.Conv2d(before, after, side, stride=stride, padding=padding, dilation=dilation, bias=False),
        nn.BatchNorm2d(after),
    )


def _convolved(before: int, after: int, *, stride: int = 1, dilation: int = 1) -> nn.Sequential:
    return nn.Sequential(*_linear(before, after, stride=stride, dilation=dilation), nn.ReLU(inplace=True))


def _about_zero(values: Tensor) -> Tensor:
    """Bytes as numbers; their scale is nothing to a network that normalises, and 16 bits hold them, too."""
    kind = torch.bfloat16 if torch.is_autocast_enabled(values.device.type) else torch.float32
    return values.to(kind) - ZERO


class _Joined(nn.Module):
    """Two images of channels to one, of the size of the second.

    Each is brought to as many channels by itself: much less to compute than to spread the first one and stack both.

    Args:
        one: channels of the first image.
        other: channels of the second.
        after: channels of the answer.
        spread: by so much the first is smaller.
    """

    def __init__(self, one: int, other: int, after: int, *, spread: int = 1) -> None:
        super().__init__()
        self.one, self.other = _linear(one, after, side=1), _linear(other, after, side=1)
        self.spread = nn.Upsample(scale_factor=spread) if spread > 1 else nn.Identity()
        self.both = _convolved(after, after)

    def forward(self, one: Tensor, other: Tensor) -> Tensor:
        return self.both(relu(self.spread(self.one(one)) + self.other(other)))


class MotionNetwork(nn.Module):
    """Logits of motion at the size of the fine channels.

    The fine channels are brought down to the size of the coarse ones and joined with them. Four levels follow, each
    half as large as the one before; on the way up each is joined with what was seen on the way down. The last step is
    by shuffling: four channels are the four fine pixels of a coarse one.

    Args:
        coarse: channels of the size of geometry and flow.
        fine: channels of twice that size.
    """

    def __init__(self, coarse: int, fine: int) -> None:
        super().__init__()
        self.fine = _convolved(fine, FIRST_WIDTH, stride=2)
        self.stem = _Joined(coarse, FIRST_WIDTH, FIRST_WIDTH)
        widths = (FIRST_WIDTH, *WIDTHS)
        self.down = nn.ModuleList(
            nn.Sequential(_convolved(a, b, stride=2), _convolved(b, b)) for a, b in zip(widths, WIDTHS, strict=False)
        )
        self.context = nn.Sequential(*(_convolved(WIDTHS[-1], WIDTHS[-1], dilation=rate) for rate in DILATIONS))
        self.up = nn.ModuleList(_Joined(a, b, b, spread=2) for a, b in zip(widths[:0:-1], widths[-2::-1], strict=True))
        self.head = nn.Conv2d(FIRST_WIDTH, 4, 1)
        nn.init.constant_(self.head.bias, FEW)

    def forward(self, coarse: Tensor, fine: Tensor) -> Tensor:
        """(N, C, h, w) and (N, F, 2h, 2w) uint8, h and w multiples of 16 -> (N, 2h, 2w) float32."""
        values = self.stem(_about_zero(coarse), self.fine(_about_zero(fine)))
        seen = [values]
        for level in self.down:
            values = level(values)
            seen.append(values)
        values = values + self.context(values)
        for level, finer in zip(self.up, seen[-2::-1], strict=True):
            values = level(values, finer)
        return pixel_shuffle(self.head(values), 2)[:, 0].float()


class ScoredNetwork(nn.Module):
    """Network for export: scores in [0, 1] instead of logits."""

    def __init__(self, network: MotionNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, coarse: Tensor, fine: Tensor) -> Tensor:
        """Scores, (N, 2h, 2w) float32, from the inputs of `MotionNetwork`."""
        return torch.sigmoid(self.network(coarse, fine))


def begin_with(
    network: MotionNetwork, file: Path, shown: Mapping[str, Sequence[str]], crops: tuple[Tensor, Tensor]
) -> None:
    """Give a network the weights of an exported one, so that it answers as that one does.

    Channels that the exported one does not take weigh 0. An exported convolution holds the normalisation that followed
    it. This is made again from mean and spread of what the convolution answers on the crops.

    Args:
        network: gets the weights.
        file: `learned.onnx`, its card beside it.
        shown: "coarse" and "fine" -> names of the channels of the network.
        crops: coarse and fine channels, as `MotionNetwork.forward` takes them.

    Raises:
        UsageError: the file holds other layers, or takes a channel that the network is not shown.
        DataError: file or card are damaged.
    """
    card = read_card(file)
    if unknown := {*card.coarse, *card.fine} - {*shown["coarse"], *shown["fine"]}:
        raise UsageError(f"{file}: expected channels that the network is shown, got {', '.join(sorted(unknown))}")
    modules = dict(network.named_modules())
    first = {
        "stem.one.0": [shown["coarse"].index(name) for name in card.coarse],
        "fine.0": [shown["fine"].index(name) for name in card.fine],
    }
    hooks = []
    for path, weight, bias in _convolutions(file):
        convolution = modules.get(path)
        given = torch.from_numpy(weight)
        if path in first and isinstance(convolution, nn.Conv2d):
            given = torch.zeros(len(weight), *convolution.weight.shape[1:])
            given[:, first[path]] = torch.from_numpy(weight)
        if not isinstance(convolution, nn.Conv2d) or convolution.weight.shape != given.shape:
            raise UsageError(f"{file}: expected layers of this network, got {path} of shape {weight.shape}")
        convolution.weight.data = given
        if convolution.bias is not None:
            convolution.bias.data = torch.from_numpy(bias)
            continue
        norm = modules[f"{path.rpartition('.')[0]}.1"]
        norm.bias.data = torch.from_numpy(bias)
        hooks.append(norm.register_forward_pre_hook(_normalise_as_given))
    with torch.no_grad():
        network.eval()(*crops)
    for hook in hooks:
        hook.remove()


def _normalise_as_given(norm: nn.BatchNorm2d, given: tuple[Tensor]) -> None:
    """Take mean and spread from what a normalisation is given, and let it pass on just that, with its bias added."""
    variance, mean = torch.var_mean(given[0], (0, 2, 3))
    norm.running_mean.copy_(mean)
    norm.running_var.copy_(variance)
    norm.weight.data = torch.sqrt(variance + norm.eps)
    norm.bias.data += mean


def _convolutions(file: Path) -> Iterator[tuple[str, NDArray[np.float32], NDArray[np.float32]]]:
    """Module, weights and biases of each convolution of an exported network."""
    graph = onnx.load(file).graph
    values = {value.name: onnx.numpy_helper.to_array(value).copy() for value in graph.initializer}
    for node in graph.node:
        if node.op_type == "Conv":
            # "/network/up.0/one/one.0/Conv" is up.0.one.0, "/network/fine/fine.0/Conv" is fine.0.
            outer, inner = node.name.split("/")[2], node.name.split("/")[-2]
            yield inner if inner.startswith(outer) else f"{outer}.{inner}", *(values[name] for name in node.input[1:])
