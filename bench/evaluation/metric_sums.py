"""Each metric as a ratio of two sums by recording."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict

from bench.evaluation.slice_sums import SliceSums
from bench.evaluation.terms import FALSE_POSITIVE_RATIOS, OBJECT_RATIOS, SEGMENTATION_RATIOS, Ratio, level_ratios

NOT_RATIOS = ("false_positive_components",)  # means, which may exceed 1


class MetricSums(BaseModel):
    """One metric of one slice as the ratio of two sums.

    Attributes:
        numerators: by recording; only recordings that hold cases.
        denominators: by recording, > 0.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    numerators: dict[str, float]
    denominators: dict[str, float]

    @property
    def value(self) -> float:
        """The figure, NaN for 0/0."""
        cases = math.fsum(self.denominators.values())
        return math.fsum(self.numerators.values()) / cases if cases else math.nan

    @property
    def cases(self) -> int:
        """What the figure is taken over: object-frames, image-frames, or pixels for the segmentation figures."""
        return int(math.fsum(self.denominators.values()))


def object_metrics(levels: tuple[float, ...]) -> dict[str, Ratio]:
    """Name -> ratio of the metrics of object-frames: those of `object_figures` but for chance."""
    ratios = level_ratios(levels)
    found = {"detection_rate": OBJECT_RATIOS["detection_rate"]} | ratios | OBJECT_RATIOS
    return {name: ratio for name, ratio in found.items() if not name.startswith("chance")}


def frame_metrics() -> dict[str, Ratio]:
    """Name -> ratio of the metrics of image-frames, as `frame_figures` defines them."""
    return {
        "false_positive_coverage": FALSE_POSITIVE_RATIOS["coverage"],
        "false_positive_coverage_valid": FALSE_POSITIVE_RATIOS["coverage_valid"],
        "false_positive_frame_rate": FALSE_POSITIVE_RATIOS["frame_rate"],
        "false_positive_components": FALSE_POSITIVE_RATIOS["components_per_frame"],
        "segmentation_iou": SEGMENTATION_RATIOS["iou"],
        "precision": SEGMENTATION_RATIOS["precision"],
        "recall": SEGMENTATION_RATIOS["recall"],
    }


def metric_sums(
    sums: SliceSums, place: int, ratios: Mapping[str, Ratio], *, recordings: Sequence[str]
) -> dict[str, MetricSums]:
    """The metrics of one slice.

    Args:
        sums: of a split, over S recordings.
        place: of the slice.
        ratios: of the metrics, by name.
        recordings: S names.
    """
    return {name: _ratio_sums(sums, place, ratio, recordings) for name, ratio in ratios.items()}


def _ratio_sums(sums: SliceSums, place: int, ratio: Ratio, recordings: Sequence[str]) -> MetricSums:
    above, below = (sums.terms[name][:, place] for name in ratio)
    held = np.flatnonzero(below)
    names = [recordings[number] for number in held.tolist()]
    return MetricSums(
        numerators=dict(zip(names, above[held].tolist(), strict=True)),
        denominators=dict(zip(names, below[held].tolist(), strict=True)),
    )
