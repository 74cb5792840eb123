"""A comparison of runs: the first against each of the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.sums import sum_run
from bench.reporting.compare.changes import (
    HEADLINES,
    ChangedFrame,
    DetectionCounts,
    RowChange,
    Verdict,
    changed_images,
    headline_changes,
    paired_objects,
    row_changes,
    sum_changes,
)
from bench.reporting.compare.runs import Pair, StoredRun, differing_settings, on_common_images, settings_text


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunComparison:
    """One run against the first.

    Attributes:
        before: the run compared against.
        after: the other run.
        images: how many each scored, and how many of these both did; all figures are of the last.
        methods: of both, with the settings in which they differ.
        rows: of the table.
        detections: gained and lost, by category and of all.
        frames: that changed most.
        notes: what a reader should know: on how many images the runs are compared, whether the data's files differ.
    """

    before: StoredRun
    after: StoredRun
    images: tuple[int, int, int]
    methods: tuple[str, str]
    rows: list[RowChange]
    detections: list[DetectionCounts]
    frames: list[ChangedFrame]
    notes: tuple[str, ...]


def compare_runs(runs: Sequence[StoredRun]) -> list[RunComparison]:
    """Compare the first of several runs with each of the others, on the images that both scored.

    Raises:
        DataError: a table is damaged.
        UsageError: no image was scored by both, or the references differ on these.
    """
    return [_compare(on_common_images(runs[0], other)) for other in runs[1:]]


def _compare(pair: Pair) -> RunComparison:
    before, after = pair.before, pair.after
    sums = [sum_run(run.objects, run.frames, protocol=run.rules) for run in (before, after)]
    rows = row_changes(sums[0], sums[1], rules=before.rules)
    categories = tuple(str(category) for category in before.rules.reference.categories)
    changes = sum_changes(paired_objects(before, after), categories=categories)
    return RunComparison(
        before=before,
        after=after,
        images=pair.images,
        methods=_methods(before, after),
        rows=rows,
        detections=changes.detections,
        frames=[*changes.frames, *changed_images(before, after)],
        notes=(pair.line, *_notes(before, after)),
    )


def verdict_line(comparison: RunComparison) -> str:
    """One sentence: which headline metrics are better, worse, or not shown to differ; and in which categories."""
    overall = headline_changes(comparison.rows)
    said = []
    for verdict in Verdict:
        names = [HEADLINES[metric] for metric, found in overall if found.verdict is verdict]
        if names:
            said.append(f"{verdict.value}: {'; '.join(names)}")
    return f"{comparison.after.label} against {comparison.before.label}, over everything: {'. '.join(said)}."


def category_line(comparison: RunComparison) -> str:
    """One sentence about the categories: what is shown there, and which are too small to be judged."""
    rows = [row for row in comparison.rows if row.name in {c.name for c in comparison.detections[:-1]}]
    said = []
    for verdict in (Verdict.BETTER, Verdict.WORSE):
        cells = [f"{r.label} ({HEADLINES[m]})" for r in rows for m, c in r.metrics.items() if c.verdict is verdict]
        if cells:
            said.append(f"{verdict.value}: {', '.join(cells)}")
    few = {
        row.label: min(cell.change.recordings for cell in row.metrics.values() if cell.verdict is Verdict.TOO_FEW)
        for row in rows
        if any(cell.verdict is Verdict.TOO_FEW for cell in row.metrics.values())
    }
    if few:
        told = ", ".join(f"{label} ({recordings})" for label, recordings in few.items())
        said.append(f"{Verdict.TOO_FEW.value} in at least one metric, {FEWEST_RECORDINGS} are needed: {told}")
    return f"By category: {'. '.join(said) or 'nothing that the data can show'}."


def _methods(first: StoredRun, other: StoredRun) -> tuple[str, str]:
    settings = differing_settings([first.summary, other.summary])
    one, two = (
        f"{run.summary.method.name} ({settings_text(own)})" if own else run.summary.method.name
        for run, own in zip((first, other), settings, strict=True)
    )
    return one, two


def _notes(first: StoredRun, other: StoredRun) -> tuple[str, ...]:
    notes = []
    one, two = first.summary.provenance, other.summary.provenance
    if one.data_fingerprint != two.data_fingerprint:
        notes.append(
            "The files of the data set changed between the runs, though the reference on these images did not."
        )
    if one.commit != two.commit:
        notes.append(f"Made by different code: {(one.commit or 'none')[:8]} and {(two.commit or 'none')[:8]}.")
    changed = sorted(
        name for name in one.libraries | two.libraries if one.libraries.get(name) != two.libraries.get(name)
    )
    if changed:
        notes.append(f"Made with other versions of: {', '.join(changed)}.")
    return tuple(notes)
