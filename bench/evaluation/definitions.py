"""Every metric, once: its name, what it means, the two sums that it is the ratio of, and whether more is better.

Summary, tables, gate, comparison, leaderboard and page take all of this from here, and docs/metrics.md has every name.
A row is an evaluated object-frame or a scored image-frame, with the columns of `OBJECTS_SCHEMA` or `FRAMES_SCHEMA`;
numerator and denominator are functions of a data frame of such rows, one number for each, 0 where the row is no case. A
metric is the sum of the numerators over the sum of the denominators, NaN for 0/0.

Source:
    Mariotti and Eising 2020, section IV: detection rate, TPR over the detected object-frames, false-positive area over
    the total area of the image.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from functools import partial
from typing import Any

import pandas as pd

from bench.errors import UnknownNameError
from bench.evaluation.intervals import MEAN, MEAN_CHANGE, RATIO, RATIO_CHANGE, ValueBounds

OBJECT_FRAMES, IMAGE_FRAMES = "object-frames", "image-frames"
HALF_A_POINT = (0.005, 0.02)  # tolerated of metrics that are small as a rule
DETECTION, CHANCE, CAUSE = "detection_rate_", "chance_", "false_positives_by_"  # before a level in percent, or a cause
HALF = 0.5  # of an object, the level of the headline
Terms = Callable[[pd.DataFrame], "pd.Series[Any]"]


@dataclass(frozen=True, slots=True)
class Definition:
    """A metric.

    Attributes:
        over: the rows, `OBJECT_FRAMES` or `IMAGE_FRAMES`.
        name: in sums, gate, comparison and tolerances; no other metric has it.
        label: for headings.
        numerator: of each row, (N,) float64.
        denominator: of each row, (N,) float64; an object-frame is one case or none, an image may be many, as pixels.
        meaning: one sentence.
        higher_is_better: None for what is no merit or fault of a method; it is not compared.
        bounds: a ratio in [0, 1], or a mean without an upper end.
        headline: among the few that say whether a run is better.
        cases_by_method: whether its cases depend on what the method detects; of others on the reference alone.
        tolerated: what the gate lets it lose, in its own unit and as a share of the baseline's value, the larger of the
            two; None for one that is not judged.
        short_name: in its part of `summary.json`, where it is called otherwise.
    """

    over: str
    name: str
    label: str
    numerator: Terms
    denominator: Terms
    meaning: str
    _: KW_ONLY
    higher_is_better: bool | None = True
    bounds: ValueBounds = RATIO
    headline: bool = False
    cases_by_method: bool = False
    tolerated: tuple[float, float] | None = (0.01, 0.02)
    short_name: str = ""

    @property
    def field(self) -> str:
        """Its name in its part of `summary.json`."""
        return self.short_name or self.name

    @property
    def is_ratio(self) -> bool:
        """In [0, 1], shown in percent."""
        return self.bounds is RATIO

    @property
    def change_bounds(self) -> ValueBounds:
        """Possible differences of two values."""
        return RATIO_CHANGE if self.is_ratio else MEAN_CHANGE

    def value(self, rows: pd.DataFrame) -> float:
        """The metric of some rows; NaN without cases."""
        cases = float(self.denominator(rows).sum())
        return float(self.numerator(rows).sum()) / cases if cases else float("nan")

    def improvement(self, difference: float) -> float:
        """A difference, after minus before, as a gain: negative for worse, NaN without a direction."""
        if self.higher_is_better is None:
            return float("nan")
        return difference if self.higher_is_better else -difference


def coverage(rows: pd.DataFrame) -> pd.Series[float]:
    """Share of each object that is detected: TP / (TP + FN); NaN for one without pixels, as it was not evaluated."""
    return rows["tp"] / (rows["tp"] + rows["fn"])


def chance_coverage(rows: pd.DataFrame) -> pd.Series[float]:
    """Share of each object that the method's mask of another time covers; NaN where there is none."""
    return rows["chance_tp"] / (rows["tp"] + rows["fn"])


def intersection_over_union(rows: pd.DataFrame) -> pd.Series[float]:
    """TP / (TP + FP + FN) of each object; NaN for 0/0."""
    return rows["tp"] / (rows["tp"] + rows["fp"] + rows["fn"])


def detected(rows: pd.DataFrame) -> pd.Series[bool]:
    """Any pixel of the object."""
    return rows["tp"] > 0


