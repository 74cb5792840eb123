"""References of data that each machine renders anew: another processor may tip the last bit of a few points or pixels.

Two references are the same but for that where they have the same objects and images of the same status, and differ in
few pixels of each recording and in the bins of few object-frames. Then the metrics decide, not the digest.
"""

from __future__ import annotations

import pandas as pd

from bench.evaluation.definitions import COUNTS
from bench.evaluation.sums import ALL_MOVING, FRAMES, TERMS

PIXELS = 0.001  # share of a recording's reference pixels that may differ
REBINNED = 0.01  # share of all object-frames that may lie in another bin
BINNED = ("points", "range_m", "speed_mps", "class_and_speed", "ego_speed_mps")  # breakdowns by what is measured


def small_difference(pairs: pd.DataFrame) -> str:
    """Tell in what two references differ; "" where it is more than another processor accounts for.

    Args:
        pairs: sums of the baseline and of the run, as `pair_sums` gives them.
    """
    breakdown, metric = pairs["breakdown"], pairs["metric"]
    above, below = (abs(pairs[f"{term}_after"] - pairs[f"{term}_before"]) for term in TERMS)
    if (above + below)[metric.isin(COUNTS) & ~breakdown.isin(BINNED)].any():
        return ""
    pixels = (metric == "recall") & (breakdown == FRAMES)  # its cases are the pixels of the reference
    share = (below / pairs["denominator_before"])[pixels & (below > 0)].max()
    object_frames = pairs["denominator_before"][(metric == "tracks") & (breakdown == ALL_MOVING)].sum()
    rebinned = max(below[(metric == "tracks") & (breakdown == name)].sum() / 2 for name in BINNED)
    if share > PIXELS or rebinned > REBINNED * object_frames:
        return ""
    differing = f"{(below[pixels] > 0).sum()} of {pixels.sum()} recordings"
    return (
        f"as of data rendered on another processor: reference pixels differ in {differing}, by at most "
        f"{0 if pd.isna(share) else 100 * share:.2g} %, and {rebinned:.0f} of {object_frames:.0f} object-frames lie in "
        "another bin; the metrics decide"
    )
