"""Runs against each other: which compare, on the images that they scored in common, what changed and what is shown.

Only runs of the same data set, split and protocol are compared, on the images that they scored in common, and only if
their references agree on these. The first run is the one compared against. The metrics are those of
`bench.evaluation.comparison`, as one table; a verdict is read off each row of it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bench.errors import DataError, UsageError
from bench.evaluation import changes_in_parts, compare_sums, headlines, holm
from bench.evaluation.comparison import SIGNIFICANCE, SLICE, excludes_no_change
from bench.evaluation.definitions import false_share, image_metrics, object_metrics
from bench.evaluation.rows import (
    EVALUATED,
    IMAGE,
    OBJECT,
    CommonImages,
    RowSource,
    group_recordings,
    merge_rows,
    pick,
)
from bench.evaluation.summary import NO_CASES, Ratios, take_ratios
from bench.evaluation.sums import ALL_MOVING, CATEGORY, FRAMES
from bench.harness import StoredRun, read_run
from bench.harness.manifest import ANSWERS_MANIFEST, Aspect, Manifest, all_settings, differences
from bench.harness.stored import REFERENCE_OF_FRAMES, REFERENCE_OF_OBJECTS, reference_digest, refuse_unscored
from bench.reporting.formats import LABELS, chance_of, found_level


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


def differing_settings(manifests: Sequence[Manifest], *, hidden: Collection[str] = ()) -> list[dict[str, object]]:
    """The settings of the method of each run that are not the same in all runs of it, by dotted name.

    Args:
        manifests: of the runs.
        hidden: settings that are left out.
    """
    differing = []
    for own in manifests:
        names = {d.name for other in manifests for d in differences(own, other) if d.aspect is Aspect.SETTINGS}
        settings = all_settings(own.method)
        differing.append({name: settings[name] for name in sorted(names - set(hidden)) if name in settings})
    return differing


def name_method(name: str, settings: Mapping[str, object]) -> str:
    """For example "spherical (flow=dis, weights.anti_parallel=0)", settings as `--set` takes them."""
    text = ", ".join(f"{setting}={value}" for setting, value in settings.items())
    return f"{name} ({text})" if text else name


def name_methods(manifests: Sequence[Manifest]) -> list[str]:
    """Name the method of each run, with those settings that are not the same in all runs of it."""
    pairs = zip(manifests, differing_settings(manifests), strict=True)
    return [name_method(own.method.name, settings) for own, settings in pairs]


def _refuse_different(first: StoredRun, other: StoredRun) -> None:
    for difference in differences(first.manifest, other.manifest):
        if not difference.comparable:
            raise UsageError(f"{first.folder} and {other.folder} do not compare: {difference}")


def _labels(folders: Sequence[Path]) -> list[str]:
    """Names of the runs, with a number from the second on where several are the same."""
    paths = [folder.resolve() for folder in folders]
    names = [(path.parent if (path.parent / ANSWERS_MANIFEST).is_file() else path).name for path in paths]
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


class Shown(StrEnum):
    """Evidence of a change in the data; what a loss may cost before it fails is the gate's to say (`bench.gate`)."""

    BETTER = "better"
    WORSE = "worse"
    NOT_SHOWN = "no difference shown"
    THE_SAME = "the same"
    TOO_FEW = "too few recordings"
    NO_CASES = "no cases in one of the runs"


def what_is_shown(change: Mapping[Any, Any]) -> Shown:
    """Say what the data show of a change.

    Args:
        change: a row of `metric_changes`.

    Returns:
        Better or worse only if the 95 % interval excludes 0 and the corrected p-value is at most 5 %; neither is there
        for fewer than six recordings.
    """
    if math.isnan(change["difference"]):
        return Shown.NO_CASES
    if change["difference"] == 0 and change["ci95"] is None:
        return Shown.THE_SAME
    if change["ci95"] is None or math.isnan(change["p_holm"]):
        return Shown.TOO_FEW
    if not excludes_no_change(change["ci95"]) or change["p_holm"] > SIGNIFICANCE:
        return Shown.NOT_SHOWN
    return Shown.BETTER if change["improvement"] > 0 else Shown.WORSE


# The metrics that are judged, and the only ones whose p-values are corrected.
HEADLINES = {metric.name: metric.label for metric in headlines()}
# Of whole images, those that are shown in percent; F1 follows from precision and recall.
OF_FRAMES = [m.name for m in image_metrics() if m.higher_is_better is not None and m.is_ratio and m.name != "f1"]


