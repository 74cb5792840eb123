"""Share whole pixels in proportion, so that they stay whole and their sum stays exact."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def share_in_proportion(amounts: NDArray[np.int64], *, weights: NDArray[np.int64]) -> NDArray[np.int64]:
    """Give each amount to the columns of its row in proportion to their weights, by largest remainder.

    Equal remainders are served from the first column on; rows without any weight give nothing.

    Args:
        amounts: (R,) int64, >= 0.
        weights: (R, K) int64, >= 0.

    Returns:
        shares: (K,) int64; they sum to the amounts of the rows with weight.

    Example:
        7 pixels over weights (1, 1, 1): 3, 2, 2.
    """
    rows = (amounts > 0) & weights.any(axis=1)
    amount, weight = amounts[rows, None], weights[rows]
    total = weight.sum(axis=1, keepdims=True)
    whole, remainder = np.divmod(amount * weight, np.maximum(total, 1))
    left = amount - whole.sum(axis=1, keepdims=True)
    # A stable sort leaves equal remainders in the order of the columns.
    rank = np.argsort(np.argsort(-remainder, axis=1, kind="stable"), axis=1, kind="stable")
    shares: NDArray[np.int64] = (whole + (rank < left)).sum(axis=0, dtype=np.int64)
    return shares
