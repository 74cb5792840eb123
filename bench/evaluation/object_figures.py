"""The figures of one row of the paper's table, over evaluated object-frames."""

from __future__ import annotations

import numpy as np

from bench.evaluation.ratios import ratio_figure
from bench.evaluation.slice_sums import SliceSums
from bench.evaluation.summary import ObjectFigures
from bench.evaluation.terms import OBJECT_RATIOS, level_ratios


def object_figures(sums: SliceSums, *, levels: tuple[float, ...]) -> dict[str, ObjectFigures]:
    """Take the figures of every slice of a split.

    Args:
        sums: over the evaluated object-frames.
        levels: detection levels of the protocol.
    """
    ratios = OBJECT_RATIOS | level_ratios(levels)
    return {
        name: ObjectFigures(
            object_frames=int(sums.rows[:, place].sum()),
            tracks=int(sums.tracks[:, place].sum()),
            recordings=int(np.count_nonzero(sums.rows[:, place])),
            **{figure: ratio_figure(sums, place, ratio) for figure, ratio in ratios.items()},
        )
        for place, name in enumerate(sums.names)
    }
