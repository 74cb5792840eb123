"""The tables of a run's page, in the order of the page."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence

import pandas as pd

from bench.evaluation import Metric
from bench.evaluation.summary import ObjectMetrics, Summary
from bench.evaluation.sums import ALL_MOVING, FRAMES
from bench.reporting.document import Bar, Cell, Column, Table
from bench.reporting.formats import chance_of, mean_cell, metric_cell, percent
from bench.reporting.page.worst import WorstCases
from bench.reporting.stored_run import StoredRun
from bench.reporting.tables import COVERAGES, FALSE_POSITIVES, TableRow, detection_columns

COUNTS = ("object-frames", "objects", "recordings")
BREAKDOWN_METRICS = {
    "iou": "IoU, all",
    "tpr_all": "share found (TPR, all)",
    "detection_rate_50": "half of it found",
    "detection_rate": "found at all",
    "unknown_share": "unknown",
}
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


def bar_cell(metric: Metric, *notes: str, tick: float | None = None, lowest: bool = False) -> Cell:
    """A metric with its bar, and its interval and notes below."""
    if math.isnan(metric.value):
        return Cell(percent(metric.value, cases=metric.cases), style="strong")
    below = (span(metric), *notes) if not lowest else ("lowest", span(metric), *notes)
    bar = Bar(share=metric.value, interval=metric.ci95, tick=tick)
    return Cell(percent(metric.value), tuple(filter(None, below)), "bad" if lowest else "strong", bar)


def span(metric: Metric) -> str:
    """The 95 % interval in percent, "65.0 to 78.3"; "" without one."""
    return "" if metric.ci95 is None else "{:.1f} to {:.1f}".format(*(100 * end for end in metric.ci95))


def metrics_of(row: ObjectMetrics) -> dict[str, Metric]:
    """The metrics of a row by name."""
    return {name: row.metric(name) for name in row.metric_names()}


def beside_note(name: str, metrics: Mapping[str, Metric]) -> str:
    """Return the bound of a metric: the chance level of a detection rate, the ceiling of IoU; "" for none."""
    other = chance_of(name) if name.startswith("detection_rate") else f"ceiling_{name}"
    found = metrics.get(other) if name == "iou" or other.startswith("chance") else None
    if found is None or math.isnan(found.value):
        return ""
    return f"{other.partition('_')[0]} {percent(found.value)}"


def headline_table(rows: Sequence[TableRow]) -> Table:
    """A row for each kind of motion, the paper's values as ticks and below."""
    (_, any_pixel), *levels = detection_columns(rows).items()
    # TPR over all stands at a glance and in every breakdown; with it here, the table would be wider than most screens.
    columns = {name: heading for name, heading in COVERAGES.items() if name != "tpr_all"}
    columns |= {name: f"found {heading}" for name, heading in reversed(levels)}
    columns["detection_rate"] = f"{any_pixel} (any pixel)"
    return Table(
        title="Results by kind of motion, the paper's values beside them",
        columns=["kind of motion", *columns.values(), *COUNTS],
        rows=[
            [row.label, *(_beside_the_paper(row, name) for name in columns), row.frames, row.tracks, row.recordings]
            for row in rows
            if row.name != FALSE_POSITIVES
        ],
        look="metrics",
    )


def _beside_the_paper(row: TableRow, name: str) -> Cell:
    difference = f" ({row.difference(name)})" if row.difference(name) else ""
    paper = f"paper {row.paper_percent(name)}{difference}" if name in row.paper else ""
    return bar_cell(row.metrics[name], beside_note(name, row.metrics), paper, tick=row.paper.get(name))


def false_positive_table(row: TableRow, *, of_recordings: str) -> Table:
    """Table of what is marked though nothing moves there."""
    found, paper = row.metrics, f"paper {row.paper_percent('coverage')} ({row.difference('coverage')})"
    return Table(
        title="False positives: what is marked though nothing moves there; small is good",
        columns=["share", "this run", "to compare"],
        rows=[
            ["of the image's area, on average", metric_cell(found["coverage"]), paper],
            ["of the valid pixels", metric_cell(found["coverage_valid"]),
             "inside the lens's view and off the ego vehicle's body"],
            ["frames with a large false patch", metric_cell(found["frame_rate"]), "larger than the protocol states"],
            ["false patches per frame", mean_cell(found["components_per_frame"]),
             f"over {row.frames} images{of_recordings}"],
        ],
        words=3,
    )  # fmt: skip