def metric_changes(before: StoredRun, after: StoredRun) -> pd.DataFrame:
    """Compare the categories, all moving objects, and the false positives.

    Holm's correction runs over the rows of one headline metric that have a p-value: the categories and the row of all
    moving objects. False-positive coverage has one row, so that its p-value stays as it is. A row without a p-value
    (cases of both in fewer than six recordings) does not count.

    Returns:
        The rows and columns of `compare_sums`, also those without cases, with the p-value NaN where there is none, and
        beside them `label` of the slice, `p_holm` and `verdict` (missing for what is no headline), `metric_before` and
        `metric_after` with their own intervals, `chance_before`, `chance_after` and `ceiling` (of the exact masks on
        the same images), NaN where not known.
    """
    protocol = before.protocol
    sides = [run.sums[run.sums["breakdown"].isin([CATEGORY, ALL_MOVING, FRAMES])] for run in (before, after)]
    slices = [(CATEGORY, str(category)) for category in protocol.reference.categories] + [(ALL_MOVING, ALL_MOVING)]
    of_objects = [m.name for m in object_metrics(protocol.scoring.detection_levels) if m.higher_is_better is not None]
    keys = [(*of, m) for of in slices for m in of_objects] + [(FRAMES, FRAMES, m) for m in OF_FRAMES]
    table = compare_sums(*sides).reindex(pd.MultiIndex.from_tuples(keys, names=SLICE))
    table["ci95"] = table["ci95"].where(table["ci95"].notna(), None)
    table["p_value"] = table["p_value"].astype(float)
    counts = ["cases_before", "cases_after", "frames_before", "recordings"]
    table[counts] = table[counts].fillna(0).astype(int)
    tested = table.loc[table.index.isin([*HEADLINES], level="metric"), "p_value"].dropna()
    table["p_holm"] = tested.groupby("metric").transform(lambda p: pd.Series(holm([*p]), p.index))
    records = zip(keys, table.to_dict("records"), strict=True)
    table["verdict"] = [what_is_shown(row) if key[2] in HEADLINES else None for key, row in records]
    ratios = [take_ratios(sums) for sums in sides]
    table["label"] = [LABELS[name] for _, name, _ in keys]
    for side, of_run in zip(("before", "after"), ratios, strict=True):
        found: Any = [of_run.get(key, NO_CASES) for key in keys]
        table[f"metric_{side}"] = found
        table[f"chance_{side}"] = [
            _value(of_run, key, chance_of(key[2])) if key[2].startswith("detection_rate") else math.nan for key in keys
        ]
    ceilings = [[_value(of_run, key, f"ceiling_{key[2]}") for key in keys] for of_run in ratios]  # equal where known
    table["ceiling"] = np.where(np.isnan(ceilings).any(axis=0), math.nan, ceilings[0])
    return table


def what_is_shown_of(before: StoredRun, after: StoredRun, metric: str) -> Shown:
    """The verdict on a headline metric over all moving objects."""
    return Shown(str(metric_changes(before, after)["verdict"][ALL_MOVING, ALL_MOVING, metric]))


def _value(ratios: Ratios, key: tuple[str, str, str], metric: str) -> float:
    """Value of another metric of the same slice."""
    return ratios.get((*key[:2], metric), NO_CASES).value


LISTED = 50  # of each kind, one per track: enough for the page's filters to leave some of each recording


class Kind(StrEnum):
    """Reason that a frame is worth a look."""

    LOST = "newly missed"
    GAINED = "newly detected"
    FELL = "coverage fell"
    ROSE = "coverage rose"
    MORE_FALSE = "more false positives"
    FEWER_FALSE = "fewer false positives"


IMPROVEMENTS = {Kind.GAINED, Kind.ROSE, Kind.FEWER_FALSE}
# Columns of the frames that changed: `track_id` and `category` missing and `what`, the object in words, empty for false
# positives; in both runs the coverage of the object, or the false-positive coverage of the image, and the object's IoU.
CHANGED = ["kind", *IMAGE, "track_id", "category", "what", "before", "after", "iou_before", "iou_after"]


