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
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import kendalltau

from bench.audit.sources import StoredAudit, audit_each
from bench.errors import UsageError
from bench.evaluation.definitions import UNKNOWN, Definition
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.protocol import load_protocol
from bench.evaluation.sums import TERMS, bin_names
from bench.execution import Progress, TaskExecutor
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

ALL = "all"
DRAWS, SEED = 1000, 2020
ROUNDING = 12  # decimals; scores that differ by less are the same
KINDS = (OUTLINES, OBJECTS)
Values = NDArray[np.float64]


class Estimate(NamedTuple):
    """A value; its 95 % interval is None where fewer than six recordings hold cases."""

    value: float
    ci95: tuple[float, float] | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ranking:
    """Scores of predictions by all references, and how well these agree with the exact masks.

    Attributes:
        stored: of what data it is, and what failed.
        predictions: in the order asked for.
        rows: by name of `ROWS`: `recordings` that hold cases, `cases` (object-frames, in the last row image-frames) and
            `unknown_share`, the mean share of an object-frame's possible pixels that `surface-v1` leaves unknown.
        scores: by row and reference, a column for each prediction: IoU; share of false positives in their row.
        agreement: by row and lidar reference, as `agreement` gives it.
        fits: of `surface-v1`, as `surface_fits` gives them.
    """

    stored: StoredAudit
    predictions: tuple[Prediction, ...]
    rows: pd.DataFrame
    scores: pd.DataFrame
    agreement: pd.DataFrame
    fits: pd.DataFrame

    @property
    def kinds(self) -> list[str]:
        """Kinds of errors that wrong masks among the predictions have."""
        return [kind for kind in KINDS if any(prediction.error == kind for prediction in self.predictions)]

    @property
    def exact(self) -> str | None:
        """Name of the exact masks as they are; None where they are not among the predictions."""
        return next((prediction.name for prediction in self.predictions if prediction.exact), None)

    def of_motion(self, reference: str, column: str) -> float:
        """A value of `agreement`, mean over the kinds of motion that have object-frames; NaN without any."""
        held = [name for name in CATEGORIES if self.rows.loc[name, "cases"]]
        values = [self.agreement.loc[(name, reference), column] for name in held]
        return float(np.mean([getattr(value, "value", value) for value in values])) if held else float("nan")


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


def mean_difference(by_lidar: Values, by_masks: Values) -> float:
    """Mean absolute difference over predictions, (P,) float64 each, without those of NaN; NaN where none is left."""
    differences = np.abs(by_lidar - by_masks)
    known = differences[np.isfinite(differences)]
    return float(known.sum() / len(known)) if len(known) else float("nan")


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


def agreement(terms: Values, *, reference: int, predictions: Sequence[Prediction]) -> dict[str, Any]:
    """Agreement of a reference with the last one, the exact masks.

    Args:
        terms: of `read_terms`, of the metric by which the predictions are ranked.
        reference: index of the one to be compared.
        predictions: in the order of the terms.

    Returns:
        `tau`: Kendall's tau-b of the two orders of the predictions; NaN where all are equal.
        `difference`, `difference_real`: mean absolute difference of the scores, over all and over the real methods.
        For each kind of error, of `KINDS`, `tau_<kind>`, of these masks and the exact one, and `points_<kind>`: mean
        score by lidar less the score by exact masks, positive where the errors cost too little.
        `tau_between`: over the pairs of masks with errors of different kinds; NaN without such pairs.
        The first three are of type `Estimate`.
    """
    scores, sums = metric_values(terms.sum(axis=0)), draw_recordings(terms)
    draws = () if sums is None else metric_values(sums)

    def estimate(statistic: Callable[[Values, Values], float], who: NDArray[np.bool_]) -> Estimate:
        drawn = np.array([statistic(values[reference, who], values[-1, who]) for values in draws])
        known = drawn[np.isfinite(drawn)]
        ci95 = tuple(np.quantile(known, [0.025, 0.975]).tolist()) if len(known) else None
        return Estimate(statistic(scores[reference, who], scores[-1, who]), ci95)

    real = np.array([prediction.real for prediction in predictions])
    kinds = [prediction.error for prediction in predictions]
    agreed = {
        "tau": estimate(rank_correlation, np.ones_like(real)),
        "difference": estimate(mean_difference, np.ones_like(real)),
        "difference_real": estimate(mean_difference, real),
        "tau_between": correlation_between(scores[reference], scores[-1], kinds),
    }
    for kind in KINDS:
        of_kind = np.array([error == kind for error in kinds])
        ranked = of_kind | [prediction.exact for prediction in predictions]
        by_lidar, by_masks = scores[reference], scores[-1]
        several = of_kind.any() and ranked.sum() > 1
        agreed[f"tau_{kind}"] = rank_correlation(by_lidar[ranked], by_masks[ranked]) if several else float("nan")
        agreed[f"points_{kind}"] = float((by_lidar - by_masks)[of_kind].mean()) if of_kind.any() else float("nan")
    return agreed


