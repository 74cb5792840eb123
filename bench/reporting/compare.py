"""Runs against each other: which compare, on the images that they scored in common, what changed and what is shown.

Only runs of the same data set, split and protocol are compared, on the images that they scored in common, and only if
their references agree on these. The first run is the one compared against. The metrics are those of
`bench.evaluation.comparison`, as one table; a verdict is read off each row of it. A comparison is written as a page
with pictures of what changed most, Markdown and CSV.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial, reduce
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pandas as pd

from bench.errors import UsageError
from bench.evaluation.comparison import (
    COMPARED,
    SIGNIFICANCE,
    SLICE,
    compare_sums,
    excludes_no_change,
    holm,
    object_changes,
)
from bench.evaluation.definitions import false_share, find_metric, headlines, image_metrics, object_metrics
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.rows import IMAGE, merge_rows, pick
from bench.evaluation.sums import ALL_MOVING, CATEGORY, FRAMES, recording_values
from bench.execution import Progress
from bench.harness.counts import TableName, stored_recordings
from bench.harness.digests import short_digest
from bench.harness.frames import FramePipeline, ProcessedFrame
from bench.harness.manifest import Aspect, Manifest, all_settings, differences
from bench.harness.stored import StoredRun, read_run, reference_digest, refuse_unscored
from bench.plain_text import counted
from bench.reporting import formats
from bench.reporting.document import (
    Bar,
    Block,
    Cell,
    Column,
    Group,
    Heads,
    Paragraph,
    Picture,
    Report,
    Style,
    Table,
    section,
)


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


# Of the images of each run of a table, so many must be common: one run that scored a few would else shrink it for all.
LEAST_COMMON = 0.5


def reference_of(run: StoredRun) -> str:
    """Digest of the reference of a run, on all its images or on those that were chosen."""
    return str(run.manifest.reference) if run.common is None else reference_digest(run.parts)


def on_common_images(runs: Sequence[StoredRun]) -> list[StoredRun]:
    """Restrict runs that compare to the images that all of them scored: their rows, summed again; not their summary.

    Runs of the same reference scored the same images, and stay as they are.
    """
    of_reference = {reference_of(run): run for run in runs}
    if len(of_reference) == 1:
        return [*runs]
    images = [pd.concat(run.evaluated("frames", IMAGE), ignore_index=True) for run in of_reference.values()]
    common = reduce(partial(merge_rows, on=IMAGE), images)
    return [replace(run, common=common) for run in runs]


def in_one_table(runs: Sequence[StoredRun], other: StoredRun) -> bool:
    """Whether a run stands in one table with others: enough images in common, and the same reference on them."""
    if any(reference_of(run) == reference_of(other) for run in runs):
        return True
    first, *_, last = on_common_images([*runs, other])
    scored = max(run.summary.images.evaluated for run in (*runs, other))
    common = 0 if first.common is None else len(first.common)
    return common >= max(LEAST_COMMON * scored, 1) and reference_of(first) == reference_of(last)


def pair_on_common_images(before: StoredRun, after: StoredRun) -> tuple[StoredRun, StoredRun]:
    """Restrict two runs of the same data and protocol to the images that both scored.

    Raises:
        DataError: a table is damaged.
        UsageError: no image was scored by both, or their references differ on these; says in what.
    """
    for run in (before, after):
        refuse_unscored(run.summary, run.folder)
    first, second = on_common_images([before, after])
    if first.common is not None:
        refused, common = f"{before.folder} and {after.folder} do not compare: ", len(first.common)
        if not common:
            scored = [run.summary.images.evaluated for run in (before, after)]
            raise UsageError(f"{refused}no image was scored by both; the first has {scored[0]}, the second {scored[1]}")
        if reference_of(first) != reference_of(second):
            raise UsageError(
                f"{refused}their references differ on the {counted(common, 'image')} that both scored: annotations, "
                "other data or the code that builds references changed; run both again, on the same data with one "
                "version"
            )
    return first, second


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
        beside them `label` of the slice, `p_holm` and `verdict` (missing for what is no headline).
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
    table["label"] = [formats.LABELS[name] for _, name, _ in keys]
    return table


def what_is_shown_of(before: StoredRun, after: StoredRun, metric: str) -> Shown:
    """The verdict on a headline metric over all moving objects."""
    return Shown(str(metric_changes(before, after)["verdict"][ALL_MOVING, ALL_MOVING, metric]))


# What was gained and lost.

LISTED = 50  # of each kind, one per track


class Kind(StrEnum):
    """Reason that a frame is worth a look."""

    LOST = "newly missed"
    GAINED = "newly detected"
    FELL = "coverage fell"
    ROSE = "coverage rose"
    MORE_FALSE = "more false positives"
    FEWER_FALSE = "fewer false positives"


# Columns of the frames that changed: `track_id` and `category` missing and `what`, the object in words, empty for false
# positives; in both runs the coverage of the object, or the false-positive coverage of the image.
CHANGED = ["kind", *IMAGE, "track_id", "category", "what", "before", "after"]


def changed_objects(before: StoredRun, after: StoredRun) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Count the detections, and pick the object-frames that changed most.

    Returns:
        detections: a row for each category and for all, `name` the index: `object_frames`, those detected `before` and
            `after`, and those `gained` and `lost`; `after - before == gained - lost`.
        frames: columns `CHANGED`, of each kind at most `LISTED`, and at most one of each track; the largest change of
            coverage first, of equals the largest object.
    """
    counts: list[pd.DataFrame] = []

    def parts() -> Iterator[pd.DataFrame]:
        for sides in _pairs(before, after, "objects", COMPARED):
            rows = object_changes(*sides, level=formats.found_level(before.protocol))
            lost, gained, both = (rows["change"] == change for change in ("lost", "gained", "both"))
            numbers = {run: rows[f"detected_{run}"].astype(bool) for run in ("before", "after")}
            numbers |= {"gained": gained, "lost": lost}
            counts.append(rows[["category"]].assign(object_frames=1, **numbers).groupby("category").sum())
            change = (rows["coverage_after"] - rows["coverage_before"]).astype(float)
            kinds = {Kind.LOST: lost, Kind.GAINED: gained}
            kinds |= {Kind.FELL: both & (change < 0), Kind.ROSE: both & (change > 0)}
            yield _of_kinds(rows, kinds, size=change.abs())

    def largest(rows: pd.DataFrame) -> pd.DataFrame:
        ranked = rows.sort_values(["size", "region_px"], ascending=False, kind="stable")
        return ranked.drop_duplicates(["kind", "recording", "track_id"]).groupby("kind").head(LISTED)

    listed = pick(parts(), largest)
    by_category = pd.concat(counts).groupby("category").sum().astype(int)
    by_category.loc[ALL_MOVING] = by_category.sum()
    names = [*map(str, before.protocol.reference.categories), ALL_MOVING]
    words = [f"{row['object_class']} '{row['track_id']}', {row['category'].replace('_', ' ')}, {row['range_m']:.1f} m"
             for row in listed.to_dict("records")]  # fmt: skip
    detections = by_category.reindex(names, fill_value=0).rename_axis("name")
    return detections, _by_kind(listed.assign(what=words), value="coverage")


