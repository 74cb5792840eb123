"""Stored runs that may be compared, on the images that both scored, and why others may not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from bench.errors import UsageError
from bench.evaluation.rows import (
    IMAGE,
    OBJECT,
    CommonImages,
    RowSource,
    group_recordings,
    merge_rows,
)
from bench.harness import StoredRun, read_run
from bench.harness.manifest import Aspect, Manifest, all_settings, differences
from bench.harness.stored import REFERENCE_OF_FRAMES, REFERENCE_OF_OBJECTS, reference_digest, refuse_unscored

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
    runs = [read_run(folder, label=label) for folder, label in zip(folders, labels, strict=True)]
    for other in runs[1:]:
        _refuse_different(runs[0], other)
    return runs


def name_methods(manifests: Sequence[Manifest], *, hidden: Collection[str] = ()) -> list[str]:
    """Name the method of each run, with those settings that are not the same in all runs of it, as `--set` takes them.

    Args:
        manifests: of the runs.
        hidden: settings that are not named.

    Returns:
        For example "spherical (flow=dis, weights.anti_parallel=0)".
    """
    named = []
    for own in manifests:
        names = {d.name for other in manifests for d in differences(own, other) if d.aspect is Aspect.SETTINGS}
        settings = {name: value for name, value in all_settings(own.method).items() if name in names - set(hidden)}
        text = ", ".join(f"{name}={value}" for name, value in sorted(settings.items()))
        named.append(f"{own.method.name} ({text})" if text else own.method.name)
    return named


def _refuse_different(first: StoredRun, other: StoredRun) -> None:
    for difference in differences(first.manifest, other.manifest):
        if not difference.comparable:
            raise UsageError(f"{first.folder} and {other.folder} do not compare: {difference}")


def _labels(folders: Sequence[Path]) -> list[str]:
    """Names of the folders, with a number from the second on where several are the same."""
    names = [folder.resolve().name for folder in folders]
    seen = [names[:place].count(name) for place, name in enumerate(names)]
    return [f"{name} ({before + 1})" if before else name for name, before in zip(names, seen, strict=True)]


# Of the images of each run of a table, so many must be common: one run that scored a few would else shrink it for all.
LEAST_COMMON = 0.5


def reference_of(run: StoredRun) -> str:
    """Digest of the reference of a run, on all its images."""
    return str(run.manifest.reference)


def common_images(runs: Sequence[StoredRun]) -> CommonImages:
    """The images that all runs scored; those of the same reference scored the same."""
    return CommonImages(list({reference_of(run): run.frames for run in runs}.values()))


def on_common_images(runs: Sequence[StoredRun]) -> tuple[list[StoredRun], str]:
    """Restrict runs to the images that all of them scored: their rows, summed again; not their summary.

    Args:
        runs: that compare.

    Returns:
        runs: on these images.
        reference: digest of the first's reference on these images.
    """
    if len({reference_of(run) for run in runs}) == 1:
        return list(runs), reference_of(runs[0])
    images = common_images(runs)
    return [replace(run, images=images) for run in runs], _digest(runs[0], images)


def why_apart(runs: Sequence[StoredRun], other: StoredRun) -> str:
    """Say why a run stands in no table with others: too few images in common, or another reference on them; or ""."""
    if any(reference_of(run) == reference_of(other) for run in runs):
        return ""
    images = common_images([*runs, other])
    common, scored = images.count(), max(run.summary.images.evaluated for run in (*runs, other))
    if not common or common < LEAST_COMMON * scored:
        return f"only {common} images are common, of {scored} that one of the runs scored"
    same = _digest(runs[0], images) == _digest(other, images)
    return "" if same else f"the reference changed on the {common} images that all scored"


def pair_on_common_images(before: StoredRun, after: StoredRun) -> tuple[StoredRun, StoredRun, int]:
    """Restrict two runs of the same data and protocol to the images that both scored.

    Returns:
        before: on these images.
        after: on these images.
        common: how many images both scored.

    Raises:
        DataError: a table is damaged.
        UsageError: no image was scored by both, or their references differ on these; says in what.
    """
    for run in (before, after):
        refuse_unscored(run.summary, run.folder)
    common = before.summary.images.evaluated
    if reference_of(before) != reference_of(after):
        images = common_images([before, after])
        refused, common = f"{before.folder} and {after.folder} do not compare: ", images.count()
        if not common:
            scored = [run.summary.images.evaluated for run in (before, after)]
            raise UsageError(f"{refused}no image was scored by both; the first has {scored[0]}, the second {scored[1]}")
        if _digest(before, images) != _digest(after, images):
            differ = "; ".join(_differences(before, after, images))
            raise UsageError(f"{refused}their references differ on the {common} images that both scored: {differ}")
    (before, after), _ = on_common_images([before, after])
    return before, after, common


def _digest(run: StoredRun, images: CommonImages) -> str:
    """Of the reference on some images of a run."""
    on_images = replace(run, images=images)
    return reference_digest(on_images.objects, on_images.frames)


def _differences(one: StoredRun, two: StoredRun, images: CommonImages) -> list[str]:
    """Differences, each with its number and its first example."""
    groups = group_recordings(images.recordings())
    one, two = replace(one, images=images), replace(two, images=images)
    objects, frames = (one.objects, two.objects), (one.frames, two.frames)
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
