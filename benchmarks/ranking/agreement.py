"""Does the lidar reference rank methods as the truth does?

Many predictions, real methods and exact masks that are wrong in known ways, are scored against lidar references and
against the exact masks, over the same object-frames. A reference is good where both scores agree: the mean absolute
difference is small, the order of the predictions is the same (Kendall's tau-b), and no mask that is wrong by
construction beats the exact one. Wrong masks are of two kinds: outlines that are off, and objects or parts that lack or
are added. A reference may keep the order within a kind and lose it between the two.

Intervals are percentiles over draws of whole recordings with replacement, since images of one recording are not
independent. They are for reading how far a value may be chance, not for a verdict: over few recordings they are too
narrow (`bench.evaluation.intervals`). The jackknife of the metrics is no remedy for tau, which moves in steps, two
predictions at a time: over 10 to 20 simulated recordings its interval was 1.0 to 1.3 wide, of 2.

Source:
    Kendall 1945, The treatment of ties in ranking problems, Biometrika 33.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import kendalltau

from bench.atomic import write_text
from bench.audit.sources import AuditModel, StoredAudit, audit_each
from bench.errors import UsageError
from bench.evaluation import Definition, load_protocol
from bench.evaluation.definitions import UNKNOWN
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.summary import Ratio
from bench.evaluation.sums import TERMS, bin_names
from bench.execution import SerialExecutor, TaskExecutor
from bench.harness.stages import Progress
from bench.recordings import DatasetCard
from bench.reporting import formats
from benchmarks.ranking.predictions import OBJECTS, OUTLINES, Prediction
from benchmarks.ranking.sums import (
    BINS,
    CATEGORIES,
    FALSE_POSITIVES,
    FALSE_SHARE,
    FIT_SLICES,
    FITS,
    IOU,
    REFERENCES,
    ROWS,
    SCORED,
    SURFACE,
    rank_recording,
)
from benchmarks.ranking.wrong_masks import WrongMasks

RANKING = "ranking.json"
ALL = "all"
DRAWS, SEED = 1000, 2020
ROUNDING = 12  # decimals; scores that differ by less are the same
LEAST_TAU = 0.95
LARGEST_DIFFERENCE, LARGEST_REAL_DIFFERENCE = 0.03, 0.01  # of IoU, mean over categories
KINDS = (OUTLINES, OBJECTS)


class Estimate(AuditModel):
    """A value; its 95 % interval is None where fewer than six recordings hold cases."""

    value: Ratio
    ci95: tuple[float, float] | None


class KindAgreement(AuditModel):
    """Agreement over the masks with one kind of error.

    Attributes:
        predictions: how many.
        tau: Kendall's tau-b of these masks and the exact one.
        signed_difference: mean score by lidar less the score by exact masks; positive where the errors cost too little.
    """

    predictions: int
    tau: Ratio
    signed_difference: Ratio


class Agreement(AuditModel):
    """Agreement of a lidar reference with the exact masks in one row.

    Attributes:
        tau: Kendall's tau-b of the two orders of the predictions by IoU, in the row of false positives by their share;
            NaN where all are equal.
        difference: mean absolute difference of that, over the predictions that have it against both.
        difference_real: the same over the real methods.
        by_kind: by kind of error, of `KINDS`; kinds without a mask are left out.
        tau_between: tau-b over the pairs of masks with errors of different kinds; NaN without such pairs.
    """

    tau: Estimate
    difference: Estimate
    difference_real: Estimate
    by_kind: dict[str, KindAgreement]
    tau_between: Ratio


class SurfaceFit(AuditModel):
    """Correctness of the regions of `surface-v1`, over the object-frames of a slice.

    Attributes:
        object_class: or "all".
        range_m: bin, or "all".
        ego_speed_mps: bin, or "all".
        object_frames: how many.
        core_outside: share of the cores' pixels that lie outside the exact masks.
        left_out: share of the exact masks' pixels that lie in neither core nor band.
        unknown_share: mean share of an object-frame's possible pixels that is unknown.
    """

    object_class: str
    range_m: str
    ego_speed_mps: str
    object_frames: int
    core_outside: Ratio
    left_out: Ratio
    unknown_share: Ratio


class RankedRow(AuditModel):
    """One row of the paper's table.

    Attributes:
        name: of `ROWS`.
        recordings: that hold cases.
        cases: object-frames; image-frames in the row of false positives.
        unknown_share: mean share of an object-frame's possible pixels that `surface-v1` leaves unknown; NaN without
            object-frames.
        scores: reference -> prediction -> IoU; share of false positives in their row.
        agreement: by lidar reference.
    """

    name: str
    recordings: int
    cases: int
    unknown_share: Ratio
    scores: dict[str, dict[str, Ratio]]
    agreement: dict[str, Agreement]


class RankingSummary(StoredAudit):
    """`ranking.json`.

    Attributes:
        predictions: names, in the order asked for.
        real: those that are methods, not made of the exact masks.
        errors: kind of error, of `KINDS`, by name of the wrong mask.
        ceiling: name of the exact masks as they are; None where they are not among the predictions.
        rows: by kind of motion, then all, then false positives.
        fits: of `surface-v1`: over all, by class, by class and range, by ego speed.
    """

    predictions: tuple[str, ...]
    real: tuple[str, ...]
    errors: dict[str, str]
    ceiling: str | None
    rows: tuple[RankedRow, ...]
    fits: tuple[SurfaceFit, ...]

    def mean_difference(self, reference: str, *, real: bool) -> float:
        """Mean absolute difference of IoU over the kinds of motion that have object-frames; NaN without any."""
        found = [
            (row.agreement[reference].difference_real if real else row.agreement[reference].difference).value
            for row in self.rows
            if row.name in CATEGORIES and row.cases
        ]
        return float(np.mean(found)) if found else float("nan")

    def mean_of_motion(self, reference: str, kind: str) -> KindAgreement | None:
        """Agreement over the masks with one kind of error, mean of the kinds of motion; None without such masks."""
        rows = [row.agreement[reference].by_kind for row in self.rows if row.name in CATEGORIES and row.cases]
        found = [by_kind[kind] for by_kind in rows if kind in by_kind]
        if not found:
            return None
        return KindAgreement(
            predictions=found[0].predictions,
            tau=float(np.mean([one.tau for one in found])),
            signed_difference=float(np.mean([one.signed_difference for one in found])),
        )

    def wins(self, reference: str) -> tuple[tuple[str, str], ...]:
        """Rows of object-frames, and masks that are wrong by construction and score more there than the exact ones."""
        return tuple(
            (row.name, name)
            for row in self.rows
            for name in self.errors
            if self.ceiling is not None
            and row.name != FALSE_POSITIVES
            and row.scores[reference][name] > row.scores[reference][self.ceiling]
        )

    def misses(self, reference: str) -> tuple[str, ...]:
        """List the aims that a reference misses, in words.

        The order counts in rows with at least six recordings.
        """
        found = [
            f"tau {row.agreement[reference].tau.value:.2f} in {row.name.replace('_', ' ')}"
            for row in self.rows
            if row.recordings >= FEWEST_RECORDINGS and row.agreement[reference].tau.value < LEAST_TAU
        ]
        for real, most in ((False, LARGEST_DIFFERENCE), (True, LARGEST_REAL_DIFFERENCE)):
            difference = self.mean_difference(reference, real=real)
            if difference > most:
                who = "real methods" if real else "all predictions"
                found.append(f"mean difference {100 * difference:.1f} over {who}")
        return tuple(found)


Values = NDArray[np.float64]


def read_terms(
    scores: pd.DataFrame,
    metric: Definition,
    predictions: Sequence[Prediction],
    references: Sequence[str] = REFERENCES,
) -> Values:
    """Numerator and denominator of a metric in one row, (S, references, predictions, 2) float64, by recording.

    Args:
        scores: sums of the row, as in `RankingSums`.
        metric: which.
        predictions: in the order of the result.
        references: likewise.
    """
    own = scores[scores["metric"] == metric.name]
    recordings, names = own["recording"].unique(), [prediction.name for prediction in predictions]
    every = pd.MultiIndex.from_product([references, names, recordings], names=SCORED)
    terms = own.set_index(SCORED)[TERMS].reindex(every).to_numpy(np.float64)
    return np.moveaxis(terms.reshape(len(references), len(names), len(recordings), 2), 2, 0)


def metric_values(terms: Values) -> Values:
    """A metric from sums of its terms, (..., 2) float64: (...,) float64, NaN for 0/0."""
    above, below = terms[..., 0], terms[..., 1]
    values = np.full(above.shape, np.nan)
    np.divide(above, below, out=values, where=below > 0)
    return np.round(values, ROUNDING)


def rank_correlation(by_lidar: Values, by_masks: Values) -> float:
    """Kendall's tau-b of two scores of the same predictions, (P,) each; NaN where all of either are equal."""
    return float(kendalltau(by_lidar, by_masks, variant="b").statistic)