def changed_images(before: StoredRun, after: StoredRun) -> pd.DataFrame:
    """The image with most more and the one with most fewer false positives; none where nothing changed."""

    def parts() -> Iterator[pd.DataFrame]:
        for sides in _pairs(before, after, "frames", [*IMAGE, "width", "height", "fp_px"]):
            rows = merge_rows(*(frames.assign(share=false_share)[[*IMAGE, "share"]] for frames in sides), on=IMAGE)
            change = rows["share_after"] - rows["share_before"]
            kinds = {Kind.MORE_FALSE: change > 0, Kind.FEWER_FALSE: change < 0}
            yield _of_kinds(rows, kinds, size=change.abs()).sort_values(IMAGE)

    def largest(rows: pd.DataFrame) -> pd.DataFrame:
        return rows.sort_values("size", ascending=False, kind="stable").drop_duplicates("kind")

    return _by_kind(pick(parts(), largest).assign(what=""), value="share")


def _pairs(
    before: StoredRun, after: StoredRun, table: TableName, columns: Sequence[str]
) -> Iterator[list[pd.DataFrame]]:
    """The evaluated rows of both runs, a recording at a time."""
    for name in stored_recordings(before.folder):
        yield [run.evaluated_of(name, table, columns) for run in (before, after)]


def _of_kinds(rows: pd.DataFrame, kinds: Mapping[Kind, pd.Series[bool]], *, size: pd.Series[float]) -> pd.DataFrame:
    """The rows that changed, with the kind and the size of the change."""
    kind = np.select(list(kinds.values()), [str(name) for name in kinds], "")
    changed: pd.DataFrame = rows.assign(kind=kind, size=size).loc[kind != ""]
    return changed


