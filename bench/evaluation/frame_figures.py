"""False positives and the usual segmentation figures, over scored image-frames."""

from __future__ import annotations

import numpy as np

from bench.evaluation.ratios import Cases, Rows
from bench.evaluation.summary import FalsePositiveFigures, Figure, SegmentationFigures


def false_positive_figures(cases: Cases, *, where: Rows) -> FalsePositiveFigures:
    """Take the false-positive figures of a slice.

    Args:
        cases: the scored image-frames.
        where: (N,) bool, the slice.

    Source:
        Mariotti and Eising 2020, section IV: false-positive area over the total area of the image.
    """
    fp_px, valid_px = cases.column("fp_px"), cases.column("valid_px")
    seeing = valid_px > 0
    return FalsePositiveFigures(
        frames=int(np.count_nonzero(where)),
        coverage=cases.ratio(fp_px / (cases.column("width") * cases.column("height")), where=where),
        coverage_valid=cases.ratio(fp_px / np.where(seeing, valid_px, 1), over=seeing, where=where),
        frame_rate=cases.ratio(cases.column("fp_large_components") > 0, where=where),
        components_per_frame=cases.ratio(cases.column("fp_components"), where=where),
    )


def segmentation_figures(cases: Cases) -> SegmentationFigures:
    """Take the figures of the moving class from summed counts; what lies in I is in none of them."""
    tp, fp, fn = (cases.column(name) for name in ("tp_px", "fp_px", "fn_px"))
    return SegmentationFigures(
        iou=cases.ratio(tp, over=tp + fp + fn),
        precision=cases.ratio(tp, over=tp + fp),
        recall=cases.ratio(tp, over=tp + fn),
        f1=cases.ratio(2 * tp, over=2 * tp + fp + fn),
    )


def false_positive_causes(cases: Cases) -> dict[str, Figure]:
    """Share of the false-positive pixels by the cause that the method names, by name; empty if it names none."""
    frames = [dict(pairs) for pairs in cases.rows["fp_by_cause"]]
    names = sorted({name for frame in frames for name in frame})
    px_of = {name: [frame.get(name, 0) for frame in frames] for name in names}
    return {name: cases.ratio(px, over=cases.column("fp_px")) for name, px in px_of.items()}
