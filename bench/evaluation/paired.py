"""The sums behind every metric, per recording: what a gate or a comparison needs to test a change in pairs.

A summary's metrics cannot be compared in pairs, as their sums are gone. `RecordingSums` holds them, by slice, metric
and recording, small enough to be committed as a baseline. `paired_change` then leaves whole recordings out, the same
before and after, so that what makes a recording hard cancels out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict
from scipy.special import stdtrit

from bench.evaluation.intervals import (
    CONFIDENCE,
    FEWEST_RECORDINGS,
    RATIO_CHANGE,
    Bounds,
    Column,
    Jackknife,
    jackknife,
    ratio_interval,
    ratio_without_each,
)
from bench.evaluation.protocol import Protocol
from bench.evaluation.row_source import IMAGE, Columns, Rows, as_source, group_recordings
from bench.evaluation.slices import ALL_MOVING, FRAMES, slice_name
from bench.evaluation.sums import (
    FALSE_POSITIVE_RATIOS,
    OBJECT_RATIOS,
    SEGMENTATION_RATIOS,
    RunSums,
    SliceSums,
    SumRatio,
    coverage,
    intersection_over_union,
    level_ratios,
    sum_run,
)

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
        """The metric, NaN for 0/0."""
        cases = math.fsum(self.denominators.values())
        return math.fsum(self.numerators.values()) / cases if cases else math.nan

    def interval(self) -> tuple[float, float] | None:
        """95 % interval of a ratio; None where fewer than `FEWEST_RECORDINGS` recordings hold cases."""
        names = list(self.denominators)
        above, below = (np.array([part[name] for name in names]) for part in (self.numerators, self.denominators))
        return ratio_interval(above, below)

    @property
    def cases(self) -> int:
        """What the metric is taken over: object-frames, image-frames, or pixels for the segmentation metrics."""
        return int(math.fsum(self.denominators.values()))


class RecordingSums(BaseModel):
    """All metrics of a run with their sums.

    Attributes:
        slices: slice -> metric -> sums. Slices are the categories, "all_moving", "frames" (the image-frames), and
            "<breakdown>=<bin or name>" for the breakdowns of the summary, for example "range_m=[0, 2)".
        counts: slice -> name -> how many. "object_frames", "tracks" and "recordings" for slices of objects;
            "all_moving" also has "annotated", "static", "ignored"; "frames" has "images", "evaluated", "failed",
            "skipped".
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    slices: dict[str, dict[str, MetricSums]]
    counts: dict[str, dict[str, int]]


def object_ratios(levels: tuple[float, ...]) -> dict[str, SumRatio]:
    """Name -> ratio of the metrics of object-frames: those of `object_metrics` but for chance."""
    ratios = level_ratios(levels)
    found = {"detection_rate": OBJECT_RATIOS["detection_rate"]} | ratios | OBJECT_RATIOS
    return {name: ratio for name, ratio in found.items() if not name.startswith("chance")}


def frame_ratios() -> dict[str, SumRatio]:
    """Name -> ratio of the metrics of image-frames: false positives and segmentation, but for F1."""
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
    sums: SliceSums, index: int, ratios: Mapping[str, SumRatio], *, recordings: Sequence[str]
) -> dict[str, MetricSums]:
    """The metrics of one slice.

    Args:
        sums: of a split, over S recordings.
        index: of the slice.
        ratios: of the metrics, by name.
        recordings: S names.
    """
    return {name: _ratio_sums(sums, index, ratio, recordings) for name, ratio in ratios.items()}


