"""What is added up of each row; every figure is the ratio of two of these sums."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.evaluation.columns import Columns

Column = NDArray[np.float64]
Ratio = tuple[str, str]  # names of the terms above and below

# Figures of `object_figures` and of the score sheet by name.
OBJECT_RATIOS: dict[str, Ratio] = {
    "detection_rate": ("detected", "every"),
    "chance": ("chance_detected", "with_chance"),
    "tpr": ("coverage_detected", "detected"),
    "tpr_all": ("coverage", "every"),
    "iou": ("iou", "every"),
    "iou_detected": ("iou_detected", "detected"),
}
FALSE_POSITIVE_RATIOS: dict[str, Ratio] = {
    "coverage": ("share", "every"),
    "coverage_valid": ("share_valid", "seeing"),
    "frame_rate": ("large", "every"),
    "components_per_frame": ("components", "every"),
}
SEGMENTATION_RATIOS: dict[str, Ratio] = {
    "iou": ("tp", "tp_fp_fn"),
    "precision": ("tp", "tp_fp"),
    "recall": ("tp", "tp_fn"),
    "f1": ("twice_tp", "twice_tp_fp_fn"),
}
MEANS = frozenset({"components"})  # terms above a ratio that is no share: it may exceed 1
CAUSE = "cause="  # before the name of a cause; over "fp"


def level_ratios(levels: tuple[float, ...]) -> dict[str, Ratio]:
    """The ratios of the detection levels, detection before chance."""
    names = [f"{100 * level:g}" for level in levels]
    return {f"detection_rate_{name}": (f"detected_{name}", "every") for name in names} | {
        f"chance_{name}": (f"chance_detected_{name}", "with_chance") for name in names
    }


def object_terms(evaluated: Columns, *, levels: tuple[float, ...]) -> dict[str, Column]:
    """Terms of each evaluated object-frame.

    Source:
        Mariotti and Eising 2020, section IV: detection rate, and TPR over the detected object-frames.
    """
    tp, fp, fn, chance_tp = (evaluated.numbers(name) for name in ("tp", "fp", "fn", "chance_tp"))
    seen, with_chance = detected(tp), ~np.isnan(chance_tp)
    covered, overlap = coverage(tp, fn), intersection_over_union(tp, fp, fn)
    by_chance = chance_tp / (tp + fn)
    terms = {
        "every": np.ones(len(tp)),
        "detected": _counted(seen),
        "with_chance": _counted(with_chance),
        "chance_detected": _counted(detected(chance_tp)),
        "coverage": covered,
        "coverage_detected": np.where(seen, covered, 0.0),
        "iou": overlap,
        "iou_detected": np.where(seen, overlap, 0.0),
    }
    for level in levels:
        terms[f"detected_{100 * level:g}"] = _counted(covered >= level)
        terms[f"chance_detected_{100 * level:g}"] = _counted(by_chance >= level)
    return terms


def frame_terms(scored: Columns) -> dict[str, Column]:
    """Terms of each scored image-frame.

    Source:
        Mariotti and Eising 2020, section IV: false-positive area over the total area of the image.
    """
    tp, fp, fn, valid = (scored.numbers(name) for name in ("tp_px", "fp_px", "fn_px", "valid_px"))
    return {
        "every": np.ones(len(tp)),
        "seeing": _counted(valid > 0),
        "share": fp / (scored.numbers("width") * scored.numbers("height")),
        "share_valid": np.where(valid > 0, fp / np.where(valid > 0, valid, 1), 0.0),
        "large": _counted(scored.numbers("fp_large_components") > 0),
        "components": scored.numbers("fp_components"),
        "tp": tp,
        "fp": fp,
        "tp_fp": tp + fp,
        "tp_fn": tp + fn,
        "tp_fp_fn": tp + fp + fn,
        "twice_tp": 2 * tp,
        "twice_tp_fp_fn": 2 * tp + fp + fn,
    } | _cause_terms(scored)


def detected(tp: Column) -> NDArray[np.bool_]:
    """Any pixel of the object; False where `tp` is NaN."""
    return tp > 0


def coverage(tp: Column, fn: Column) -> Column:
    """Share of the object that is detected: TP / (TP + FN); NaN for one without pixels, as it was not evaluated."""
    with np.errstate(invalid="ignore"):
        return tp / (tp + fn)


def intersection_over_union(tp: Column, fp: Column, fn: Column) -> Column:
    """TP / (TP + FP + FN); NaN for 0/0."""
    with np.errstate(invalid="ignore"):
        return tp / (tp + fp + fn)


def _cause_terms(scored: Columns) -> dict[str, Column]:
    rows, keys, px = scored.pairs("fp_by_cause")
    encoded = keys.dictionary_encode()
    codes, has_false = encoded.indices.to_numpy(zero_copy_only=False), scored.numbers("fp_px") > 0
    counted = has_false[rows]  # an image without false positives is no case of a share of them
    return {
        CAUSE + name: np.bincount(
            rows[counted & (codes == number)],
            weights=px[counted & (codes == number)],
            minlength=len(scored),
        ).astype(np.float64)
        for number, name in enumerate(encoded.dictionary.to_pylist())
    }


def _counted(flags: NDArray[np.bool_]) -> Column:
    return flags.astype(np.float64)
