"""Each two-view constraint alone: what the method sees by it and by nothing else.

The flow, the cells and the branch for a standing camera are the method's own. A constraint's threshold is the one that
it has among the others (see `alone`), so these masks are parts of the method's mask.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bench.methods.spherical.likelihood import PAPER_WEIGHTS, Weights, alone
from bench.methods.spherical.method import SphericalMethod

_EPIPOLAR = alone("epipolar", PAPER_WEIGHTS.epipolar)
_POSITIVE_DEPTH = alone("positive_depth", PAPER_WEIGHTS.positive_depth)
_POSITIVE_HEIGHT = alone("positive_height", PAPER_WEIGHTS.positive_height)
_ANTI_PARALLEL = alone("anti_parallel", PAPER_WEIGHTS.anti_parallel)


@dataclass(frozen=True, kw_only=True)
class EpipolarOnly(SphericalMethod):
    """The epipolar constraint alone; scale-free, blind to motion along the host's own."""

    name: ClassVar[str] = "epipolar-only"
    weights: Weights = _EPIPOLAR[0]
    threshold: float = _EPIPOLAR[1]


@dataclass(frozen=True, kw_only=True)
class PositiveDepthOnly(SphericalMethod):
    """The positive depth constraint alone; scale-free, sees what is faster than the host."""

    name: ClassVar[str] = "positive-depth-only"
    weights: Weights = _POSITIVE_DEPTH[0]
    threshold: float = _POSITIVE_DEPTH[1]


@dataclass(frozen=True, kw_only=True)
class PositiveHeightOnly(SphericalMethod):
    """The positive height constraint alone; needs scale, sees what would lie below the road."""

    name: ClassVar[str] = "positive-height-only"
    weights: Weights = _POSITIVE_HEIGHT[0]
    threshold: float = _POSITIVE_HEIGHT[1]


@dataclass(frozen=True, kw_only=True)
class AntiParallelOnly(SphericalMethod):
    """The anti-parallel constraint alone; needs scale, sees what comes nearer than the road behind it allows."""

    name: ClassVar[str] = "anti-parallel-only"
    weights: Weights = _ANTI_PARALLEL[0]
    threshold: float = _ANTI_PARALLEL[1]