def paired_objects(before: StoredRun, after: StoredRun) -> Iterator[pd.DataFrame]:
    """The evaluated object-frames of both runs, one per row, as `object_changes` sets them side by side, in parts.

    Raises:
        DataError: the runs did not evaluate the same object-frames, though their summaries say so.
    """
    for part in changes_in_parts(before.objects, after.objects, level=found_level(before.protocol)):
        alone = part[~part["change"].isin(["gained", "lost", "both", "neither"])]
        if len(alone):
            first = " ".join(str(alone.iloc[0][name]) for name in (*IMAGE, "track_id"))
            raise DataError(
                after.folder / "counts",
                expected=f"the object-frames of {before.folder}, whose reference has the same digest",
                got=f"at least {len(alone)} that only one has, first {first}",
                hint="run again what was changed by hand",
            )
        yield part


def sum_changes(
    parts: Iterable[pd.DataFrame], *, categories: Sequence[str], limit: int = LISTED
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Count the detections, and pick the object-frames that changed most.

    Args:
        parts: whole recordings, as `paired_objects` gives them.
        categories: of the protocol.
        limit: of object-frames of each kind; at most one of each track and kind, largest change of coverage first, of
            equals the largest object.

    Returns:
        detections: a row for each category and for all, `name` the index: `object_frames`, those detected `before` and
            `after`, and those `gained` and `lost`; `after - before == gained - lost`.
        frames: columns `CHANGED`, the object-frames that changed most.
    """
    counts: list[pd.DataFrame] = []

    def counted() -> Iterator[pd.DataFrame]:
        for rows in parts:
            lost, gained, both = (rows["change"] == change for change in ("lost", "gained", "both"))
            numbers = {run: rows[f"detected_{run}"].astype(bool) for run in ("before", "after")}
            numbers |= {"gained": gained, "lost": lost}
            counts.append(pd.DataFrame({"category": rows["category"], "object_frames": 1} | numbers))
            change = (rows["coverage_after"] - rows["coverage_before"]).astype(float)
            kinds = {Kind.LOST: lost, Kind.GAINED: gained}
            kinds |= {Kind.FELL: both & (change < 0), Kind.ROSE: both & (change > 0)}
            yield _of_kinds(rows, kinds, size=change.abs())

    def largest(rows: pd.DataFrame) -> pd.DataFrame:
        ranked = rows.sort_values(["size", "region_px"], ascending=False, kind="stable")
        return ranked.drop_duplicates(["kind", "recording", "track_id"]).groupby("kind").head(limit)

    changed = pick(counted(), largest)
    by_category = pd.concat(counts).groupby("category").sum().astype(int)
    by_category.loc[ALL_MOVING] = by_category.sum()
    detections = by_category.reindex([*categories, ALL_MOVING], fill_value=0).rename_axis("name")
    words = [f"{row['object_class']} '{row['track_id']}', {row['category'].replace('_', ' ')}, {row['range_m']:.1f} m"
             for row in changed.to_dict("records")]  # fmt: skip
    return detections, _by_kind(changed.assign(what=words), value="coverage")


def changed_images(before: StoredRun, after: StoredRun) -> pd.DataFrame:
    """The image with most more and the one with most fewer false positives; none where nothing changed."""
    counts = [run.frames.recordings() for run in (before, after)]

    def parts() -> Iterator[pd.DataFrame]:
        for group in group_recordings({name: rows for name, rows in counts[0].items() if name in counts[1]}) or [[]]:
            rows = merge_rows(_false_shares(before, group), _false_shares(after, group), on=IMAGE)
            rows = rows.sort_values(IMAGE, ignore_index=True)
            change = rows["share_after"] - rows["share_before"]
            yield _of_kinds(rows, {Kind.MORE_FALSE: change > 0, Kind.FEWER_FALSE: change < 0}, size=change.abs())

    def largest(rows: pd.DataFrame) -> pd.DataFrame:
        return rows.sort_values("size", ascending=False, kind="stable").drop_duplicates("kind")

    return _by_kind(pick(parts(), largest).assign(what=""), value="share")


def _of_kinds(rows: pd.DataFrame, kinds: Mapping[Kind, pd.Series[bool]], *, size: pd.Series[float]) -> pd.DataFrame:
    """The rows that changed, with the kind and the size of the change."""
    kind = np.select(list(kinds.values()), [str(one) for one in kinds], "")
    changed: pd.DataFrame = rows.assign(kind=kind, size=size).loc[kind != ""]
    return changed


def _by_kind(changed: pd.DataFrame, *, value: str) -> pd.DataFrame:
    """The columns `CHANGED`, by kind, the largest change first."""
    order = changed["kind"].map({str(kind): place for place, kind in enumerate(Kind)})
    named = changed.rename(columns={f"{value}_before": "before", f"{value}_after": "after"})
    return named.iloc[order.argsort(kind="stable")].reindex(columns=CHANGED)


def _false_shares(run: StoredRun, recordings: Sequence[str]) -> pd.DataFrame:
    frames = run.frames.read(recordings, [*IMAGE, "status", "width", "height", "fp_px"])
    return frames[frames["status"] == EVALUATED].assign(share=false_share)[[*IMAGE, "share"]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunComparison:
    """One run against the first.

    Attributes:
        before: the run compared against.
        after: the other run.
        images: how many each scored, and how many of these both did; all values are of the last.
        methods: of both, with the settings in which they differ.
        changes: of the metrics, as `metric_changes` gives them.
        detections: gained and lost, by category and of all, as `sum_changes` gives them.
        frames: those that changed most, columns `CHANGED`.
        notes: what a reader should know: on how many images the runs are compared, whether the data's files differ.
        pictures: of some of the frames, by the name of the file the row of `frames`.
        remarks: why other pictures could not be made.
    """

    before: StoredRun
    after: StoredRun
    images: tuple[int, int, int]
    methods: tuple[str, str]
    changes: pd.DataFrame
    detections: pd.DataFrame
    frames: pd.DataFrame
    notes: tuple[str, ...]
    pictures: Mapping[str, Mapping[Any, Any]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()


def changes_over_everything(comparison: RunComparison) -> pd.DataFrame:
    """The rows of all moving objects and of whole images, by metric."""
    return comparison.changes.drop(CATEGORY, level="breakdown").droplevel(["breakdown", "slice"])


def verdict_line(comparison: RunComparison) -> str:
    """One sentence: which headline metrics are better, worse, or not shown to differ."""
    overall, said = changes_over_everything(comparison)["verdict"], []
    for shown in Shown:
        names = [label for metric, label in HEADLINES.items() if overall.get(metric) == shown]
        if names:
            said.append(f"{shown.value}: {'; '.join(names)}")
    return f"{comparison.after.label} against {comparison.before.label}, over everything: {'. '.join(said)}."


def _notes(before: StoredRun, after: StoredRun, images: tuple[int, int, int]) -> tuple[str, ...]:
    notes = [f"Compared on the {images[2]} images that both scored."]
    if len(set(images)) > 1:
        notes[0] = notes[0][:-1] + f": {before.label} scored {images[0]}, {after.label} {images[1]}."
    notes += dict.fromkeys(run.summary.unreviewed for run in (before, after) if run.summary.unreviewed)
    found = differences(before.manifest, after.manifest)
    if any(difference.aspect is Aspect.DATA for difference in found):
        notes.append(
            "The files of the data set changed between the runs, though the reference on these images did not."
        )
    if code := [str(difference) for difference in found if difference.aspect in (Aspect.CODE, Aspect.METHOD_CODE)]:
        notes.append(f"Made by different code: {'; '.join(code)}.")
    return tuple(notes)


def _compare(first: StoredRun, other: StoredRun) -> RunComparison:
    before, after, common = pair_on_common_images(first, other)
    images = (before.summary.images.evaluated, after.summary.images.evaluated, common)
    categories = [str(category) for category in before.protocol.reference.categories]
    detections, objects = sum_changes(paired_objects(before, after), categories=categories)
    methods = name_methods([before.manifest, after.manifest])
    return RunComparison(
        before=before,
        after=after,
        images=images,
        methods=(methods[0], methods[1]),
        changes=metric_changes(before, after),
        detections=detections,
        frames=pd.concat([objects, changed_images(before, after)], ignore_index=True),
        notes=_notes(before, after, images),
    )


def compare_runs(runs: Sequence[StoredRun]) -> list[RunComparison]:
    """Compare the first of several runs with each of the others, on the images that both scored.

    Raises:
        DataError: a table is damaged.
        UsageError: no image was scored by both, or the references differ on these.
    """
    return [_compare(runs[0], other) for other in runs[1:]]