def _by_kind(changed: pd.DataFrame, *, value: str) -> pd.DataFrame:
    """The columns `CHANGED`, by kind, the largest change first."""
    order = changed["kind"].map({str(kind): place for place, kind in enumerate(Kind)})
    named = changed.rename(columns={f"{value}_before": "before", f"{value}_after": "after"})
    return named.iloc[order.argsort(kind="stable")].reindex(columns=CHANGED)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunComparison:
    """One run against the first.

    Attributes:
        before: the run compared against.
        after: the other run.
        images: how many each scored, and how many of these both did; all values are of the last.
        methods: of both, with the settings in which they differ.
        changes: of the metrics, as `metric_changes` gives them.
        detections: gained and lost, by category and of all, as `changed_objects` gives them.
        frames: those that changed most, columns `CHANGED`.
        notes: what a reader should know: on how many images the runs are compared, whether the data's files differ.
        pictures: of the frames that changed most of each kind.
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
    pictures: tuple[Picture, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def over_everything(self) -> pd.DataFrame:
        """The changes of all moving objects and of whole images, by metric."""
        return self.changes.drop(CATEGORY, level="breakdown").droplevel(["breakdown", "slice"])


def compare_runs(folders: Sequence[Path]) -> list[RunComparison]:
    """Compare the first of several runs with each of the others, on the images that both scored.

    Runs of equal names get a number from the second on.

    Raises:
        DataError: a run or a table of it is damaged.
        UsageError: fewer than two runs, or runs of different data, split, protocol or reference, or no common image.
    """
    if len(folders) < 2:
        raise UsageError(f"compare: expected at least two runs, got {len(folders)}")
    runs: list[StoredRun] = []
    for run in map(read_run, folders):
        same = sum(run.label == other.label.partition(" (")[0] for other in runs)
        runs.append(replace(run, label=f"{run.label} ({same + 1})") if same else run)
        for difference in differences(runs[0].manifest, run.manifest):
            if not difference.comparable:
                raise UsageError(f"{runs[0].folder} and {run.folder} do not compare: {difference}")
    return [_compare(runs[0], other) for other in runs[1:]]


def _compare(first: StoredRun, other: StoredRun) -> RunComparison:
    before, after = pair_on_common_images(first, other)
    differing = differing_settings([before.manifest, after.manifest])
    images = (before.summary.images.evaluated, after.summary.images.evaluated, before.metrics.images.evaluated)
    detections, objects = changed_objects(before, after)
    return RunComparison(
        before=before,
        after=after,
        images=images,
        methods=(_called(before, differing[0]), _called(after, differing[1])),
        changes=metric_changes(before, after),
        detections=detections,
        frames=pd.concat([objects, changed_images(before, after)], ignore_index=True),
        notes=_notes(before, after, images),
    )


def _called(run: StoredRun, settings: Mapping[str, object]) -> str:
    """For example "spherical (flow=dis, weights.anti_parallel=0)", settings as `--set` takes them."""
    text = ", ".join(f"{setting}={value}" for setting, value in settings.items())
    return f"{run.manifest.method.name} ({text})" if text else run.manifest.method.name


def _notes(before: StoredRun, after: StoredRun, images: tuple[int, int, int]) -> tuple[str, ...]:
    scored = f": {before.label} scored {images[0]}, {after.label} {images[1]}" if len(set(images)) > 1 else ""
    notes = [f"Compared on the {counted(images[2], 'image')} that both scored{scored}."]
    notes += dict.fromkeys(run.summary.unreviewed for run in (before, after) if run.summary.unreviewed)
    changed = differences(before.manifest, after.manifest)
    if any(difference.aspect is Aspect.DATA for difference in changed):
        notes.append(
            "The files of the data set changed between the runs, though the reference on these images did not."
        )
    if code := [str(difference) for difference in changed if difference.aspect in (Aspect.CODE, Aspect.METHOD_CODE)]:
        notes.append(f"Made by different code: {'; '.join(code)}.")
    return tuple(notes)


# For people.

NOTE = (
    "Differences are after minus before, in percentage points, with 95 % intervals by recording, in pairs (jackknife). "
    "p: two-sided, of no difference, corrected after Holm over the rows of one metric (the categories and all moving "
    "objects), for each pair of runs by itself. Better or worse is said of the four headlines only, and only if the "
    "interval excludes 0 and the corrected p-value is at most 5 %; both need "
    f"{FEWEST_RECORDINGS} recordings with cases of both runs: with fewer, the same change in all of them could be "
    "chance."
)
_TERMINAL_NOTE = (
    "Differences in percentage points, with 95 % intervals by recording, in pairs; p: corrected over the rows of a "
    f"metric; a verdict needs {FEWEST_RECORDINGS} recordings (recs). All metrics: compare.csv."
)
STYLES: dict[str, Style] = {Shown.BETTER: "good", Shown.WORSE: "bad"}
FIRST_PICTURES = 4  # that a reader sees before the tables


def p_text(p_value: float) -> str:
    """For example "0.012" or "<0.001"; "" for NaN."""
    if math.isnan(p_value):
        return ""
    return "<0.001" if p_value < 0.001 else f"{p_value:.3f}"


_COLUMNS: dict[str, Heads] = {
    "metric": Column("Metric", lambda name: find_metric(name).label),
    "label": "Type",
    "verdict": Column("Verdict", lambda verdict: Cell(str(verdict), style=STYLES.get(verdict, ""))),
    "recordings": "Recs",
    "before": Column("before", formats.hundredths),
    "after": Column("after", formats.hundredths),
    "difference": "change",
    "ci95": Column("95 %", formats.points_interval),
    "p_holm": Column("p (Holm)", p_text),
}


def verdict_line(comparison: RunComparison) -> str:
    """One sentence: which headline metrics are better, worse, or not shown to differ."""
    overall, said = comparison.over_everything["verdict"], []
    for shown in Shown:
        names = [label for metric, label in HEADLINES.items() if overall.get(metric) == shown]
        if names:
            said.append(f"{shown.value.capitalize()}: {'; '.join(names)}.")
    return f"{comparison.after.label} against {comparison.before.label}, over everything. {' '.join(said)}"


def terminal_report(comparison: RunComparison) -> list[Block]:
    """The metrics that are judged, for 100 columns."""
    return [_headline_table(comparison), Paragraph(_TERMINAL_NOTE, "dim")]


def _pair(comparison: RunComparison, out: Path) -> Iterator[Block]:
    """The verdict first, then pictures, then the tables that it rests on."""
    yield Paragraph(verdict_line(comparison), "strong")
    yield verdict_tiles(comparison)
    sides = {"before": comparison.before, "after": comparison.after}
    rows = [
        [side, Cell(run.label, link=_page_address(run, out)), "" if method == run.label else method]
        for (side, run), method in zip(sides.items(), comparison.methods, strict=True)
    ]
    yield Table(columns=["", "", ""], rows=rows, words=3, look="about")
    yield from map(Paragraph, comparison.notes)
    first, others = comparison.pictures[:FIRST_PICTURES], comparison.pictures[FIRST_PICTURES:]
    yield Group(look="pairs", blocks=first)
    yield _headline_table(comparison)
    if others:
        more = Group(look="pairs", blocks=others)
        yield Group(look="folded", title=counted(len(others), "more picture"), blocks=[more])
    for table in (_recording_table(comparison), _detection_table(comparison), _frame_table(comparison.frames)):
        yield Group(look="folded", title=table.title, blocks=[replace(table, title="")])
    yield from (Paragraph(remark, "dim") for remark in comparison.remarks)


def _page_address(run: StoredRun, out: Path) -> str:
    """Address of a run's page as seen from a folder; "" where the run has none."""
    page = run.folder / "index.html"
    return quote(Path(os.path.relpath(page.resolve(), out.resolve())).as_posix()) if page.is_file() else ""


