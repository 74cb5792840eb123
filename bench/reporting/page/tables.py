"""The tables of a run's page, in the order of the page."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from bench.evaluation import Metric, find_metric
from bench.evaluation.summary import ObjectMetrics, Summary
from bench.evaluation.sums import recording_values
from bench.harness.digests import short_digest
from bench.harness.stored import StoredRun
from bench.reporting.document import Bar, Cell, Column, Table
from bench.reporting.formats import chance_of, metric_cell, percent
from bench.reporting.page.worst import Card

COUNTS = ("object-frames", "objects", "recordings")
BREAKDOWN_METRICS = ("iou", "tpr_all", "detection_rate_50", "detection_rate", "unknown_share")
LISTED_RECORDINGS = 200
REASONS = {
    "unclear": "flagged as unclear by the annotation",
    "class_not_in_protocol": "a class that the protocol does not score",
    "motion_unknown": "no velocity is known",
    "category_not_in_protocol": "a kind of motion that the protocol does not score",
    "out_of_view": "outside of the lens's view",
    "no_sweep": "no lidar sweep near the image",
    "beyond_range": "farther away than the protocol's range limit",
    "too_few_points": "fewer lidar points than the protocol asks for",
    "polygon_too_small": "a reference polygon below the protocol's area",
    "occluded": "wholly behind nearer objects",
}


def bar_cell(metric: Metric, *notes: str, lowest: bool = False) -> Cell:
    """A metric with its bar, and its interval and notes below."""
    cell = metric_cell(metric)
    if math.isnan(metric.value):
        return cell
    below = tuple(filter(None, ("lowest" if lowest else "", *cell.below, *notes)))
    bar = Bar(share=metric.value, interval=metric.ci95)
    return replace(cell, below=below, style="bad" if lowest else "strong", bar=bar)


def bound_note(name: str, row: ObjectMetrics) -> str:
    """Return what bounds a metric of a row: the chance level of a detection rate, the ceiling of IoU; "" for none."""
    other = chance_of(name) if name.startswith("detection_rate") else f"ceiling_{name}"
    if other not in row.metric_names() or name == "tpr_all" or math.isnan(row.metric(other).value):
        return ""
    return f"{other.partition('_')[0]} {percent(row.metric(other).value)}"


def breakdown_table(caption: str, heading: str, rows: Mapping[str, ObjectMetrics], *, lowest: str | None) -> Table:
    """One way to sort the object-frames.

    Args:
        caption: of the table.
        heading: of its first column.
        rows: by name, those without cases included; what all of them have is shown.
        lowest: the row that is marked.
    """
    metrics = [name for name in BREAKDOWN_METRICS if all(name in row.metric_names() for row in rows.values())]
    return Table(
        title=caption,
        columns=[heading, *(find_metric(name).label for name in metrics), *COUNTS],
        rows=[
            [key]
            + [bar_cell(row.metric(n), bound_note(n, row), lowest=n == "iou" and key == lowest) for n in metrics]
            + [row.object_frames, row.tracks, row.recordings]
            for key, row in rows.items()
        ],
        look="metrics",
    )


def recording_table(run: StoredRun, cards: Sequence[Card]) -> Table:
    """The recordings with the lowest IoU first, those without object-frames last; at most `LISTED_RECORDINGS`."""
    values, cases = recording_values(run.sums)
    found = values[["iou", "tpr_all", "false_positive_coverage"]].assign(
        object_frames=cases["iou"], images=cases["false_positive_coverage"]
    )
    found = found.reset_index().sort_values(["iou", "recording"], ignore_index=True)
    first = {card.key[0]: card.element for card in reversed(cards)}
    shares = [Column(heading, percent) for heading in ("IoU, all", "TPR, all", "wrongly marked")]
    counts = [Column(heading, "{:.0f}".format) for heading in ("object-frames", "images")]
    shown = f", {LISTED_RECORDINGS} of {len(found)}" if len(found) > LISTED_RECORDINGS else ""
    return Table(
        title=f"By recording, over all its object-frames, the lowest IoU first{shown}",
        columns=["recording", *shares, *counts, "to look at"],
        rows=[
            [Cell(name, link="#frames"), *values, Cell("worst case", link=f"#{first[name]}") if name in first else None]
            for name, *values in found[:LISTED_RECORDINGS].itertuples(index=False)
        ],
        look="metrics",
    )


def cause_table(found: Summary, *, of_recordings: str) -> Table | None:
    """The causes of false marks, the largest first; None where the method names none."""
    causes = {name: cause for name, cause in found.false_positive_causes.items() if not math.isnan(cause.value)}
    ordered = sorted(causes.items(), key=lambda item: -item[1].value)
    return (
        Table(
            title=f"Share of the falsely marked pixels{of_recordings}",
            columns=["cause", "share"],
            rows=[[name.replace("_", " "), bar_cell(cause)] for name, cause in ordered],
            look="bars",
        )
        if causes
        else None
    )


def time_table(stage_seconds: Mapping[str, float], *, images: int) -> Table:
    """The stages of a run, the longest first."""
    total = sum(stage_seconds.values()) or 1.0
    return Table(
        title="Share of the time by stage",
        columns=["stage", "share"],
        rows=[
            [name, Cell(f"{1000 * seconds / max(images, 1):.1f} ms per image ({seconds:.1f} s)",
                        bar=Bar(share=seconds / total))]
            for name, seconds in sorted(stage_seconds.items(), key=lambda item: -item[1])
        ],
        look="bars",
    )  # fmt: skip


def origin_table(run: StoredRun) -> Table:
    """Table of what made a run: data, method, protocol, code."""
    manifest, made = run.manifest, run.summary.provenance
    data, method, protocol, code = manifest.dataset, manifest.method, manifest.protocol, manifest.code
    libraries = [f"{name} {version}" for name, version in code.libraries.items()]
    return Table(
        title="Origin of the run",
        columns=["", ""],
        rows=[
            ["data set", f"{data.name} ({data.card}){f', split {data.split}' if data.split else ''}"],
            ["method", method.name],
            ["its settings", json.dumps(method.settings)],
            ["protocol", f"{protocol.name}, version {protocol.version}, digest {short_digest(protocol.digest)}"],
            ["reference", f"digest {short_digest(str(manifest.reference))}"],
            ["data", ", ".join(f"{name} {digest}" for name, digest in data.recordings.items())],
            ["version", code.version],
            ["code", code.text],
            ["Python and libraries", ", ".join(libraries)],
            ["started", made.started_utc],
            ["took", f"{made.seconds:.1f} s for {made.images} images, at most {made.peak_memory_mb:.0f} MB"],
        ],
        words=2,
        look="origin",
    )


def ledger_tables(found: Summary) -> list[Table]:
    """Tables of the outcome of every annotated object-frame and of every image."""
    objects, images = found.objects, found.images
    ignored = [
        [f"ignored: {reason.replace('_', ' ')}", number, REASONS.get(reason, "")]
        for reason, number in objects.ignored.items()
    ]
    of_objects = [
        ["evaluated", objects.evaluated, "scored above"],
        ["static", objects.static, "does not move, so it is neither searched for nor ignored"],
        *ignored,
        ["annotated, the sum", objects.annotated, "every annotated object in every image, once"],
    ]
    of_images = [
        ["scored", images.evaluated, ""],
        ["skipped", images.skipped, "no image before it to compare with, at the time that is due"],
        ["failed", images.failed, "could not be used"],
        *([["not annotated", images.not_annotated, "masks without scores"]] if images.not_annotated else []),
        ["all, the sum", images.images, "but the first of each recording, which have no history"],
    ]
    columns = ["outcome", "number", "why"]
    return [
        Table(title="Annotated object-frames", columns=columns, rows=of_objects, look="ledger"),
        Table(title="Images", columns=columns, rows=of_images, look="ledger"),
    ]
