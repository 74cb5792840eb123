"""Each metric as a ratio of two sums by recording."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from bench.evaluation.object_figures import coverage, detected, intersection_over_union
from bench.evaluation.protocol import Protocol

Column = NDArray[np.float64]
Metrics = dict[str, tuple[Column, Column]]


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


def object_metrics(rows: pd.DataFrame, protocol: Protocol) -> Metrics:
    """Name -> numerator and denominator of each object-frame, as `object_figures` defines them."""
    tp, fp, fn = (rows[name].to_numpy(dtype=np.float64) for name in ("tp", "fp", "fn"))
    every, seen = np.ones(len(rows)), detected(tp).astype(np.float64)
    covered, overlap = coverage(tp, fn), intersection_over_union(tp, fp, fn)
    at_level = {
        f"detection_rate_{100 * level:g}": ((covered >= level).astype(np.float64), every)
        for level in protocol.scoring.detection_levels
    }
    return {
        "detection_rate": (seen, every),
        **at_level,
        "tpr": (covered, seen),
        "tpr_all": (covered, every),
        "iou": (overlap, every),
        "iou_detected": (overlap, seen),
    }


def frame_metrics(rows: pd.DataFrame) -> Metrics:
    """Name -> numerator and denominator of each image-frame, as `frame_figures` defines them."""
    tp, fp, fn, valid = (rows[name].to_numpy(dtype=np.float64) for name in ("tp_px", "fp_px", "fn_px", "valid_px"))
    every, seeing = np.ones(len(rows)), (valid > 0).astype(np.float64)
    area = (rows["width"] * rows["height"]).to_numpy(dtype=np.float64)
    return {
        "false_positive_coverage": (fp / area, every),
        "false_positive_coverage_valid": (fp / np.where(valid > 0, valid, 1), seeing),
        "false_positive_frame_rate": ((rows["fp_large_components"] > 0).to_numpy(dtype=np.float64), every),
        "false_positive_components": (rows["fp_components"].to_numpy(dtype=np.float64), every),
        "segmentation_iou": (tp, tp + fp + fn),
        "precision": (tp, tp + fp),
        "recall": (tp, tp + fn),
    }


def by_recording(rows: pd.DataFrame, metrics: Metrics) -> Callable[[NDArray[np.bool_]], dict[str, MetricSums]]:
    """A function from the rows of a slice to the sums of its metrics."""
    recordings, number = np.unique(rows["recording"].to_numpy(dtype=str), return_inverse=True)

    def sums(cases: NDArray[np.bool_], numerator: Column, denominator: Column) -> MetricSums:
        over, total = (
            np.bincount(number[cases], weights=values[cases], minlength=len(recordings))
            for values in (denominator, numerator)
        )
        held = [(str(recordings[k]), k) for k in np.flatnonzero(over)]
        return MetricSums(
            numerators={recording: float(total[k]) for recording, k in held},
            denominators={recording: float(over[k]) for recording, k in held},
        )

    return lambda where: {
        name: sums(where & (denominator > 0), numerator, denominator)
        for name, (numerator, denominator) in metrics.items()
    }