def verdict_tiles(comparison: RunComparison) -> Table:
    """A card for each metric that is judged, over everything: the change, its interval, what is shown."""
    overall = comparison.over_everything
    overall = overall.loc[[name for name in HEADLINES if name in overall.index]]
    cells = []
    for row, change in zip(overall.to_dict("records"), _change_cells(overall), strict=True):
        p_value = p_text(row["p_holm"])
        interval = "" if row["ci95"] is None else f"95 %: {formats.points_interval(row['ci95'])}"
        about = f"{formats.hundredths(row['before'])} to {formats.hundredths(row['after'])} %"
        below = (str(row["verdict"]), about, ", ".join(filter(None, (interval, p_value and f"p {p_value}"))))
        cells.append(replace(change, text=f"{change.text} points", below=below, style=change.style or "strong"))
    headings = [HEADLINES[str(name)] for name in overall.index]
    return Table(columns=headings, rows=[cells], words=0, look="tiles")


def _change_cells(rows: pd.DataFrame) -> list[Cell]:
    """The differences as dots with their intervals on one scale, in the colour of what is shown."""
    ends = [abs(end) for ci95 in rows["ci95"] if ci95 is not None for end in ci95]
    scale = 2.1 * max([*ends, *rows["difference"].abs().dropna(), 1e-9])
    cells = []
    for difference, ci95, verdict in zip(rows["difference"], rows["ci95"], rows["verdict"], strict=True):
        interval = None if ci95 is None else (0.5 + ci95[0] / scale, 0.5 + ci95[1] / scale)
        bar = Bar(share=0.5 + difference / scale, interval=interval, tick=0.5, dot=True)
        cells.append(
            Cell(formats.points(difference), style=STYLES.get(verdict, ""), bar=None if math.isnan(difference) else bar)
        )
    return cells


