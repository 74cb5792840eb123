"""Two runs on the images that both scored, and what differs where their references do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import pandas as pd

from bench.errors import UsageError
from bench.evaluation.common_images import CommonImages, RowsOnImages
from bench.evaluation.row_source import RowSource, group_recordings
from bench.evaluation.slices import IMAGE
from bench.harness.stored import REFERENCE_OF_FRAMES, REFERENCE_OF_OBJECTS, reference_fingerprint
from bench.reporting.compare.stored_runs import StoredRun

OBJECT = [*IMAGE, "track_id"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pair:
    """Two runs with their rows on the images that both scored.

    Attributes:
        before: the run compared against.
        after: the other run.
        images: how many each scored, and how many of these both did.
    """

    before: StoredRun
    after: StoredRun
    images: tuple[int, int, int]

    @property
    def line(self) -> str:
        """One sentence that says what is compared."""
        before, after, common = self.images
        if before == after == common:
            return f"Compared on the {common} images that both scored."
        return (
            f"Compared on the {common} images that both scored: {self.before.label} scored {before}, "
            f"{self.after.label} {after}."
        )


def on_common_images(before: StoredRun, after: StoredRun) -> Pair:
    """Restrict two runs of the same data and protocol to the images that both scored.

    Raises:
        DataError: a table is damaged.
        UsageError: no image was scored by both, or their references differ on these; says in what.
    """
    numbers = [run.summary.images.evaluated for run in (before, after)]
    if before.summary.reference_fingerprint == after.summary.reference_fingerprint:
        return Pair(before=before, after=after, images=(numbers[0], numbers[1], numbers[0]))
    images = CommonImages([before.frames, after.frames])
    common = images.count()
    refused = f"{before.folder} and {after.folder} do not compare: "
    if not common:
        raise UsageError(f"{refused}no image was scored by both; the first has {numbers[0]}, the second {numbers[1]}")
    one, two = (restricted(run, images) for run in (before, after))
    if fingerprint(one) != fingerprint(two):
        told = "; ".join(_differences(one, two, images))
        raise UsageError(f"{refused}their references differ on the {common} images that both scored: {told}")
    return Pair(before=one, after=two, images=(numbers[0], numbers[1], common))


def restricted(run: StoredRun, images: CommonImages) -> StoredRun:
    """A run with its rows on some images; its summary stays that of all."""
    return replace(run, objects=RowsOnImages(run.objects, images), frames=RowsOnImages(run.frames, images))


def fingerprint(run: StoredRun) -> str:
    """Of the reference on the run's rows."""
    return reference_fingerprint(run.objects, run.frames)


def _differences(one: StoredRun, two: StoredRun, images: CommonImages) -> list[str]:
    """What differs, each with its number and its first example."""
    groups = group_recordings(images.recordings())
    of_objects = _table_differences((one.objects, two.objects), OBJECT, REFERENCE_OF_OBJECTS, groups, "object-frames")
    return of_objects or _table_differences((one.frames, two.frames), IMAGE, REFERENCE_OF_FRAMES, groups, "images")


def _table_differences(
    sources: tuple[RowSource, RowSource],
    key: Sequence[str],
    columns: Sequence[str],
    groups: Sequence[Sequence[str]],
    unit: str,
) -> list[str]:
    count: Counter[str] = Counter()
    first: dict[str, str] = {}

    def tell(what: str, rows: pd.DataFrame, example: str) -> None:
        if len(rows):
            count[what] += len(rows)
            first.setdefault(what, example.format(**{str(c): v for c, v in rows.iloc[0].items()}))

    name = " ".join(f"{{{column}}}" for column in key)
    for group in groups:
        tables = [source.read(group, columns).to_pandas().astype(dict.fromkeys(columns, object)) for source in sources]
        both = tables[0].merge(tables[1], on=list(key), how="outer", indicator=True, suffixes=("_before", "_after"))
        both = both.sort_values(list(key), ignore_index=True)
        for side, what in (("left_only", f"{unit} only in the first"), ("right_only", f"{unit} only in the second")):
            tell(what, both[both["_merge"] == side], name)
        shared = both[both["_merge"] == "both"]
        for column in columns[len(key) :]:
            before, after = (shared[f"{column}_{side}"] for side in ("before", "after"))
            differs = (before != after) & ~(before.isna() & after.isna())
            example = f"{name}, {{{column}_before}} and {{{column}_after}}"
            tell(f"{unit} with another {column}", shared[differs], example)
    return [f"{number} {what}, the first {first[what]}" for what, number in count.items()]
