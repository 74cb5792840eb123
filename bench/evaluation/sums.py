"""A run reduced to sums by recording and slice, some recordings in memory at a time; each metric is a ratio of two."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from bench.evaluation.protocol import Protocol
from bench.evaluation.row_source import IMAGE, Columns, Rows, RowSource, as_source, read_parts
from bench.evaluation.slices import Breakdown, frame_breakdowns, object_breakdowns

Column = NDArray[np.float64]
SumRatio = tuple[str, str]  # names of the accumulators above and below

# Metrics of `object_metrics` and of the sums per recording by name.
OBJECT_RATIOS: dict[str, SumRatio] = {
    "detection_rate": ("detected", "all"),
    "chance": ("chance_detected", "with_chance"),
    "tpr": ("coverage_detected", "detected"),
    "tpr_all": ("coverage", "all"),
    "iou": ("iou", "all"),
    "iou_detected": ("iou_detected", "detected"),
}
FALSE_POSITIVE_RATIOS: dict[str, SumRatio] = {
    "coverage": ("fp_share", "all"),
    "coverage_valid": ("fp_share_valid", "with_valid_px"),
    "frame_rate": ("with_large_component", "all"),
    "components_per_frame": ("components", "all"),
}
SEGMENTATION_RATIOS: dict[str, SumRatio] = {
    "iou": ("tp", "tp_fp_fn"),
    "precision": ("tp", "tp_fp"),
    "recall": ("tp", "tp_fn"),
    "f1": ("twice_tp", "twice_tp_fp_fn"),
}
UNKNOWN_RATIO: dict[str, SumRatio] = {"unknown_share": ("unknown", "all")}  # of protocols with unknown bands
CEILING_RATIOS: dict[str, SumRatio] = {  # what the exact masks get, of data that have them
    "ceiling_tpr_all": ("ceiling_coverage", "with_ceiling"),
    "ceiling_iou": ("ceiling_iou", "with_ceiling"),
}
MEANS = frozenset({"components"})  # accumulators above a ratio that is no share: it may exceed 1
CAUSE = "cause="  # before the name of a cause; over "fp"


def level_ratios(levels: tuple[float, ...]) -> dict[str, SumRatio]:
    """The ratios of the detection levels, detection before chance."""
    names = [f"{100 * level:g}" for level in levels]
    return {f"detection_rate_{name}": (f"detected_{name}", "all") for name in names} | {
        f"chance_{name}": (f"chance_detected_{name}", "with_chance") for name in names
    }


def object_accumulators(evaluated: Columns, *, levels: tuple[float, ...]) -> dict[str, Column]:
    """Accumulators of each evaluated object-frame.

    Source:
        Mariotti and Eising 2020, section IV: detection rate, and TPR over the detected object-frames.
    """
    tp, fp, fn, chance_tp = (evaluated.numbers(name) for name in ("tp", "fp", "fn", "chance_tp"))
    seen, with_chance = detected(tp), ~np.isnan(chance_tp)
    covered, overlap = coverage(tp, fn), intersection_over_union(tp, fp, fn)
    by_chance = chance_tp / (tp + fn)
    unknown = np.nan_to_num(evaluated.numbers("unknown_px"))  # null in tables of older versions
    ceiling_tp, ceiling_fp = (evaluated.numbers(name) for name in ("ceiling_tp", "ceiling_fp"))
    with_ceiling = ~np.isnan(ceiling_tp)
    ceiling_iou = intersection_over_union(ceiling_tp, ceiling_fp, tp + fn - ceiling_tp)
    accumulators = {
        "all": np.ones(len(tp)),
        "detected": _counted(seen),
        "with_chance": _counted(with_chance),
        "chance_detected": _counted(detected(chance_tp)),
        "coverage": covered,
        "coverage_detected": np.where(seen, covered, 0.0),
        "iou": overlap,
        "iou_detected": np.where(seen, overlap, 0.0),
        "unknown": unknown / (tp + fn + unknown),
        "with_ceiling": _counted(with_ceiling),
        "ceiling_coverage": np.where(with_ceiling, ceiling_tp / (tp + fn), 0.0),
        "ceiling_iou": np.where(with_ceiling, ceiling_iou, 0.0),
    }
    for level in levels:
        accumulators[f"detected_{100 * level:g}"] = _counted(covered >= level)
        accumulators[f"chance_detected_{100 * level:g}"] = _counted(by_chance >= level)
    return accumulators


def frame_accumulators(scored: Columns) -> dict[str, Column]:
    """Accumulators of each scored image-frame.

    Source:
        Mariotti and Eising 2020, section IV: false-positive area over the total area of the image.
    """
    tp, fp, fn, valid = (scored.numbers(name) for name in ("tp_px", "fp_px", "fn_px", "valid_px"))
    return {
        "all": np.ones(len(tp)),
        "with_valid_px": _counted(valid > 0),
        "fp_share": fp / (scored.numbers("width") * scored.numbers("height")),
        "fp_share_valid": np.where(valid > 0, fp / np.where(valid > 0, valid, 1), 0.0),
        "with_large_component": _counted(scored.numbers("fp_large_components") > 0),
        "components": scored.numbers("fp_components"),
        "tp": tp,
        "fp": fp,
        "tp_fp": tp + fp,
        "tp_fn": tp + fn,
        "tp_fp_fn": tp + fp + fn,
        "twice_tp": 2 * tp,
        "twice_tp_fp_fn": 2 * tp + fp + fn,
    } | _cause_accumulators(scored)


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


def _cause_accumulators(scored: Columns) -> dict[str, Column]:
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


Accumulators = Mapping[str, Column]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SliceSums:
    """Sums of some accumulators over the rows of each slice of a split, by recording.

    Attributes:
        names: of the slices, K of them.
        rows: (S, K) int64, how many there are.
        tracks: (S, K) int64, objects that they come from; 0 for image-frames.
        accumulators: name -> (S, K) float64.
    """

    names: tuple[str, ...]
    rows: NDArray[np.int64]
    tracks: NDArray[np.int64]
    accumulators: dict[str, NDArray[np.float64]]


def sum_slices(
    split: Breakdown,
    accumulators: Accumulators,
    *,
    recording: NDArray[np.int64],
    recordings: int,
    track: NDArray[np.int64] | None,
) -> SliceSums:
    """Add up the rows of each recording and slice, in their order.

    Args:
        split: of N rows.
        accumulators: name -> (N,) float64.
        recording: (N,) int64, number of each row's recording.
        recordings: how many there are.
        track: (N,) int64, number of each row's object within all recordings; None for image-frames.
    """
    kinds = len(split.names)
    shape, known = (recordings, kinds), split.of_row >= 0
    whole = bool(known.all())
    cell = (recording * kinds + split.of_row) if whole else (recording[known] * kinds + split.of_row[known])

    def added(values: Column | None) -> NDArray[np.float64]:
        weights = values if whole or values is None else values[known]
        sums = np.bincount(cell, weights=weights, minlength=recordings * kinds)
        return sums.astype(np.float64, copy=False).reshape(shape)

    tracks = np.zeros(shape, dtype=np.int64)
    if track is not None and len(track):
        # The number of a pair of cell and object; each once.
        pairs = pc.unique(pa.array(cell * (int(track.max()) + 1) + (track if whole else track[known]))).to_numpy()
        tracks = np.bincount(pairs // (int(track.max()) + 1), minlength=recordings * kinds).reshape(shape)
    return SliceSums(
        names=split.names,
        rows=added(None).astype(np.int64),
        tracks=tracks,
        accumulators={name: added(values) for name, values in accumulators.items()},
    )


def stack_sums(parts: Iterable[tuple[NDArray[np.int64], SliceSums]], *, recordings: int) -> SliceSums:
    """Stack the sums of parts that hold different recordings.

    Args:
        parts: (S',) int64 numbers of the recordings of a part, and their sums; no recording in two parts. Accumulators
            that a part does not have are 0 there.
        recordings: how many there are in all.
    """
    held = list(parts)
    assert held, "at least one part"
    first = held[0][1]
    names = sorted({name for _, sums in held for name in sums.accumulators})

    def stacked(tables: Sequence[NDArray[np.float64] | NDArray[np.int64] | None]) -> NDArray[np.float64]:
        whole = np.zeros((recordings, len(first.names)))
        for (numbers, _), table in zip(held, tables, strict=True):
            if table is not None:
                whole[numbers] = table
        return whole

    return SliceSums(
        names=first.names,
        rows=stacked([sums.rows for _, sums in held]).astype(np.int64),
        tracks=stacked([sums.tracks for _, sums in held]).astype(np.int64),
        accumulators={name: stacked([sums.accumulators.get(name) for _, sums in held]) for name in names},
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowLedger:
    """All rows of a table.

    Attributes:
        statuses: rows by status.
        reasons: rows by status and reason, or problem; "" where there is none.
    """

    statuses: Counter[str]
    reasons: Counter[tuple[str, str]]

    @property
    def rows(self) -> int:
        """How many there are."""
        return self.statuses.total()

    def with_rows(self, rows: Columns, *, reasons: str) -> RowLedger:
        """This and more rows, counted by the column `reasons`."""
        (status, statuses), (reason, found) = rows.words("status"), rows.words(reasons)
        assert (status >= 0).all(), "every row has a status"
        pairs, counts = np.unique(status * (len(found) + 1) + reason + 1, return_counts=True)
        more: Counter[tuple[str, str]] = Counter()
        for pair, count in zip(pairs.tolist(), counts.tolist(), strict=True):
            of_status, of_reason = divmod(pair, len(found) + 1)
            more[statuses[of_status], ("", *found)[of_reason]] += count
        return RowLedger(statuses=self.statuses + _by_status(more.items()), reasons=self.reasons + more)


def _by_status(counted: Iterable[tuple[tuple[str, str], int]]) -> Counter[str]:
    statuses: Counter[str] = Counter()
    for (status, _), count in counted:
        statuses[status] += count
    return statuses


OBJECT_COLUMNS = (
    *("recording", "camera", "timestamp_ns", "track_id", "object_class", "status", "reason", "category"),
    *("range_m", "ego_speed_mps", "points", "tp", "fn", "fp", "chance_tp", "unknown_px", "ceiling_tp", "ceiling_fp"),
)
FRAME_COLUMNS = (
    *("recording", "camera", "timestamp_ns", "ego_speed_mps", "status", "problem", "width", "height", "valid_px"),
    *("tp_px", "fn_px", "fp_px", "fp_components", "fp_large_components", "fp_by_cause"),
)
EVALUATED = "evaluated"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunSums:
    """Everything that the metrics, the sums per recording and the ledgers of a run are made of.

    Attributes:
        recordings: S names of those with scored images, sorted.
        objects: split -> sums over the evaluated object-frames.
        frames: split -> sums over the scored image-frames.
        object_ledger: all rows of the objects table by status and reason.
        frame_ledger: all rows of the frames table by status and problem.
    """

    recordings: tuple[str, ...]
    objects: dict[str, SliceSums]
    frames: dict[str, SliceSums]
    object_ledger: RowLedger
    frame_ledger: RowLedger


def sum_run(objects: Rows, frames: Rows, *, protocol: Protocol, rows_at_once: int | None = None) -> RunSums:
    """Reduce the tables of a run.

    Neither the order of the rows nor `rows_at_once` changes a bit of the sums: those of a recording are taken over all
    of its rows in canonical order.

    Args:
        objects: of `OBJECTS_SCHEMA`.
        frames: of `FRAMES_SCHEMA`.
        protocol: that the run was made with.
        rows_at_once: most rows in memory, unless one recording has more; `ROWS_AT_ONCE` without it.
    """
    of_objects, of_frames = as_source(objects), as_source(frames)
    cameras = of_frames.distinct("camera")
    levels = protocol.scoring.detection_levels

    frame_parts = _Parts()
    for part in _canonical_parts(of_frames, FRAME_COLUMNS, key=IMAGE, rows_at_once=rows_at_once):
        scored = frame_parts.account(part, reasons="problem")
        frame_parts.add(
            scored, frame_accumulators(scored), frame_breakdowns(scored, protocol=protocol, cameras=cameras)
        )

    object_parts = _Parts()
    for part in _canonical_parts(of_objects, OBJECT_COLUMNS, key=[*IMAGE, "track_id"], rows_at_once=rows_at_once):
        evaluated = object_parts.account(part, reasons="reason")
        splits = object_breakdowns(evaluated, protocol=protocol, cameras=cameras)
        object_parts.add(evaluated, object_accumulators(evaluated, levels=levels), splits, tracks=True)

    recordings = tuple(sorted(frame_parts.recordings))
    assert object_parts.recordings <= set(recordings), "objects lie in scored images"
    return RunSums(
        recordings=recordings,
        objects=object_parts.stacked(recordings),
        frames=frame_parts.stacked(recordings),
        object_ledger=object_parts.ledger,
        frame_ledger=frame_parts.ledger,
    )


def _canonical_parts(
    source: RowSource, columns: Sequence[str], *, key: Sequence[str], rows_at_once: int | None
) -> Iterator[Columns]:
    # A run of nothing is one part without rows, so that its slices are there.
    if not source.recordings():
        yield Columns(source.read((), columns))
    for table in read_parts(source, columns, rows_at_once=rows_at_once):
        yield Columns(table).canonical(key)


class _Parts:
    """The sums of the parts of a table, as they come."""

    def __init__(self) -> None:
        self.recordings: set[str] = set()
        self.ledger = RowLedger(statuses=Counter(), reasons=Counter())
        self._held: list[tuple[tuple[str, ...], dict[str, SliceSums]]] = []

    def account(self, part: Columns, *, reasons: str) -> Columns:
        """Count all rows of a part by status and reason; return those that are scored."""
        self.ledger = self.ledger.with_rows(part, reasons=reasons)
        return part.take(part.is_word("status", EVALUATED))

    def add(
        self,
        rows: Columns,
        accumulators: dict[str, NDArray[np.float64]],
        splits: dict[str, Breakdown],
        *,
        tracks: bool = False,
    ) -> None:
        """Take in the scored rows of a part."""
        codes, names = rows.words("recording")
        numbers, recording = np.unique(codes, return_inverse=True)
        present = tuple(names[number] for number in numbers.tolist())
        track = rows.words("track_id")[0] if tracks else None
        sums = {
            name: sum_slices(split, accumulators, recording=recording, recordings=len(present), track=track)
            for name, split in splits.items()
        }
        assert not self.recordings & set(present), "no recording is in two parts"
        self.recordings |= set(present)
        self._held.append((present, sums))

    def stacked(self, recordings: Sequence[str]) -> dict[str, SliceSums]:
        """The sums of all parts, by split."""
        number = {name: index for index, name in enumerate(recordings)}
        parts = [(np.array([number[n] for n in names], dtype=np.int64), sums) for names, sums in self._held]
        return {
            split: stack_sums([(numbers, sums[split]) for numbers, sums in parts], recordings=len(recordings))
            for split in self._held[0][1]
        }
