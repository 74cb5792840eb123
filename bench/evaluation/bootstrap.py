"""Confidence intervals that take recordings, not frames, as independent."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95
_MANTISSA_BITS = 52


@lru_cache(maxsize=4)
def sequence_weights(sequences: int, *, draws: int, seed: int) -> NDArray[np.float64]:
    """Draw sequences with replacement, once for all figures, so that figures and methods can be compared in pairs.

    Args:
        sequences: how many there are.
        draws: how many times to resample.
        seed: of the generator.

    Returns:
        (draws, sequences) float64, read-only, how often each sequence was drawn, whole numbers; every row sums to
        `sequences`.
    """
    weights = np.zeros((draws, sequences))
    if sequences:
        generator = np.random.default_rng(seed)
        weights[:] = generator.multinomial(sequences, np.full(sequences, 1 / sequences), size=draws)
    weights.setflags(write=False)
    return weights


def resample(sums: NDArray[np.float64], *, weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """The total of every draw, the same to the last bit on every machine and with any number of threads.

    Sums of matrix products are rounded in an order that nobody promises. So each number is split into two whole ones,
    short enough for their products to add up without rounding.

    Args:
        sums: (S,) float64, finite.
        weights: (draws, S) float64, from `sequence_weights`.

    Returns:
        (draws,) float64.
    """
    bits = _MANTISSA_BITS - int(weights.shape[1]).bit_length()
    _, exponent = np.frexp(np.abs(sums).max(initial=0.0))
    scaled = np.ldexp(sums, bits - exponent)
    high = np.floor(scaled)
    low = np.rint(np.ldexp(scaled - high, bits))
    totals = weights @ np.stack([high, low], axis=1)
    found: NDArray[np.float64] = np.ldexp(totals[:, 0], exponent - bits) + np.ldexp(totals[:, 1], exponent - 2 * bits)
    return found


def cluster_interval(
    numerators: NDArray[np.float64], denominators: NDArray[np.float64], *, weights: NDArray[np.float64]
) -> tuple[float, float] | None:
    """Percentile interval of sum(numerators) / sum(denominators) over resampled sequences.

    Args:
        numerators: (S,) float64, sum of each sequence; 0 where the sequence holds no case.
        denominators: (S,) float64, sum of each sequence, >= 0; 0 where the sequence holds no case.
        weights: (draws, S) float64, from `sequence_weights`.

    Returns:
        Lower and upper end of the 95 % interval; None where fewer than two sequences hold cases. Draws without any case
        (0/0) are left out.

    Source:
        Percentile method, Efron and Tibshirani 1993, An Introduction to the Bootstrap, section 13.3.
    """
    if np.count_nonzero(denominators > 0) < 2:
        return None
    numerator, denominator = (resample(sums, weights=weights) for sums in (numerators, denominators))
    drawn = denominator > 0
    return percentile_interval(numerator[drawn] / denominator[drawn])


def percentile_interval(drawn: NDArray[np.float64]) -> tuple[float, float]:
    """The 95 % percentile interval of a figure that was taken on every draw: (draws,) float64, at least one."""
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(drawn, [tail, 1 - tail])
    return float(low), float(high)