def false_share(rows: pd.DataFrame) -> pd.Series[float]:
    """Share of each image that is wrongly marked."""
    return rows["fp_px"] / (rows["width"] * rows["height"])


def one(rows: pd.DataFrame) -> pd.Series[float]:
    """Every row counts once."""
    return pd.Series(1.0, rows.index)


_objects, _images = partial(Definition, OBJECT_FRAMES), partial(Definition, IMAGE_FRAMES)

OF_OBJECTS = (
    _objects("detection_rate", "Detection rate", detected, one,
             "Share of object-frames with any pixel detected, as in the paper."),
    _objects("chance", "Chance", lambda r: r["chance_tp"] > 0, lambda r: r["chance_tp"].notna(),
             "Detection rate of the same objects against the method's mask of an image at least a second away.",
             higher_is_better=None),
    _objects("tpr", "TPR, detected", lambda r: coverage(r).where(detected(r), 0), detected,
             "Mean coverage of the detected object-frames, the paper's wording.", cases_by_method=True),
    _objects("tpr_all", "TPR, all", coverage, one, "Mean coverage of all object-frames.", headline=True),
    _objects("iou", "IoU, all", intersection_over_union, one,
             "Mean IoU of all object-frames, an undetected one having 0.", headline=True, tolerated=HALF_A_POINT),
    _objects("iou_detected", "IoU, detected", lambda r: intersection_over_union(r).where(detected(r), 0), detected,
             "Mean IoU of the detected object-frames, which compares with the paper.",
             cases_by_method=True, tolerated=HALF_A_POINT),
)  # fmt: skip
UNKNOWN = _objects(
    "unknown_share", "Unknown", lambda r: r["unknown_px"] / (r["tp"] + r["fn"] + r["unknown_px"]), one,
    "Mean share of an object's possible pixels that is not certain, under protocols with unknown bands.",
    higher_is_better=None,
)  # fmt: skip
CEILINGS = (
    _objects("ceiling_tpr_all", "TPR, ceiling", lambda r: (r["ceiling_tp"] / (r["tp"] + r["fn"])).fillna(0),
             lambda r: r["ceiling_tp"].notna(),
             "TPR over all object-frames that the exact masks get under the same protocol, for data that have them.",
             higher_is_better=None),
    _objects("ceiling_iou", "IoU, ceiling",
             lambda r: (r["ceiling_tp"] / (r["tp"] + r["fn"] + r["ceiling_fp"])).fillna(0),
             lambda r: r["ceiling_tp"].notna(),
             "IoU over all object-frames that the exact masks get under the same protocol, for data that have them.",
             higher_is_better=None),
)  # fmt: skip
FALSE_POSITIVES = (
    _images("false_positive_coverage", "False-positive coverage", false_share, one,
            "Mean share of the image that is detected outside of all objects and of ignored areas (I).",
            higher_is_better=False, headline=True, tolerated=HALF_A_POINT, short_name="coverage"),
    _images("false_positive_coverage_valid", "False positives of the valid pixels",
            lambda r: (r["fp_px"] / r["valid_px"]).where(r["valid_px"] > 0, 0), lambda r: r["valid_px"] > 0,
            "The same as a share of V.", higher_is_better=False, tolerated=HALF_A_POINT, short_name="coverage_valid"),
    _images("false_positive_frame_rate", "Frames with a large false positive",
            lambda r: r["fp_large_components"] > 0, one,
            "Share of images that have a false-positive component of more pixels than the protocol states.",
            higher_is_better=False, short_name="frame_rate"),
    _images("false_positive_components", "Components per frame", lambda r: r["fp_components"], one,
            "Mean number of false-positive components of an image.",
            higher_is_better=False, bounds=MEAN, tolerated=(1.0, 0.05), short_name="components_per_frame"),
)  # fmt: skip
SEGMENTATION = (
    _images("segmentation_iou", "IoU, pixels", lambda r: r["tp_px"], lambda r: r["tp_px"] + r["fp_px"] + r["fn_px"],
            "IoU of the moving class from pixel counts summed over all images, outside of I.",
            cases_by_method=True, tolerated=HALF_A_POINT, short_name="iou"),
    _images("precision", "Precision", lambda r: r["tp_px"], lambda r: r["tp_px"] + r["fp_px"],
            "Share of the detected pixels, outside of I, that are right.",
            cases_by_method=True, tolerated=HALF_A_POINT),
    _images("recall", "Recall", lambda r: r["tp_px"], lambda r: r["tp_px"] + r["fn_px"],
            "Share of the moving pixels that are detected."),
    _images("f1", "F1", lambda r: 2 * r["tp_px"], lambda r: 2 * r["tp_px"] + r["fp_px"] + r["fn_px"],
            "Harmonic mean of precision and recall.", cases_by_method=True, tolerated=None),
)  # fmt: skip
MARKED = _images("marked", "Marked", lambda r: (r["detected_px"] / r["valid_px"]).where(r["valid_px"] > 0, 0),
                 lambda r: r["valid_px"] > 0,
                 "Mean share of V that is detected in images that are not annotated, of which nothing else is known.",
                 higher_is_better=None)  # fmt: skip