def breakdown_table(caption: str, heading: str, rows: Mapping[str, ObjectMetrics], *, lowest: str | None) -> Table:
    """One way to sort the object-frames.

    Args:
        caption: of the table.
        heading: of its first column.
        rows: by name, those without cases included; what all of them have is shown.
        lowest: the row that is marked.
    """
    metrics = {n: h for n, h in BREAKDOWN_METRICS.items() if all(n in row.metric_names() for row in rows.values())}
    return Table(
        title=caption,
        columns=[heading, *metrics.values(), *COUNTS],
        rows=[
            [name]
            + [
                bar_cell(row.metric(n), beside_note(n, metrics_of(row)), lowest=n == "iou" and name == lowest)
                for n in metrics
            ]
            + [row.object_frames, row.tracks, row.recordings]
            for name, row in rows.items()
        ],
        look="metrics",
    )


def recording_table(run: StoredRun, worst: WorstCases) -> Table:
    """The recordings with the lowest IoU first, those without object-frames last; at most `LISTED_RECORDINGS`."""
    sums = run.sums.set_index("recording")
    wanted = {"iou": ALL_MOVING, "tpr_all": ALL_MOVING, "false_positive_coverage": FRAMES}
    rows = {name: sums[(sums["breakdown"] == of) & (sums["metric"] == name)] for name, of in wanted.items()}
    found = pd.DataFrame({name: of["numerator"] / of["denominator"] for name, of in rows.items()})
    cases = pd.DataFrame({name: of["denominator"] for name, of in rows.items()})
    found = found.assign(object_frames=cases["iou"], images=cases["false_positive_coverage"]).rename_axis("recording")
    found = found.reset_index().sort_values(["iou", "recording"], ignore_index=True)
    cards = {card.key[0]: card.element for card in reversed([*worst.all_objects, *worst.images])}
    found = found.fillna({"object_frames": 0, "images": 0})
    shares = [Column(heading, percent) for heading in ("IoU, all", "TPR, all", "wrongly marked")]
    counts = [Column(heading, "{:.0f}".format) for heading in ("object-frames", "images")]
    shown = f", {LISTED_RECORDINGS} of {len(found)}" if len(found) > LISTED_RECORDINGS else ""
    return Table(
        title=f"By recording, over all its object-frames, the lowest IoU first{shown}",
        columns=["recording", *shares, *counts, "to look at"],
        rows=[
            [Cell(name, link="#frames"), *values, Cell("worst case", link=f"#{cards[name]}") if name in cards else None]
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
    manifest, made = run.summary.manifest, run.summary.provenance
    data, method, protocol, code = manifest.dataset, manifest.method, manifest.protocol, manifest.code
    commit = code.commit[:12] + (" with changes" if code.commit.endswith("+") else "") if code.commit else "unknown"
    libraries = [f"{name} {version}" for name, version in code.libraries.items()]
    return Table(
        title="Origin of the run",
        columns=["", ""],
        rows=[
            ["data set", f"{data.name} ({data.card}){f', split {data.split}' if data.split else ''}"],
            ["method", method.name],
            ["its settings", json.dumps(method.settings)],
            ["protocol", f"{protocol.name}, version {protocol.version}, digest {protocol.digest[:16]}"],
            ["reference", f"digest {str(manifest.reference)[:16]}"],
            ["data", f"digest {str(data.data)[:16]}"],
            ["code", f"fisheye-bench {code.version}, commit {commit}"],
            ["Python and libraries", ", ".join([code.python, *libraries])],
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
        ["all, the sum", images.images, "but the first of each recording, which have no history"],
    ]
    columns = ["outcome", "number", "why"]
    return [
        Table(title="Annotated object-frames", columns=columns, rows=of_objects, look="ledger"),
        Table(title="Images", columns=columns, rows=of_images, look="ledger"),
    ]