def _headline_table(comparison: RunComparison) -> Table:
    """The metrics that are judged, by kind of motion, with their verdicts; kinds without object-frames are left out."""
    held = comparison.changes[comparison.changes["frames_before"] > 0].reset_index()
    rows = pd.concat([held[held["metric"] == metric] for metric in HEADLINES])
    rows = rows.assign(difference=pd.Series(_change_cells(rows), rows.index, dtype=object))
    title = f"{comparison.after.label} (after) against {comparison.before.label} (before), percent"
    return Table(title=title, columns=_COLUMNS, rows=rows, words=3)


def _recording_table(comparison: RunComparison) -> Table:
    """The metrics that are judged, by recording: all moving objects of each, and its whole images."""
    sides = {"before": comparison.before, "after": comparison.after}
    values = pd.concat({side: recording_values(run.sums)[0] for side, run in sides.items()}, axis=1).sort_index()
    columns = [Column(f"{label}: {side}", formats.hundredths) for label in HEADLINES.values() for side in sides]
    return Table(
        title="By recording, percent, before and after",
        columns=["Recording", *columns],
        rows=values[[(side, name) for name in HEADLINES for side in sides]].reset_index(),
    )


def _detection_table(comparison: RunComparison) -> Table:
    return Table(
        title=f"Object-frames gained and lost: found by {formats.found_by(comparison.before.protocol)}",
        columns=["Type", "Object-frames", "detected before", "after", "newly detected", "newly missed"],
        rows=comparison.detections.rename(index=formats.LABELS).reset_index(),
        note=formats.CORE if formats.found_level(comparison.before.protocol) else "",
    )


def _frame_table(frames: pd.DataFrame) -> Table:
    return Table(
        title=f"Frames that changed most: at most {LISTED} of a kind, one per object",
        columns=["Frame", _COLUMNS["before"], _COLUMNS["after"]],
        rows=[[frame_title(frame), frame["before"], frame["after"]] for frame in frames.to_dict("records")],
        note="Percent of the object that is marked, or of the image that is wrongly marked.",
    )


def frame_title(frame: Mapping[Any, Any]) -> str:
    """For example "newly missed: pedestrian 'a', crossing, 5.0 m (drive-1, camera front, 1.20 s)", of `CHANGED`."""
    what = f"{frame['kind']}: {frame['what']}" if frame["what"] else frame["kind"]
    return f"{what} ({formats.image_name(frame['recording'], frame['camera'], frame['timestamp_ns'])})"


