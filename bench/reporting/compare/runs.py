"""Stored runs that may be compared, on the images that both scored, and why others may not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from bench.errors import UsageError
from bench.evaluation import sum_run
from bench.evaluation.rows import (
    IMAGE,
    OBJECT,
    CommonImages,
    RowsOnImages,
    RowSource,
    group_recordings,
    merge_rows,
)
from bench.harness import RunSummary
from bench.harness.manifest import Aspect, all_settings, differences
from bench.harness.stored import REFERENCE_OF_FRAMES, REFERENCE_OF_OBJECTS, reference_digest, refuse_unscored
from bench.reporting.stored_run import StoredRun, read_stored_run

if TYPE_CHECKING:
    import pandas as pd


def read_comparable(folders: Sequence[Path]) -> list[StoredRun]:
    """Read runs of the same data and protocol.

    Raises:
        DataError: a run is damaged.
        UsageError: fewer than two runs, or runs of different data, split or protocol.
    """
    if len(folders) < 2:
        raise UsageError(f"compare: expected at least two runs, got {len(folders)}")
    labels = _labels(folders)
    runs = [read_stored_run(folder, label=label) for folder, label in zip(folders, labels, strict=True)]
    for other in runs[1:]:
        _refuse_different(runs[0], other)
    return runs


def name_methods(summaries: Sequence[RunSummary], *, hidden: Collection[str] = ()) -> list[str]:
    """Name the method of each run, with those settings that are not the same in all runs of it, as `--set` takes them.

    Args:
        summaries: of the runs.
        hidden: settings that are not named.

    Returns:
        For example "spherical (flow=dis, weights.anti_parallel=0)".
    """
    manifests, named = [summary.manifest for summary in summaries], []
    for own in manifests:
        names = {d.name for other in manifests for d in differences(own, other) if d.aspect is Aspect.SETTINGS}
        settings = {name: value for name, value in all_settings(own.method).items() if name in names - set(hidden)}
        text = ", ".join(f"{name}={value}" for name, value in sorted(settings.items()))
        named.append(f"{own.method.name} ({text})" if text else own.method.name)
    return named


def _refuse_different(first: StoredRun, other: StoredRun) -> None:
    for difference in differences(first.summary.manifest, other.summary.manifest):
        if not difference.comparable:
            raise UsageError(f"{first.folder} and {other.folder} do not compare: {difference}")


def _labels(folders: Sequence[Path]) -> list[str]:
    """Names of the folders, with a number from the second on where several are the same."""
    names = [folder.resolve().name for folder in folders]
    seen = [names[:place].count(name) for place, name in enumerate(names)]
    return [f"{name} ({before + 1})" if before else name for name, before in zip(names, seen, strict=True)]


def on_common_images(before: StoredRun, after: StoredRun) -> tuple[StoredRun, StoredRun, int]:
    """Restrict two runs of the same data and protocol to the images that both scored.

    Returns:
        before: with its rows on these images.
        after: the same.
        common: how many images both scored.

    Raises:
        DataError: a table is damaged.
        UsageError: no image was scored by both, or their references differ on these; says in what.
    """
    for run in (before, after):
        refuse_unscored(run.summary, run.folder)
    numbers = [run.summary.images.evaluated for run in (before, after)]
    if before.summary.manifest.reference == after.summary.manifest.reference:
        return before, after, numbers[0]
    images = CommonImages([before.frames, after.frames])
    common = images.count()
    refused = f"{before.folder} and {after.folder} do not compare: "
    if not common:
        raise UsageError(f"{refused}no image was scored by both; the first has {numbers[0]}, the second {numbers[1]}")
    if digest(before, images) != digest(after, images):
        differences = "; ".join(_differences(before, after, images))
        raise UsageError(f"{refused}their references differ on the {common} images that both scored: {differences}")
    return restricted(before, images), restricted(after, images), common


def restricted(run: StoredRun, images: CommonImages) -> StoredRun:
    """A run with its rows on some images, summed again; its summary stays that of all."""
    objects, frames = _rows_on(run, images)
    return replace(run, objects=objects, frames=frames, sums=sum_run(objects, frames, protocol=run.protocol))


def digest(run: StoredRun, images: CommonImages) -> str:
    """Of the reference on some images of a run."""
    return reference_digest(*_rows_on(run, images))


def _rows_on(run: StoredRun, images: CommonImages) -> tuple[RowsOnImages, RowsOnImages]:
    return RowsOnImages(run.objects, images), RowsOnImages(run.frames, images)


def _differences(one: StoredRun, two: StoredRun, images: CommonImages) -> list[str]:
    """What differs, each with its number and its first example."""
    groups = group_recordings(images.recordings())
    objects, frames = zip(_rows_on(one, images), _rows_on(two, images), strict=True)
    of_objects = _table_differences(objects, OBJECT, REFERENCE_OF_OBJECTS, groups, "object-frames")
    return of_objects or _table_differences(frames, IMAGE, REFERENCE_OF_FRAMES, groups, "images")


def _table_differences(
    sources: tuple[RowSource, RowSource],
    key: Sequence[str],
    columns: Sequence[str],
    groups: Sequence[Sequence[str]],
    unit: str,
) -> list[str]:
    count: Counter[str] = Counter()
    first: dict[str, str] = {}

    def count_rows(what: str, rows: pd.DataFrame, example: str) -> None:
        if len(rows):
            count[what] += len(rows)
            first.setdefault(what, example.format(**{str(c): v for c, v in rows.iloc[0].items()}))

    name = " ".join(f"{{{column}}}" for column in key)
    for group in groups:
        tables = [source.read(group, columns).astype(dict.fromkeys(columns, object)) for source in sources]
        both = merge_rows(*tables, on=key, how="outer").sort_values(list(key), ignore_index=True)
        for side, what in (("left_only", f"{unit} only in the first"), ("right_only", f"{unit} only in the second")):
            count_rows(what, both[both["side"] == side], name)
        shared = both[both["side"] == "both"]
        for column in columns[len(key) :]:
            before, after = (shared[f"{column}_{side}"] for side in ("before", "after"))
            differs = (before != after) & ~(before.isna() & after.isna())
            example = f"{name}, {{{column}_before}} and {{{column}_after}}"
            count_rows(f"{unit} with another {column}", shared[differs], example)
    return [f"{number} {what}, the first {first[what]}" for what, number in count.items()]
