"""From deviations to the likelihood of motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from bench.errors import UsageError
from bench.methods.spherical.two_view import Deviations

CONSTRAINTS = ("epipolar", "positive_depth", "positive_height", "anti_parallel")


@dataclass(frozen=True, slots=True, kw_only=True)
class Weights:
    """Weights mu of the deviations; the defaults are the paper's, whose divisor is always 2.4.

    Raises:
        UsageError: a negative weight, or none that is positive.
    """

    epipolar: float = 1.0
    positive_depth: float = 1.0
    positive_height: float = 0.2
    anti_parallel: float = 0.2
    three_view: float = 0.0

    def __post_init__(self) -> None:
        if min(self.as_tuple()) < 0 or self.total <= 0:
            raise UsageError(f"weights: expected numbers >= 0 with at least one positive, got {self.as_tuple()}")

    @classmethod
    def from_numbers(cls, numbers: Sequence[float]) -> Weights:
        """From four or five numbers in the paper's order.

        Raises:
            UsageError: another number of them.
        """
        if len(numbers) not in {4, 5}:
            raise UsageError(f"weights: expected four or five numbers (e, d, h, p, 3v), got {len(numbers)}")
        return cls(**dict(zip((f.name for f in fields(cls)), map(float, numbers), strict=False)))

    def as_tuple(self) -> tuple[float, float, float, float, float]:
        """In the paper's order: e, d, h, p, 3v."""
        return self.epipolar, self.positive_depth, self.positive_height, self.anti_parallel, self.three_view

    @property
    def total(self) -> float:
        """The divisor of the weighted mean."""
        return float(sum(self.as_tuple()))


PAPER_WEIGHTS = Weights()
PAPER_THRESHOLD = 6e-4
# Above this angle the paper's method sees motion by the epipolar or the positive depth constraint alone; 0.24 px at 165
# px per radian. What is compared with the paper's method at one angle takes it from here.
PAPER_ANGLE_RAD = PAPER_THRESHOLD * PAPER_WEIGHTS.total


def alone(constraint: str, weight: float = 1.0) -> tuple[Weights, float]:
    """Weights of one constraint alone, and the threshold at which it marks what it marks alone in the paper's method.

    There a cell moves where `mu_i xi_i / 2.4 > 6e-4`. With a single weight of 1 the likelihood is xi_i itself, so the
    threshold becomes `6e-4 x 2.4 / mu_i`.

    Args:
        constraint: name of a field of `Weights`.
        weight: mu_i, its weight among the others.
    """
    none = dict.fromkeys((f.name for f in fields(Weights)), 0.0)
    return Weights(**none | {constraint: 1.0}), PAPER_ANGLE_RAD / weight


def motion_likelihood(
    deviations: Deviations,
    weights: Weights | Sequence[float],
    *,
    three_view: NDArray[np.float64] | None = None,
    root_sum: bool = False,
) -> NDArray[np.float64]:
    """Weighted mean of the deviations.

    Args:
        deviations: of any shape.
        weights: mu of each constraint, also as numbers in the paper's order e, d, h, p and, if there, 3v; the divisor
            is their whole sum, whichever constraints fire.
        three_view: xi_3v where tracks over three views exist; 0 is taken where it is NaN.
        root_sum: use hypot(mu_e xi_e, mu_d xi_d) in place of their sum, since both measure parts of one
            displacement; off in the paper.

    Returns:
        Motion likelihood xi, same shape, float64, 0 where not defined.

    Source:
        Mariotti and Eising, section III-H.
    """
    weights = weights if isinstance(weights, Weights) else Weights.from_numbers(weights)
    epipolar, depth = weights.epipolar * deviations.epipolar, weights.positive_depth * deviations.positive_depth
    likelihood = np.hypot(epipolar, depth) if root_sum else epipolar + depth
    likelihood += weights.positive_height * deviations.positive_height
    likelihood += weights.anti_parallel * deviations.anti_parallel
    if three_view is not None:
        likelihood += weights.three_view * np.nan_to_num(three_view, nan=0.0)
    likelihood /= weights.total
    return np.asarray(likelihood)


def largest_contribution(
    deviations: Deviations, weights: Weights, *, three_view: NDArray[np.float64] | None = None
) -> NDArray[np.uint8]:
    """Index into `CONSTRAINTS`, then `three_view`, of the largest weighted deviation; the first of equals."""
    parts = [getattr(weights, name) * getattr(deviations, name) for name in CONSTRAINTS]
    if three_view is not None:
        parts.append(weights.three_view * three_view)
    best, cause = parts[0], np.zeros(parts[0].shape, dtype=np.uint8)
    for index, part in enumerate(parts[1:], start=1):
        np.copyto(cause, np.uint8(index), where=part > best)
        best = np.fmax(best, part)
    return cause
