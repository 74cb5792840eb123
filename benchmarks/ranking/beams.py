"""Beams that a trustworthy reference needs.

Rings of the lidar are left out, the reference of `surface-v1` is built of those that remain, and is compared with the
exact masks as that of the whole sensor is. Nothing else changes: the sensor's field, columns, range and noise stay, and
the reference finds the angles between rows in the sweeps themselves, as it does for any sensor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.audit.run import ALL
from bench.audit.sources import OpenedSource, StoredAudit, audit_each, same_objects
from bench.errors import DataError, UsageError
from bench.evaluation.protocol import load_protocol
from bench.evaluation.sums import ALL_MOVING
from bench.execution import Progress, TaskExecutor
from bench.lidar.sweep import LidarSweep
from bench.recordings import DatasetCard, Recording
from bench.records.recording import PointIndices
from bench.records.reference import ReferenceFrame, Status
from benchmarks.ranking.agreement import agreement, fit_shares, metric_values, read_terms
from benchmarks.ranking.predictions import Prediction
from benchmarks.ranking.sums import EXACT, FITS, IOU, SURFACE, RankingRows, RankingSums, predicted_images
from benchmarks.ranking.wrong_masks import WrongMasks

REFERENCES = (SURFACE, EXACT)
TRUTH = Prediction(name="truth", method=WrongMasks())  # its score is the ceiling


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beams:
    """The reference by fewer and fewer beams.

    Attributes:
        stored: of what data it is, and what failed.
        asked: numbers of beams, as asked for.
        predictions: names of what was ranked, the exact masks first; these alone where no methods were.
        rows: of all object-frames, then by class, each from the sensor's own beams down; columns `object_class`, or
            "all", `beams`, `recordings` that hold object-frames, what `fit_shares` gives over the object-frames that
            the whole sensor and these beams evaluate, `lost`, those that the whole sensor alone evaluates, `ceiling`,
            the mean IoU of the exact masks, and `tau` as of `agreement`, None where no methods were ranked.
    """

    stored: StoredAudit
    asked: tuple[int, ...]
    predictions: tuple[str, ...]
    rows: pd.DataFrame


def count_beams(recording: Recording) -> int:
    """Number of the sensor's rings, which are numbered from 0 in the order of their elevation.

    Raises:
        DataError: a sweep cannot be read or does not name its rings, or objects are annotated by rows of the sweeps.
    """
    rings = [ref.read().ring for ref in recording.sweeps]
    named = [ring for ring in rings if ring is not None]
    shapes = (state.shape for track in recording.tracks for state in track.states)
    by_row = any(isinstance(shape, PointIndices) for shape in shapes)
    if by_row or not rings or len(named) < len(rings):
        got = "objects annotated by rows of a sweep" if by_row else f"rings in {len(named)} of {len(rings)} sweeps"
        raise DataError(
            recording.root,
            expected="lidar sweeps that name the ring of each point, and boxes or outlines around objects",
            got=got,
            hint="audit a rendered data set, for example demo",
        )
    return 1 + int(np.concatenate(named).max(initial=0))


def with_beams(recording: Recording, beams: int, *, of: int) -> Recording:
    """The recording with fewer rings of its lidar, evenly spaced from the first on; all points of these stay as they
    are.

    Args:
        recording: with the whole sensor.
        beams: how many.
        of: how many the sensor has.

    Raises:
        DataError: more than the sensor has.
    """
    if beams > of:
        expected = f"at most {of} beams, as many as its lidar has"
        raise DataError(recording.root, expected=expected, got=f"--beams {beams}")
    rings = np.arange(beams) * of // beams
    sweeps = tuple(
        replace(ref, reader=partial(_read_rings, rings=rings, reader=ref.reader)) for ref in recording.sweeps
    )
    return replace(recording, sweeps=sweeps)


def _read_rings(
    path: Path, timestamp_ns: int, *, rings: NDArray[np.intp], reader: Callable[[Path, int], LidarSweep]
) -> LidarSweep:
    return of_rings(reader(path, timestamp_ns), rings=rings)


def of_rings(sweep: LidarSweep, *, rings: NDArray[np.intp]) -> LidarSweep:
    """The returns of some rings of a sweep that names them."""
    assert sweep.ring is not None, "others are refused by `count_beams`"
    kept = np.isin(sweep.ring, rings)
    fields = {name: getattr(sweep, name) for name in ("points_lidar", "time_offset_ns", "intensity", "ring")}
    return replace(sweep, **{name: values[kept] for name, values in fields.items() if values is not None})


def thin_recording(opened: OpenedSource, *, beams: Sequence[int], predictions: Sequence[Prediction]) -> RankingSums:
    """Score the predictions by the references of fewer and fewer beams, the sensor's own first.

    Returns:
        Sums with a column `beams`: scores by `surface-v1` and by exact masks; fits by class, with `lost` beside `FITS`.

    Raises:
        DataError: the recording has no rings, or fewer of them than asked for.
    """
    protocol, own = load_protocol(SURFACE), count_beams(opened.recording)
    counts = sorted({own, *beams}, reverse=True)
    names, large_px = [prediction.name for prediction in predictions], protocol.scoring.false_positive_component_px
    rows = {count: RankingRows(names, REFERENCES, component_size_px=large_px) for count in counts}
    lost: dict[int, list[str]] = {count: [] for count in counts}
    others = [(with_beams(opened.recording, count, of=own), protocol.reference) for count in counts if count != own]
    for image in predicted_images(opened, predictions, protocol, others=others):
        whole = image.references[0]
        pairs = [same_objects([whole, one], image.ids, opened.instance_of)[1:] for one in image.references]
        evaluated = _classes(pairs[0][0])
        for count, pair in zip(counts, pairs, strict=True):
            rows[count].add(pair, image.masks)
            kept = _classes(pair[0])
            lost[count] += [of_class for track, of_class in evaluated.items() if track not in kept]
    return RankingSums(
        scores=pd.concat([found.scores().assign(beams=count) for count, found in rows.items()]),
        fits=pd.concat([_fits(found, lost[count]).assign(beams=count) for count, found in rows.items()]),
    )


def _classes(reference: ReferenceFrame) -> dict[str, str]:
    """Class of each evaluated object, by track."""
    return {item.track_id: item.object_class for item in reference.objects if item.status is Status.EVALUATED}


def _fits(rows: RankingRows, lost: Sequence[str]) -> pd.DataFrame:
    """`FITS` by class, and how many object-frames of it are lost."""
    fits, missing = rows.fits().groupby("object_class")[FITS].sum(), pd.Series(lost, dtype=object).value_counts()
    return fits.join(missing.rename("lost"), how="outer").fillna(0.0).rename_axis("object_class").reset_index()


def beams_rows(sums: Sequence[RankingSums], predictions: Sequence[Prediction]) -> pd.DataFrame:
    """Return `Beams.rows`.

    Args:
        sums: of all recordings.
        predictions: the exact masks first.
    """
    scores, fits = (pd.concat([getattr(of, name) for of in sums]) for name in ("scores", "fits"))
    rows = []
    for name in (ALL, *load_protocol(SURFACE).reference.classes):
        of_class = fits if name == ALL else fits[fits["object_class"] == name]
        scored = scores[scores["slice"] == (ALL_MOVING if name == ALL else name)]
        for beams in sorted(of_class["beams"].unique(), reverse=True):
            fit = of_class.loc[of_class["beams"] == beams, [*FITS, "lost"]].sum()
            terms = read_terms(scored[scored["beams"] == beams], IOU, predictions, REFERENCES)
            ranked = len(predictions) > 1
            of = {
                "object_class": name,
                "beams": int(beams),
                "recordings": len(terms),
                "lost": int(fit["lost"]),
                "ceiling": float(metric_values(terms[:, 0, 0].sum(axis=0))),
                "tau": agreement(terms, reference=0, predictions=predictions)["tau"] if ranked else None,
            }
            rows.append(of | fit_shares(fit))
    return pd.DataFrame(rows)


def run_beams(
    card: DatasetCard,
    *,
    beams: Sequence[int],
    predictions: Sequence[Prediction],
    split: str | None,
    recordings: int | None,
    executor: TaskExecutor,
    progress: Progress | None,
) -> Beams:
    """Compare the references of fewer and fewer beams with the exact masks.

    Args:
        card: the data set, rendered.
        beams: how many; the sensor's own are always among them.
        predictions: to be ranked beside the exact masks; none for no ranking.
        split: of the data set; None for all of it.
        recordings: how many of them; None for all.
        executor: reads the recordings; the result does not depend on it.
        progress: called with the recordings done and their number.

    Raises:
        UsageError: two predictions of one name.
        DataError: no recording could be used, above all where none has rendered masks or the lidar has fewer beams.
    """
    ranked = (TRUTH, *(one for one in predictions if not one.exact))
    names = [prediction.name for prediction in ranked]
    if len(set(names)) < len(names):
        raise UsageError(f"--methods: expected different methods to rank, got {', '.join(names)}")
    work = partial(thin_recording, beams=tuple(beams), predictions=ranked)
    found, stored = audit_each(
        work, card=card, split=split, recordings=recordings, executor=executor, progress=progress
    )
    return Beams(stored=stored, asked=tuple(beams), predictions=tuple(names), rows=beams_rows(found, ranked))