def correlation_between(by_lidar: Values, by_masks: Values, kinds: Sequence[str | None]) -> float:
    """Kendall's tau-b over the pairs of predictions of different kinds.

    Args:
        by_lidar: (P,) float64.
        by_masks: (P,) float64.
        kinds: of each prediction; those of None are left out.

    Returns:
        Concordant less discordant pairs over sqrt(pairs not tied by lidar * pairs not tied by masks); NaN where either
        is 0.
    """
    pairs = [(i, j) for i, j in combinations(range(len(kinds)), 2) if None not in (kinds[i], kinds[j])]
    one, other = np.array([(i, j) for i, j in pairs if kinds[i] != kinds[j]], dtype=np.intp).reshape(-1, 2).T
    lidar, masks = (np.sign(values[one] - values[other]) for values in (by_lidar, by_masks))
    untied = np.sqrt(np.count_nonzero(lidar) * np.count_nonzero(masks))
    return float((lidar * masks).sum() / untied) if untied else float("nan")


def mean_difference(by_lidar: Values, by_masks: Values) -> Values:
    """Mean absolute difference over predictions.

    Args:
        by_lidar: (..., P) float64.
        by_masks: (..., P) float64.

    Returns:
        (...,) float64; predictions with NaN are left out, and NaN where none is left.
    """
    differences = np.abs(by_lidar - by_masks)
    known = np.isfinite(differences)
    found = np.full(differences.shape[:-1], np.nan)
    np.divide(np.where(known, differences, 0.0).sum(axis=-1), known.sum(axis=-1), out=found, where=known.any(axis=-1))
    return found