# The metrics of which each row is a case, so that their cases count the rows of a slice.
EVERY_ROW = {OBJECT_FRAMES: "iou", IMAGE_FRAMES: "false_positive_coverage"}
# Numbers that stand in the same sums, as a numerator; `tracks` are objects, over their object-frames.
COUNTS = ("tracks", "annotated", "images")


def level_metrics(levels: Iterable[float]) -> list[Definition]:
    """Detection at each least coverage of a protocol, then their chance levels."""
    return [metric for metrics in zip(*map(_of_level, levels), strict=True) for metric in metrics]


def _of_level(level: float) -> tuple[Definition, Definition]:
    percent = f"{100 * level:g}"
    return (
        _objects(f"{DETECTION}{percent}", f"Detection at {percent} %", lambda r: coverage(r) >= level, one,
                 f"Share of object-frames with a coverage of at least {percent} %.", headline=level == HALF),
        _objects(f"{CHANCE}{percent}", f"Chance at {percent} %",
                 lambda r: chance_coverage(r) >= level, lambda r: r["chance_tp"].notna(),
                 f"Detection at {percent} % against the method's mask of another time.", higher_is_better=None),
    )  # fmt: skip


def cause_metric(cause: str) -> Definition:
    """The share of the false-positive pixels that a cause of the method flagged."""
    return _images(f"{CAUSE}{cause}", f"False positives by {cause}",
                   lambda r: r["fp_by_cause"].map(lambda px: px.get(cause, 0)).where(r["fp_px"] > 0, 0),
                   lambda r: r["fp_px"], f"Share of the false-positive pixels flagged by {cause}.",
                   higher_is_better=None, cases_by_method=True)  # fmt: skip


def object_metrics(
    levels: Iterable[float], *, unknown_bands: bool = False, ceilings: bool = False
) -> tuple[Definition, ...]:
    """The metrics of object-frames, in the order of `summary.json`.

    Args:
        levels: least coverages at which an object counts as detected, beside "any pixel".
        unknown_bands: whether the protocol has them.
        ceilings: whether the data have exact masks.
    """
    return (*OF_OBJECTS, *level_metrics(levels), *([UNKNOWN] if unknown_bands else []), *(CEILINGS if ceilings else ()))


def image_metrics(causes: Iterable[str] = ()) -> tuple[Definition, ...]:
    """The metrics of image-frames.

    Args:
        causes: of false positives, that the method names.
    """
    return (*FALSE_POSITIVES, *SEGMENTATION, *map(cause_metric, causes))


FIXED = {metric.name: metric for metric in (*OF_OBJECTS, UNKNOWN, *CEILINGS, *FALSE_POSITIVES, *SEGMENTATION, MARKED)}


def find_metric(name: str) -> Definition:
    """The metric of a name, for example "iou", "detection_rate_50" or "false_positives_by_epipolar".

    Raises:
        UnknownNameError: there is none.
    """
    if name in FIXED:
        return FIXED[name]
    if name.startswith(CAUSE):
        return cause_metric(name.removeprefix(CAUSE))
    try:
        level = float(name.removeprefix(DETECTION).removeprefix(CHANCE)) / 100
        return next(metric for metric in _of_level(level) if metric.name == name)
    except (ValueError, StopIteration):
        raise UnknownNameError("metric", name, tuple(FIXED)) from None


def headlines(levels: Iterable[float] = (HALF,)) -> tuple[Definition, ...]:
    """The metrics that say whether a run is better, in the order that they are shown.

    Args:
        levels: of the protocol; one without 50 % has no detection at half.
    """
    names = ["iou", "tpr_all", *(m.name for m in level_metrics(levels) if m.headline), "false_positive_coverage"]
    return tuple(find_metric(name) for name in names)
