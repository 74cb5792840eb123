"""The network of the method `learned`: a small encoder-decoder over channels of bytes of two sizes."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, pixel_shuffle

from bench.methods.learned.inputs import ZERO
from bench.methods.learned.method import MULTIPLE_PX

FIRST_WIDTH = 16  # channels at the size of geometry and flow; multiples of 16 are what processors compute at once
WIDTHS = (32, 48, 64, 96)  # channels at a half, a quarter, an eighth and a sixteenth of it
DILATIONS = (1, 2, 4)  # at the coarsest size, so that a vehicle beside the camera is seen as a whole
BYTE_STEPS = 32.0

assert 2 ** (len(WIDTHS) + 1) == MULTIPLE_PX


def _convolved(before: int, after: int, *, stride: int = 1, dilation: int = 1, side: int = 3) -> nn.Sequential:
    padding = dilation * (side // 2)
    return nn.Sequential(
        nn.Conv2d(before, after, side, stride=stride, padding=padding, dilation=dilation, bias=False),
        nn.BatchNorm2d(after),
        nn.ReLU(inplace=True),
    )


class MotionNetwork(nn.Module):
    """Logits of motion at the size of the fine channels.

    The fine channels are brought down to the size of the coarse ones and joined with them. Four levels follow, each
    half as large as the one before; on the way up each is joined with what was seen on the way down. The last step is
    by shuffling: four channels are the four fine pixels of a coarse one.

    Args:
        coarse: channels of the size of geometry and flow.
        fine: channels of twice that size; may be none.
    """

    def __init__(self, coarse: int, fine: int) -> None:
        super().__init__()
        self.fine = _convolved(fine, FIRST_WIDTH, stride=2) if fine else None
        self.stem = nn.Sequential(
            _convolved(coarse + FIRST_WIDTH * bool(fine), FIRST_WIDTH, side=1), _convolved(FIRST_WIDTH, FIRST_WIDTH)
        )
        before = (FIRST_WIDTH, *WIDTHS[:-1])
        self.down = nn.ModuleList(
            nn.Sequential(_convolved(a, b, stride=2), _convolved(b, b)) for a, b in zip(before, WIDTHS, strict=True)
        )
        self.context = nn.Sequential(*(_convolved(WIDTHS[-1], WIDTHS[-1], dilation=rate) for rate in DILATIONS))
        finer = (*WIDTHS[-2::-1], FIRST_WIDTH)
        self.joined = nn.ModuleList(
            nn.Sequential(_convolved(a + b, b, side=1), _convolved(b, b))
            for a, b in zip(WIDTHS[::-1], finer, strict=True)
        )
        self.head = nn.Conv2d(FIRST_WIDTH, 4, 1)
        nn.init.constant_(self.head.bias, -3.0)  # few pixels move

    def forward(self, coarse: Tensor, fine: Tensor) -> Tensor:
        """(N, C, h, w) and (N, F, 2h, 2w) uint8, h and w multiples of 16 -> (N, 2h, 2w) float32."""
        values = (coarse.float() - ZERO) / BYTE_STEPS
        both = (
            values if self.fine is None else torch.cat([values, self.fine((fine.float() - ZERO) / BYTE_STEPS)], dim=1)
        )
        values = self.stem(both)
        seen = [values]
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

    def forward(self, coarse: Tensor, fine: Tensor) -> Tensor:
        """As of `MotionNetwork`."""
        return torch.sigmoid(self.network(coarse, fine))