def draw_recordings(sums: Values) -> Values | None:
    """Sums over recordings drawn with replacement.

    Args:
        sums: (S, ...) float64, by recording.

    Returns:
        (draws, ...) float64, the same for the same S; None for fewer than six recordings.
    """
    count = len(sums)
    if count < FEWEST_RECORDINGS:
        return None
    times = np.random.default_rng(SEED).multinomial(count, np.full(count, 1 / count), size=DRAWS)
    return np.tensordot(times.astype(np.float64), sums, axes=1)


def agreement(terms: Values, *, reference: int, predictions: Sequence[Prediction]) -> Agreement:
    """Agreement of a reference with the last one.

    Args:
        terms: of `read_terms`, of the metric by which the predictions are ranked.
        reference: index of the one to be compared.
        predictions: in the order of the terms.
    """
    drawn, whole = draw_recordings(terms), terms.sum(axis=0)

    def estimate(statistic: Callable[[Values, Values], Values | float], who: NDArray[np.bool_]) -> Estimate:
        def compared(of: Values) -> Values:
            values = metric_values(of)[..., who]
            return np.asarray(statistic(values[..., reference, :], values[..., -1, :]))

        interval = _interval(None if drawn is None else compared(drawn))
        return Estimate(value=float(compared(whole)), ci95=interval)

    real = np.array([prediction.real for prediction in predictions])
    every = np.ones_like(real)
    scores = metric_values(whole)
    kinds = [prediction.error for prediction in predictions]
    exact = _number(predictions, WrongMasks())
    return Agreement(
        tau=estimate(_rank_correlations, every),
        difference=estimate(mean_difference, every),
        difference_real=estimate(mean_difference, real),
        by_kind={
            kind: _kind_agreement(scores[reference], scores[-1], of_kind, exact=exact)
            for kind in KINDS
            if (of_kind := [k for k, error in enumerate(kinds) if error == kind])
        },
        tau_between=correlation_between(scores[reference], scores[-1], kinds),
    )


def _kind_agreement(by_lidar: Values, by_masks: Values, of_kind: list[int], *, exact: int | None) -> KindAgreement:
    ranked = of_kind if exact is None else [exact, *of_kind]
    return KindAgreement(
        predictions=len(of_kind),
        tau=rank_correlation(by_lidar[ranked], by_masks[ranked]) if len(ranked) > 1 else float("nan"),
        signed_difference=float(np.mean(by_lidar[of_kind] - by_masks[of_kind])),
    )


def _rank_correlations(by_lidar: Values, by_masks: Values) -> Values:
    """`rank_correlation` of every draw, (..., P) each."""
    pairs = zip(by_lidar.reshape(-1, by_lidar.shape[-1]), by_masks.reshape(-1, by_masks.shape[-1]), strict=True)
    return np.array([rank_correlation(first, second) for first, second in pairs]).reshape(by_lidar.shape[:-1])


def _interval(drawn: Values | None) -> tuple[float, float] | None:
    known = np.empty(0) if drawn is None else drawn[np.isfinite(drawn)]
    if not len(known):
        return None
    low, high = np.quantile(known, [0.025, 0.975]).tolist()
    return low, high


