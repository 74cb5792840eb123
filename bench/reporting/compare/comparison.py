"""A comparison of runs: the first against each of the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bench.reporting.compare.changes import HEADLINES, RowChange, headline_changes, row_changes, sheet_of
from bench.reporting.compare.detections import (
    ChangedFrame,
    DetectionCounts,
    changed_images,
    paired_objects,
    sum_changes,
)
from bench.reporting.compare.stored_runs import StoredRun, differing_settings, settings_text
from bench.reporting.compare.verdicts import Verdict


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunComparison:
    """One run against the first.

    Attributes:
        before: the run compared against.
        after: the other run.
        methods: of both, with the settings in which they differ.
        rows: of the table.
        detections: gained and lost, by category and of all.
        frames: that changed most.
        notes: what a reader should know, for example that the data's files differ.
    """

    before: StoredRun
    after: StoredRun
    methods: tuple[str, str]
    rows: list[RowChange]
    detections: list[DetectionCounts]
    frames: list[ChangedFrame]
    notes: tuple[str, ...]


def compare_runs(runs: Sequence[StoredRun]) -> list[RunComparison]:
    """Compare the first of several comparable runs with each of the others."""
    first, sheets = runs[0], [sheet_of(run) for run in runs]
    found = []
    for other, sheet in zip(runs[1:], sheets[1:], strict=True):
        rows = row_changes(sheets[0], sheet, summaries=(first.summary, other.summary), rules=first.rules)
        categories = tuple(str(category) for category in first.rules.reference.categories)
        changes = sum_changes(paired_objects(first, other), categories=categories)
        found.append(
            RunComparison(
                before=first,
                after=other,
                methods=_methods(first, other),
                rows=rows,
                detections=changes.detections,
                frames=[*changes.frames, *changed_images(first, other)],
                notes=_notes(first, other),
            )
        )
    return found


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
    few = [
        f"{row.label} ({row.recordings})"
        for row in rows
        if any(cell.verdict is Verdict.TOO_FEW for cell in row.metrics.values())
    ]
    if few:
        said.append(f"{Verdict.TOO_FEW.value} in at least one metric: {', '.join(few)}")
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
        notes.append("The files of the data set changed between the runs, though the reference did not.")
    if one.commit != two.commit:
        notes.append(f"Made by different code: {(one.commit or 'none')[:8]} and {(two.commit or 'none')[:8]}.")
    changed = sorted(
        name for name in one.libraries | two.libraries if one.libraries.get(name) != two.libraries.get(name)
    )
    if changed:
        notes.append(f"Made with other versions of: {', '.join(changed)}.")
    return tuple(notes)
