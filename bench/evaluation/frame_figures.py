"""False positives and the usual segmentation figures, over scored image-frames."""

from __future__ import annotations

import numpy as np

from bench.evaluation.ratios import ratio_figure
from bench.evaluation.slice_sums import SliceSums
from bench.evaluation.summary import FalsePositiveFigures, Figure, SegmentationFigures
from bench.evaluation.terms import CAUSE, FALSE_POSITIVE_RATIOS, SEGMENTATION_RATIOS


def false_positive_figures(sums: SliceSums) -> dict[str, FalsePositiveFigures]:
    """Take the false-positive figures of every slice of a split.

    Args:
        sums: over the scored image-frames.
    """
    return {
        name: FalsePositiveFigures(
            frames=int(sums.rows[:, place].sum()),
            recordings=int(np.count_nonzero(sums.rows[:, place])),
            **{figure: ratio_figure(sums, place, ratio) for figure, ratio in FALSE_POSITIVE_RATIOS.items()},
        )
        for place, name in enumerate(sums.names)
    }


def segmentation_figures(sums: SliceSums) -> SegmentationFigures:
    """Take the figures of the moving class from summed counts of all images; what lies in I is in none of them."""
    return SegmentationFigures(**{name: ratio_figure(sums, 0, ratio) for name, ratio in SEGMENTATION_RATIOS.items()})


def false_positive_causes(sums: SliceSums) -> dict[str, Figure]:
    """Share of the false-positive pixels by the cause that the method names, by name; empty if it names none."""
    names = sorted(name.removeprefix(CAUSE) for name in sums.terms if name.startswith(CAUSE))
    return {name: ratio_figure(sums, 0, (CAUSE + name, "fp")) for name in names}
