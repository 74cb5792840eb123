"""The network of the method `learned`: a small encoder-decoder over channels of bytes."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, pixel_shuffle

from bench.methods.learned.inputs import ZERO
from bench.methods.learned.method import MULTIPLE_PX

WIDTHS = (24, 32, 48, 64)  # channels at a half, a quarter, an eighth and a sixteenth of the working size
DILATIONS = (1, 2, 4)  # at the coarsest size, so that a vehicle beside the camera is seen as a whole
BYTE_STEPS = 32.0

assert 2 ** len(WIDTHS) == MULTIPLE_PX


def _convolved(before: int, after: int, *, stride: int = 1, dilation: int = 1, side: int = 3) -> nn.Sequential:
    padding = dilation * (side // 2)
    return nn.Sequential(
        nn.Conv2d(before, after, side, stride=stride, padding=padding, dilation=dilation, bias=False),
        nn.BatchNorm2d(after),
        nn.ReLU(inplace=True),
    )


class MotionNetwork(nn.Module):
    """Logits of motion at the working size.

    Four levels, each half as large as the one before; on the way up each is joined with what was seen on the way down.
    The last step is by shuffling: four channels at half the size are the four pixels of the whole.

    Args:
        channels: of the input.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        before = (channels, *WIDTHS[:-1])
        self.down = nn.ModuleList(
            nn.Sequential(_convolved(a, b, stride=2), _convolved(b, b)) for a, b in zip(before, WIDTHS, strict=True)
        )
        self.context = nn.Sequential(*(_convolved(WIDTHS[-1], WIDTHS[-1], dilation=rate) for rate in DILATIONS))
        finer = WIDTHS[-2::-1]
        self.joined = nn.ModuleList(
            nn.Sequential(_convolved(a + b, b, side=1), _convolved(b, b))
            for a, b in zip(WIDTHS[:0:-1], finer, strict=True)
        )
        self.head = nn.Conv2d(WIDTHS[0], 4, 1)
        nn.init.constant_(self.head.bias, -3.0)  # few pixels move

    def forward(self, given: Tensor) -> Tensor:
        """(N, C, h, w) uint8, h and w multiples of 16 -> (N, h, w) float32."""
        values = (given.float() - ZERO) / BYTE_STEPS
        seen = []
        for level in self.down:
            values = level(values)
            seen.append(values)
        values = values + self.context(values)
        for level, finer in zip(self.joined, seen[-2::-1], strict=True):
            values = level(torch.cat([interpolate(values, scale_factor=2.0, mode="nearest"), finer], dim=1))
        return pixel_shuffle(self.head(values), 2)[:, 0].float()


class ScoredNetwork(nn.Module):
    """Network for export: scores in [0, 1] instead of logits."""

    def __init__(self, network: MotionNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, channels: Tensor) -> Tensor:
        """(N, C, h, w) uint8 -> (N, h, w) float32."""
        return torch.sigmoid(self.network(channels))
