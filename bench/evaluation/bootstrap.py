"""Confidence intervals that take recordings, not frames, as independent."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95


def sequence_weights(sequences: int, *, draws: int, seed: int) -> NDArray[np.int64]:
    """Draw sequences with replacement, once for all figures, so that figures and methods can be compared in pairs.

    Args:
        sequences: how many there are.
        draws: how many times to resample.
        seed: of the generator.

    Returns:
        (draws, sequences) int64, how often each sequence was drawn; every row sums to `sequences`.
    """
    if sequences == 0:
        return np.zeros((draws, 0), dtype=np.int64)
    generator = np.random.default_rng(seed)
    return generator.multinomial(sequences, np.full(sequences, 1 / sequences), size=draws)


def cluster_interval(
    numerators: NDArray[np.float64], denominators: NDArray[np.float64], *, weights: NDArray[np.int64]
) -> tuple[float, float] | None:
    """Percentile interval of sum(numerators) / sum(denominators) over resampled sequences.

    Args:
        numerators: (S,) float64, sum of each sequence.
        denominators: (S,) float64, sum of each sequence, >= 0; 0 where the sequence holds no case.
        weights: (draws, S) int64, from `sequence_weights`.

    Returns:
        Lower and upper end of the 95 % interval; None where fewer than two sequences hold cases. Draws without any case
        (0/0) are left out.

    Source:
        Percentile method, Efron and Tibshirani 1993, An Introduction to the Bootstrap, section 13.3.
    """
    used = denominators > 0
    if np.count_nonzero(used) < 2:
        return None
    # Not `@`: sums of matrix products may change in the last bit with the number of threads.
    numerator = np.einsum("ds,s->d", weights[:, used], numerators[used])
    denominator = np.einsum("ds,s->d", weights[:, used], denominators[used])
    drawn = denominator > 0
    return percentile_interval(numerator[drawn] / denominator[drawn])


def percentile_interval(drawn: NDArray[np.float64]) -> tuple[float, float]:
    """The 95 % percentile interval of a figure that was taken on every draw: (draws,) float64, at least one."""
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(drawn, [tail, 1 - tail])
    return float(low), float(high)