def rank_row(name: str, scores: pd.DataFrame, predictions: Sequence[Prediction]) -> RankedRow:
    """Compare the references in one row.

    Args:
        name: of `ROWS`.
        scores: sums of all rows, as in `RankingSums`.
        predictions: in the order of the result.
    """
    own = scores[scores["slice"] == name]
    names = [prediction.name for prediction in predictions]
    terms = read_terms(own, FALSE_SHARE if name == FALSE_POSITIVES else IOU, predictions)
    values = metric_values(terms.sum(axis=0))
    unknown = read_terms(own, UNKNOWN, predictions)[:, REFERENCES.index(SURFACE), 0].sum(axis=0)
    return RankedRow(
        name=name,
        recordings=len(terms),
        cases=int(terms[:, 0, 0, 1].sum()),
        unknown_share=float(metric_values(unknown)),
        scores={
            reference: dict(zip(names, by_prediction.tolist(), strict=True))
            for reference, by_prediction in zip(REFERENCES, values, strict=True)
        },
        agreement={
            reference: agreement(terms, reference=number, predictions=predictions)
            for number, reference in enumerate(REFERENCES[:-1])
        },
    )


def surface_fits(fits: pd.DataFrame) -> tuple[SurfaceFit, ...]:
    """Sum the fits of recordings by slice; slices without object-frames are left out."""
    classes = load_protocol(SURFACE).reference.classes
    ranges, speeds = bin_names(BINS.range_m), bin_names(BINS.ego_speed_mps)
    slices = [(ALL, ALL, ALL)]
    slices += [(name, away, ALL) for name in classes for away in (ALL, *ranges)]
    slices += [(ALL, ALL, speed) for speed in speeds]
    found = []
    for wanted in slices:
        chosen = {column: name for column, name in zip(FIT_SLICES, wanted, strict=True) if name != ALL}
        part = fits[(fits[[*chosen]] == pd.Series(chosen, dtype=object)).all(axis=1)][FITS].sum()
        if part["object_frames"]:
            found.append(
                SurfaceFit(
                    **dict(zip(FIT_SLICES, wanted, strict=True)),
                    object_frames=int(part["object_frames"]),
                    core_outside=part["core_outside_px"] / part["core_px"],
                    left_out=part["left_out_px"] / part["mask_px"],
                    unknown_share=part["unknown_share"] / part["object_frames"],
                )
            )
    return tuple(found)


def _number(predictions: Sequence[Prediction], method: WrongMasks) -> int | None:
    oracles = ((k, p.method) for k, p in enumerate(predictions) if isinstance(p.method, WrongMasks))
    return next((number for number, oracle in oracles if oracle == method), None)


def run_ranking(
    card: DatasetCard,
    *,
    predictions: Sequence[Prediction],
    out: Path,
    split: str | None = None,
    recordings: int | None = None,
    executor: TaskExecutor = SerialExecutor(),  # noqa: B008 - it holds nothing
    progress: Progress | None = None,
) -> RankingSummary:
    """Score predictions against all references and store how well these agree with the exact masks.

    Args:
        card: the data set, rendered.
        predictions: at least two, of different names.
        out: folder of `ranking.json`.
        split: of the data set; None for all of it.
        recordings: how many of them; None for all.
        executor: scores the recordings; the result does not depend on it.
        progress: called with the recordings done and their number.

    Raises:
        UsageError: fewer than two predictions, or two of one name.
        DataError: no recording could be scored, above all where none has rendered masks.
    """
    names = [prediction.name for prediction in predictions]
    if len(names) < 2 or len(set(names)) < len(names):
        raise UsageError(f"--methods: expected at least two different methods to rank, got {', '.join(names)}")
    ranked, stored = audit_each(
        partial(rank_recording, predictions=tuple(predictions)),
        card=card,
        split=split,
        recordings=recordings,
        executor=executor,
        progress=progress,
    )
    scores = pd.concat([found.scores for found in ranked], ignore_index=True)
    exact = _number(predictions, WrongMasks())
    summary = RankingSummary(
        **dict(stored),
        predictions=tuple(names),
        real=tuple(prediction.name for prediction in predictions if prediction.real),
        errors={prediction.name: prediction.error for prediction in predictions if prediction.error is not None},
        ceiling=None if exact is None else names[exact],
        rows=tuple(rank_row(name, scores, predictions) for name in ROWS),
        fits=surface_fits(pd.concat([found.fits for found in ranked], ignore_index=True)),
    )
    write_text(out / RANKING, summary.model_dump_json(indent=1) + "\n")
    return summary


def tau_text(found: Estimate) -> str:
    """A value with two decimals and its 95 % interval."""
    value = "n/a" if math.isnan(found.value) else f"{found.value:.2f}"
    return f"{value} {formats.interval(found.ci95, unit=1.0, digits=2)}".rstrip()


def command(found: StoredAudit) -> str:
    """The command that made a study, but for what it was asked."""
    split = "" if found.split is None else f" --split {found.split}"
    return f"python -m benchmarks.ranking {found.card} --recordings {found.recordings}{split}"