def surface_fits(fits: pd.DataFrame) -> pd.DataFrame:
    """Correctness of the regions of `surface-v1`: over all, by class, by class and range, by ego speed.

    Args:
        fits: of recordings.

    Returns:
        `FIT_SLICES`, bins or "all", and what `fit_shares` gives; slices without object-frames are left out.
    """
    classes = load_protocol(SURFACE).reference.classes
    ranges, speeds = bin_names(BINS.range_m), bin_names(BINS.ego_speed_mps)
    slices = [(ALL, ALL, ALL)]
    slices += [(name, away, ALL) for name in classes for away in (ALL, *ranges)]
    slices += [(ALL, ALL, speed) for speed in speeds]
    rows = []
    for wanted in slices:
        chosen = {column: name for column, name in zip(FIT_SLICES, wanted, strict=True) if name != ALL}
        part = fits[(fits[[*chosen]] == pd.Series(chosen, dtype=object)).all(axis=1)][FITS].sum()
        rows.append(dict(zip(FIT_SLICES, wanted, strict=True)) | fit_shares(part))
    table = pd.DataFrame(rows)
    return table[table["object_frames"] > 0]


def fit_shares(sums: pd.Series[float]) -> dict[str, float]:
    """Shares from sums of `FITS`, NaN for 0/0.

    Returns:
        `object_frames`: how many.
        `in_core`: share of the exact masks' pixels that lie in the cores; `left_out`: in neither core nor band.
        `core_outside`: share of the cores' pixels that lie outside the exact masks.
        `unknown_share`: mean share of an object-frame's possible pixels that is unknown.
    """
    shares = {
        "in_core": (sums["core_px"] - sums["core_outside_px"], sums["mask_px"]),
        "left_out": (sums["left_out_px"], sums["mask_px"]),
        "core_outside": (sums["core_outside_px"], sums["core_px"]),
        "unknown_share": (sums["unknown_share"], sums["object_frames"]),
    }
    of = {name: float(metric_values(np.array(terms))) for name, terms in shares.items()}
    return {"object_frames": int(sums["object_frames"])} | of


def ranking_of(
    sums: pd.DataFrame, fits: pd.DataFrame, predictions: Sequence[Prediction], *, stored: StoredAudit
) -> Ranking:
    """Rank the predictions from `RankingSums` of all recordings."""
    rows, scores, agreements = {}, {}, {}
    for name in ROWS:
        own = sums[sums["slice"] == name]
        terms = read_terms(own, FALSE_SHARE if name == FALSE_POSITIVES else IOU, predictions)
        unknown = read_terms(own, UNKNOWN, predictions)[:, REFERENCES.index(SURFACE), 0].sum(axis=0)
        rows[name] = {
            "recordings": len(terms),
            "cases": int(terms[:, 0, 0, 1].sum()),
            "unknown_share": float(metric_values(unknown)),
        }
        for number, reference in enumerate(REFERENCES):
            scores[name, reference] = metric_values(terms.sum(axis=0))[number]
        for number, reference in enumerate(REFERENCES[:-1]):
            agreements[name, reference] = agreement(terms, reference=number, predictions=predictions)
    scored, agreed = (pd.MultiIndex.from_tuples(of, names=["row", "reference"]) for of in (scores, agreements))
    names = [prediction.name for prediction in predictions]
    return Ranking(
        stored=stored,
        predictions=tuple(predictions),
        rows=pd.DataFrame([*rows.values()], index=[*rows]),
        scores=pd.DataFrame([*scores.values()], index=scored, columns=names),
        agreement=pd.DataFrame([*agreements.values()], index=agreed),
        fits=surface_fits(fits),
    )


def run_ranking(
    card: DatasetCard,
    *,
    predictions: Sequence[Prediction],
    split: str | None,
    recordings: int | None,
    executor: TaskExecutor,
    progress: Progress | None,
) -> Ranking:
    """Score predictions against all references, and compare these with the exact masks.

    Args:
        card: the data set, rendered.
        predictions: at least two, of different names.
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
    work = partial(rank_recording, predictions=tuple(predictions))
    ranked, stored = audit_each(
        work, card=card, split=split, recordings=recordings, executor=executor, progress=progress
    )
    sums, fits = (pd.concat([getattr(of, name) for of in ranked], ignore_index=True) for name in ("scores", "fits"))
    return ranking_of(sums, fits, predictions, stored=stored)


def tau_text(found: Estimate) -> str:
    """A value with two decimals and its 95 % interval."""
    value = "n/a" if math.isnan(found.value) else f"{found.value:.2f}"
    return f"{value} {formats.interval(found.ci95, unit=1.0, digits=2)}".rstrip()


def command(found: StoredAudit) -> str:
    """The command that made a study, but for what it was asked."""
    split = "" if found.split is None else f" --split {found.split}"
    return f"python -m benchmarks.ranking {found.card} --recordings {found.recordings}{split}"