def _ratio_sums(sums: SliceSums, index: int, ratio: SumRatio, recordings: Sequence[str]) -> MetricSums:
    above, below = (sums.accumulators[name][:, index] for name in ratio)
    held = np.flatnonzero(below)
    names = [recordings[number] for number in held.tolist()]
    return MetricSums(
        numerators=dict(zip(names, above[held].tolist(), strict=True)),
        denominators=dict(zip(names, below[held].tolist(), strict=True)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedChange:
    """How a metric changed from one run to another over the same recordings.

    Attributes:
        before: value, NaN without cases.
        after: value, NaN without cases.
        difference: after minus before.
        ci95: 95 % interval of the difference by recording; None where fewer than six of them hold cases in both runs,
            and where none of them differs.
        p_value: two-sided, of no change; None where fewer than six recordings hold cases in both runs.
        cases_before: of `before`.
        cases_after: of `after`.
        recordings: with cases in both runs.
    """

    before: float
    after: float
    difference: float
    ci95: tuple[float, float] | None
    p_value: float | None
    cases_before: int
    cases_after: int
    recordings: int


def paired_change(before: MetricSums, after: MetricSums, *, within: Bounds = RATIO_CHANGE) -> PairedChange:
    """Compare a metric of two runs over the same data.

    The difference is taken again without each recording with cases in either run, so that what makes a recording hard
    for both cancels out; interval and p-value follow as `bench.evaluation.intervals` says. Between runs that differ by
    chance alone, p fell below 0.05 in 1.5 % of simulated pairs over 6 recordings of unequal size, 1.8 % over 10, 2.6 %
    over 20 and 4.3 % over 100. Where three recordings in ten improve and the others stay, the interval held the true
    change in 92, 89, 90 and 94 % of the pairs: what few recordings show, few may have missed.

    Where all n recordings change by the same, there is no spread to go by. Then the interval is that of n + 1
    recordings of which one does not change, and the p-value that of the sign test, 2 / 2^n.

    Args:
        before: sums of the one run.
        after: sums of the other.
        within: possible differences.
    """
    shared = len(before.denominators.keys() & after.denominators.keys())
    recordings = sorted(before.denominators.keys() | after.denominators.keys())
    ci95, p_value = None, None
    if shared >= FEWEST_RECORDINGS:
        (old, old_without, old_shares), (new, new_without, new_shares) = (
            _by_recording(sums, recordings) for sums in (before, after)
        )
        found = jackknife(new - old, new_without - old_without, shares=(old_shares + new_shares) / 2)
        ci95 = found.interval(within) if found.standard_error else _of_the_same(found, within)
        p_value = found.p_value(within)
    return PairedChange(
        before=before.value,
        after=after.value,
        difference=after.value - before.value,
        ci95=ci95,
        p_value=p_value,
        cases_before=before.cases,
        cases_after=after.cases,
        recordings=shared,
    )


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Correct p-values for being several; None, which is no test, stays None and is not counted.

    Source:
        Holm 1979, A simple sequentially rejective multiple test procedure.
    """
    tests = sorted((p, index) for index, p in enumerate(p_values) if p is not None)
    corrected: list[float | None] = [None] * len(p_values)
    largest = 0.0
    for rank, (p, index) in enumerate(tests):
        largest = max(largest, min(1.0, (len(tests) - rank) * p))
        corrected[index] = largest
    return corrected


def _by_recording(sums: MetricSums, recordings: Sequence[str]) -> tuple[float, Column, Column]:
    """The metric, the metric without each recording, and the share of each in its cases; 0 for one without cases."""
    numerators, denominators = (
        np.array([by_recording.get(name, 0.0) for name in recordings])
        for by_recording in (sums.numerators, sums.denominators)
    )
    return *ratio_without_each(numerators, denominators), denominators / denominators.sum()


def _of_the_same(change: Jackknife, within: Bounds) -> tuple[float, float] | None:
    """The interval of a change that is the same in all recordings, as if one more had none; None for no change."""
    if change.value == 0:
        return None
    limit = float(stdtrit(change.recordings, (1 + CONFIDENCE) / 2))
    ends = (change.value * (change.recordings + side * limit) / (change.recordings + 1) for side in (-1, 1))
    low, high = sorted(ends)
    return max(low, within.least), min(high, within.most)


_KEY = [*IMAGE, "track_id"]
_OF_OBJECT = ["object_class", "category", "range_m", "region_px"]
_READ = [*_KEY, "status", *_OF_OBJECT, "tp", "fn", "fp"]

# Null where the run did not evaluate the object-frame. `change` is "gained", "lost" (the detection), "both", "neither",
# or "only_before" and "only_after" for what one run alone evaluated.
CHANGES_SCHEMA = pa.schema(
    [
        ("recording", pa.string()),
        ("camera", pa.string()),
        ("timestamp_ns", pa.int64()),
        ("track_id", pa.string()),
        ("object_class", pa.string()),
        ("category", pa.string()),
        ("range_m", pa.float64()),
        ("region_px", pa.int64()),
        ("change", pa.string()),
        *[
            (f"{name}_{run}", kind)
            for name, kind in (("detected", pa.bool_()), ("coverage", pa.float64()), ("iou", pa.float64()))
            for run in ("before", "after")
        ],
    ]
)


def object_changes(before_objects: pa.Table, after_objects: pa.Table) -> pa.Table:
    """Set the evaluated object-frames of two runs side by side.

    Args:
        before_objects: of `OBJECTS_SCHEMA`.
        after_objects: of `OBJECTS_SCHEMA`.

    Returns:
        Of `CHANGES_SCHEMA`, one row per object-frame evaluated in either run, by recording, camera, time and track.
    """
    sides = _evaluated(before_objects), _evaluated(after_objects)
    rows = _side_by_side(*sides)
    keys = {name: _either(sides, rows, name) for name in (*_KEY, *_OF_OBJECT)}
    metrics = [_metrics(side, of) for side, of in zip(sides, rows, strict=True)]
    columns = keys | {
        f"{name}_{run}": of_run[name]
        for name in metrics[0]
        for run, of_run in zip(("before", "after"), metrics, strict=True)
    }
    was, is_now = (of_run["detected"].fill_null(False).to_numpy(zero_copy_only=False) for of_run in metrics)
    change = np.select(
        [rows[1] < 0, rows[0] < 0, ~was & is_now, was & ~is_now, was & is_now],
        ["only_before", "only_after", "gained", "lost", "both"],
        "neither",
    )
    columns["change"] = pa.array(change.astype(object), pa.string())
    return pa.table([columns[name] for name in CHANGES_SCHEMA.names], schema=CHANGES_SCHEMA)


def changes_in_parts(before: Rows, after: Rows, *, rows_at_once: int | None = None) -> Iterator[pa.Table]:
    """The same of runs of any size, some recordings at a time, in the same order.

    Args:
        before: of `OBJECTS_SCHEMA`, in memory or stored.
        after: of `OBJECTS_SCHEMA`, in memory or stored.
        rows_at_once: most rows of a run in memory, unless one recording has more.
    """
    sources = as_source(before), as_source(after)
    counts = [dict(source.recordings()) for source in sources]
    most = {name: max(of.get(name, 0) for of in counts) for name in counts[0].keys() | counts[1].keys()}
    for group in group_recordings(most, rows_at_once=rows_at_once):
        yield object_changes(*(source.read(group, _READ) for source in sources))


def _evaluated(objects: pa.Table) -> Columns:
    rows = Columns(objects.select(_READ))
    return Columns(rows.take(rows.is_word("status", "evaluated")).table)


def _side_by_side(before: Columns, after: Columns) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For every object-frame of either run, in canonical order, its row in each; -1 where a run has none."""
    keys = [_shared_numbers(before, after, name) for name in _KEY]
    side = np.repeat([0, 1], [len(before), len(after)])
    row = np.concatenate([np.arange(len(before)), np.arange(len(after))])
    order = np.lexsort([side, *keys[::-1]])
    differs = np.zeros(max(len(order) - 1, 0), dtype=bool)
    for key in keys:
        differs |= key[order][1:] != key[order][:-1]
    group = np.concatenate([[0], np.cumsum(differs)])[: len(order)]
    count = int(group[-1]) + 1 if len(group) else 0
    found = (np.full(count, -1, dtype=np.int64), np.full(count, -1, dtype=np.int64))
    for number in (0, 1):
        of_side = side[order] == number
        assert len(np.unique(group[of_side])) == np.count_nonzero(of_side), f"{_KEY} names each row once"
        found[number][group[of_side]] = row[order][of_side]
    return found


def _shared_numbers(before: Columns, after: Columns, name: str) -> NDArray[np.int64]:
    """A part of the key in both runs, by numbers that compare across them."""
    if name == "timestamp_ns":
        return np.concatenate([before.integers(name), after.integers(name)])
    found = [side.words(name) for side in (before, after)]
    index = {word: number for number, word in enumerate(sorted({*found[0][1], *found[1][1]}))}
    return np.concatenate([np.array([*(index[w] for w in words), -1], dtype=np.int64)[codes] for codes, words in found])


def _either(
    sides: tuple[Columns, Columns], rows: tuple[NDArray[np.int64], NDArray[np.int64]], name: str
) -> pa.ChunkedArray:
    """A column that both runs share, from the first that has the row."""
    kind = CHANGES_SCHEMA.field(name).type
    taken = [side.table[name].cast(kind).take(pa.array(of, mask=of < 0)) for side, of in zip(sides, rows, strict=True)]
    return pc.if_else(pa.array(rows[0] >= 0), *taken)


def _metrics(side: Columns, rows: NDArray[np.int64]) -> dict[str, pa.Array]:
    tp, fp, fn = (side.numbers(name) for name in ("tp", "fp", "fn"))
    metrics = {"detected": tp > 0, "coverage": coverage(tp, fn), "iou": intersection_over_union(tp, fp, fn)}
    taken = pa.array(rows, mask=rows < 0)
    return {name: pa.array(values).take(taken) for name, values in metrics.items()}


def recording_sums(
    objects: Rows, frames: Rows, *, protocol: Protocol, rows_at_once: int | None = None
) -> RecordingSums:
    """Reduce the tables of a run to sums, whatever the order of their rows.

    Args:
        objects: of `OBJECTS_SCHEMA`, in memory or stored.
        frames: of `FRAMES_SCHEMA`, in memory or stored.
        protocol: that the run was made with.
        rows_at_once: most rows in memory, unless one recording has more; changes no bit of the sums.
    """
    return recording_sums_of(sum_run(objects, frames, protocol=protocol, rows_at_once=rows_at_once), protocol=protocol)


def recording_sums_of(sums: RunSums, *, protocol: Protocol) -> RecordingSums:
    """The sums per recording of a run from its sums."""
    of_objects, of_frames = object_ratios(protocol.scoring.detection_levels), frame_ratios()
    slices: dict[str, dict[str, MetricSums]] = {}
    counts: dict[str, dict[str, int]] = {}
    for split, part in sums.objects.items():
        for index, name in enumerate(part.names):
            called = slice_name(split, name)
            slices[called] = metric_sums(part, index, of_objects, recordings=sums.recordings)
            counts[called] = {
                "object_frames": int(part.rows[:, index].sum()),
                "tracks": int(part.tracks[:, index].sum()),
                "recordings": int(np.count_nonzero(part.rows[:, index])),
            }
    for split, part in sums.frames.items():
        for index, name in enumerate(part.names):
            called = slice_name(split, name)
            # A breakdown that images have too, for example "camera=front", holds the metrics of both.
            of_images = metric_sums(part, index, of_frames, recordings=sums.recordings)
            slices[called] = slices.get(called, {}) | of_images
            counts[called] = counts.get(called, {}) | {"frames": int(part.rows[:, index].sum())}
    objects, images = sums.object_ledger, sums.frame_ledger
    counts[ALL_MOVING] |= {"annotated": objects.rows} | {k: objects.statuses[k] for k in ("static", "ignored")}
    counts[FRAMES] |= {"images": images.rows} | {k: images.statuses[k] for k in ("evaluated", "failed", "skipped")}
    return RecordingSums(slices=slices, counts=counts)