def report(comparisons: Sequence[RunComparison], *, out: Path) -> Report:
    """The first run with each of the others; of numbers a line per pair of runs, row and metric, ratios in [0, 1].

    Args:
        comparisons: with the same first run.
        out: folder from which links to runs lead.
    """
    first = comparisons[0].before.manifest
    data = first.dataset
    about = (
        f"Data set {data.name}, {data.split or 'all recordings'}, protocol {first.protocol.name} "
        f"({short_digest(first.protocol.digest)}), reference {short_digest(str(first.reference))}."
    )
    sections = []
    for number, pair in enumerate(comparisons, start=1):
        title = f"{pair.after.label} against {pair.before.label}" if comparisons[1:] else "What is shown"
        sections.append(section(f"pair-{number}", title, _pair(pair, out)))
    how = section("how", "How to read it", [Paragraph(about), Paragraph(NOTE)])
    tables = {(c.before.label, c.after.label): _numbers(c) for c in comparisons}
    return Report(
        title=f"{', '.join(c.after.label for c in comparisons)} against {comparisons[0].before.label}",
        blocks=[*sections, how],
        numbers=pd.concat(tables, names=["before_run", "after_run"]).droplevel(2).reset_index(),
        page=True,
    )


def _numbers(comparison: RunComparison) -> pd.DataFrame:
    """A line for each row and metric."""
    table = comparison.changes.reset_index().rename(columns={"slice": "row", "frames_before": "frames"})
    table[["ci95_low", "ci95_high"]] = [ci95 or (math.nan, math.nan) for ci95 in table["ci95"]]
    table[["images_before", "images_after", "images_compared"]] = comparison.images
    counts = ["p_value", "cases_before", "cases_after", "recordings"]
    shown = ["row", "frames", "metric", "verdict", "before", "after", "difference", *counts, "ci95_low", "ci95_high"]
    return table[[*shown, "p_holm", "images_before", "images_after", "images_compared"]]


PICTURED = 2  # frames of each kind


def _with_pictures(comparison: RunComparison, progress: Progress | None) -> RunComparison:
    """The comparison with pictures of the frames that changed most, as both methods were scored on them.

    A line of its remarks gives each reason why one could not be made.
    """
    from bench.reporting.figures import figure_uri  # matplotlib, which a table need not wait for
    from bench.reporting.frame import draw_frames, scored_layers
    from bench.reporting.frame_pictures import draw_images

    runs = (comparison.before, comparison.after)
    labels = [
        run.label if method == run.label else f"{run.label}: {method}"
        for run, method in zip(runs, comparison.methods, strict=True)
    ]
    largest = comparison.frames.groupby("kind", sort=False).head(PICTURED).to_dict("records")
    keys = {frame_title(row): (row["recording"], row["camera"], row["timestamp_ns"]) for row in largest}

    def draw(key: tuple[str, str, int], both: Sequence[ProcessedFrame], _: FramePipeline) -> str:
        layers = [scored_layers(processed, label=label) for processed, label in zip(both, labels, strict=True)]
        return figure_uri(draw_frames(layers, name=formats.image_name(*key)))

    drawn, problems = draw_images(runs, keys.values(), draw, progress=progress)
    pictures = tuple(Picture(drawn[key], title, title) for title, key in keys.items() if key in drawn)
    return replace(comparison, pictures=pictures, remarks=tuple(f"no picture: {problem}" for problem in problems))


def write_comparison(
    folders: Sequence[Path],
    out: Path,
    *,
    pictures: bool = True,
    progress: Progress | None = None,
) -> tuple[list[RunComparison], tuple[Path, ...]]:
    """Compare runs and write `compare.html`, `.md` and `.csv`, each whole or not at all.

    Args:
        folders: of the runs, the one compared against first.
        out: folder, is made.
        pictures: show the frames that changed most on the page; needs the data set.
        progress: called with the pictures done and their number, for each pair anew.

    Returns:
        comparisons: the first run with each of the others.
        files: their paths.

    Raises:
        DataError: a run is damaged.
        UsageError: fewer than two runs, or runs that do not compare.
    """
    comparisons = compare_runs(folders)
    if pictures:
        comparisons = [_with_pictures(comparison, progress) for comparison in comparisons]
    return comparisons, report(comparisons, out=out).write(out, "compare")
