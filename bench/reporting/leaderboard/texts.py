"""The leaderboard for the terminal, and as Markdown, CSV and JSON; and its best method in one line."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.evaluation import load_protocol
from bench.evaluation.summary import Metric
from bench.evaluation.sums import ALL_MOVING
from bench.harness.digests import short_digest
from bench.reporting import formats
from bench.reporting.compare.runs import LEAST_COMMON
from bench.reporting.document import Block, Cell, Column, Heading, Heads, Items, Paragraph, Report, Table
from bench.reporting.formats import annotations_field, metric_cell, metric_record
from bench.reporting.leaderboard.reading import (
    FALSE_POSITIVES,
    OF_PIXELS,
    ORDERED_BY,
    RANKING_PROTOCOL,
    Entry,
    Group,
    Kind,
    Leaderboard,
    shown_metrics,
)

SCHEMA_VERSION = 2
NOTE = (
    "Of the images that all runs of a table scored, in percent. Runs stand in one table if they have at least "
    f"{100 * LEAST_COMMON:.0f} % of their images in common and the same reference on these. {formats.INTERVALS} "
    "Ordered by IoU over all moving object-frames, an undetected one having 0. Methods whose intervals overlap may "
    "still differ: compare judges runs in pairs. Chance: detection at the same level on the mask of another frame. "
    "False positives: share of the image. The IoU of an object counts the false positives that touch it, so specks "
    "apart from it cost nothing; the IoU of pixels counts all of them, over all images."
)
ORACLE_NOTE = (
    f"No methods: the exact masks of rendered data are the ceiling, {formats.CEILING}; oracles are given what no "
    "method may know: the exact masks on cells, or the exact flow and ego-motion."
)
COST_NOTE = (
    "Cost: the method alone for one image, in one thread and without a cache, in ms, and its ratio to a call of "
    "Farnebäck's flow on the same images."
)
VERIFIED_NOTE = "Verified: `verify` counted the run again from its masks and the data, on this machine."
NOTES = (NOTE, ORACLE_NOTE, COST_NOTE, VERIFIED_NOTE)
_SUFFIXES = {Kind.METHOD: "", Kind.ORACLE: " (oracle)", Kind.CEILING: " (ceiling)"}


def leaderboard_tables(found: Leaderboard) -> Iterator[Block]:
    """A table per group over all moving objects, readable at 100 columns; then how to read them."""
    for group in found.groups:
        columns = {
            name: _SHORT.get(name, heading)
            for name, heading in shown_metrics(group).items()
            if name not in ("iou_detected", OF_PIXELS)
        }
        yield Table(
            title=group_title(group),
            columns=["Run, method", Cell("Images,", ("recs",)), *columns.values(),
                     Cell("ms per", ("image",)), Cell("Date,", ("code",))],
            rows=[
                [Cell(entry.run, (_method(entry),), "strong"),
                 Cell(str(entry.images), (str(group.rows[ALL_MOVING].recordings),)),
                 *(_lines(group, entry, name) for name in columns),
                 Cell("" if entry.cost_ms is None else f"{entry.cost_ms:.1f}"),
                 Cell(entry.date, (entry.code,))]
                for entry in group.entries
            ],
        )  # fmt: skip
    yield from (Paragraph(note, "dim") for note in NOTES)


_SHORT = {
    "iou": Cell("IoU", ("all",)), "tpr_all": Cell("TPR", ("all",)), FALSE_POSITIVES: Cell("False", ("positives",)),
    "detection_rate_50": Cell("Detection", ("at 50 %",)),
}  # fmt: skip


def _lines(group: Group, entry: Entry, name: str) -> Cell:
    """Value, interval, and of an IoU the ceiling; a mask that covers everything exceeds that of a coverage."""
    metric, ceiling = entry.metrics[name], group.ceiling(ALL_MOVING, name)
    of = [f"of {formats.hundredths(ceiling)}"] if entry.kind is Kind.METHOD and "iou" in name else []
    below = formats.short_interval(metric), *([] if math.isnan(ceiling) else of)
    return Cell(formats.hundredths(metric.value), below)


def _method(entry: Entry) -> str:
    verified = ", verified" if entry.verified else ""
    failures = f", {entry.failures} failures" if entry.failures else ""
    return f"{entry.method}{_SUFFIXES[entry.kind]}{failures}{verified}"


def report(found: Leaderboard, *, charts: Sequence[Block] = ()) -> Report:
    """Two tables per group, then the runs that cannot be read; a line of numbers per run, row and metric.

    Args:
        found: the leaderboard.
        charts: what stands above the tables.
    """
    blocks: list[Block] = [Paragraph(" ".join(NOTES)), *charts]
    for group in found.groups:
        blocks += [Heading(group_title(group)), _overall(group), _by_row(group)]
    if found.damaged:
        blocks += [Heading("Runs that cannot be read"), Items([f"{run}: {fault}" for run, fault in found.damaged])]
    content = {
        "schema_version": SCHEMA_VERSION,
        "note": " ".join(NOTES),
        "best": list(best_methods(found)),
        "groups": [json_group(group) for group in found.groups],
        "damaged": [{"run": run, "fault": fault} for run, fault in found.damaged],
    }
    return Report(title="Leaderboard", blocks=blocks, numbers=_records(found), content=content)


def _overall(group: Group) -> Table:
    """Every metric over all moving objects."""
    shown = shown_metrics(group)
    metrics = [Column(label, metric_cell) for label in shown.values()]
    columns: list[Heads] = [
        "Method",
        *metrics,
        Column("ms per image", "{:.1f}".format),
        "Images",
        "Run",
        "Date",
        "Code",
    ]
    rows = [[_method(e), *map(e.metrics.get, shown), e.cost_ms, e.images, e.run, e.date, e.code] for e in group.entries]
    ceiling = _ceiling_line(group, [(ALL_MOVING, name) for name in shown], len(columns))
    return Table(title="All moving objects", columns=columns, rows=[*ceiling, *rows])


def _by_row(group: Group) -> Table:
    """IoU of each kind of motion."""
    kinds = {name: row for name, row in group.rows.items() if name != ALL_MOVING}
    headings = [*(formats.LABELS[name] for name in kinds), "False positives"]
    columns: list[Heads] = ["IoU over all object-frames", *(Column(text, metric_cell) for text in headings)]
    keys = [*((name, ORDERED_BY) for name in kinds), (ALL_MOVING, FALSE_POSITIVES)]
    frames = [Cell(f"{row.object_frames}, {row.recordings}") for row in kinds.values()]
    rows: list[Sequence[object]] = [
        ["object-frames, recordings", *frames, None],
        *_ceiling_line(group, keys, len(columns)),
        *([f"{entry.method}{_SUFFIXES[entry.kind]}", *(entry.values[row][name] for row, name in keys)]
          for entry in group.entries),
    ]  # fmt: skip
    return Table(title="By kind of motion", columns=columns, rows=rows)


def _ceiling_line(group: Group, keys: Sequence[tuple[str, str]], columns: int) -> list[list[object]]:
    """Return the line of the exact masks, where no run of them stands in the table anyway."""
    values = [group.ceiling(row, name) for row, name in keys]
    if any(entry.kind is Kind.CEILING for entry in group.entries) or all(map(math.isnan, values)):
        return []
    cells = [None if math.isnan(value) else Cell(formats.percent(value)) for value in values]
    return [["ceiling: the exact masks", *cells, *[None] * (columns - len(cells) - 1)]]


def _records(found: Leaderboard) -> Iterator[dict[str, object]]:
    """One line per run, row and metric, ratios in [0, 1]."""
    for group in found.groups:
        of_group = _fields(group, _OF_GROUP) | {"images_compared": group.images}
        for entry in group.entries:
            for row in group.rows:
                for name, metric in entry.values[row].items():
                    yield of_group | _fields(entry, _OF_ENTRY) | {
                        "row": row, "metric": name, **metric_record(metric),
                        "ceiling": _known_ceiling(group, row, name), **annotations_field(group.unreviewed),
                    }  # fmt: skip


_OF_GROUP = ("dataset", "split", "protocol", "protocol_digest", "reference_digest")
_OF_ENTRY = ("run", "method", "kind", "images", "cost_ms", "date", "code", "failures", "verified")


def _fields(record: object, names: Sequence[str]) -> dict[str, object]:
    return {name: getattr(record, name) for name in names}


def _known_ceiling(group: Group, row: str, name: str) -> float | None:
    if name.startswith(("chance", "ceiling", "unknown")):
        return None
    value = group.ceiling(row, name)
    return None if math.isnan(value) else value


def json_group(group: Group) -> dict[str, object]:
    """A group as JSON has it, and the page: values as [value, low, high] of the interval, or [value]."""
    names = shown_metrics(group)
    ceilings = {row: {name: _known_ceiling(group, row, name) for name in names} for row in group.rows}
    return _fields(group, (*_OF_GROUP, "judged", "images")) | {
        "metrics": names,
        "rows": [
            {"name": row, "label": formats.LABELS[row], "object_frames": of.object_frames, "recordings": of.recordings}
            | {"ceiling": {name: value for name, value in ceilings[row].items() if value is not None}}
            for row, of in group.rows.items()
        ],
        "entries": [
            _fields(entry, _OF_ENTRY)
            | {
                "values": {row: {name: _numbers(entry.values[row][name]) for name in names} for row in group.rows},
            }
            for entry in group.entries
        ],
        **annotations_field(group.unreviewed),
    }


def _numbers(metric: Metric) -> list[float]:
    return [metric.value, *(metric.ci95 or ())]


def best_methods(found: Leaderboard) -> Iterator[dict[str, object]]:
    """For each data set the method that leads under the protocol that is judged by, and its score in words.

    Oracles are none. Without an interval it is "first", not "best": another may be better.
    """
    today = load_protocol(RANKING_PROTOCOL).digest
    for dataset in dict.fromkeys(group.dataset for group in found.groups):
        judged = [g for g in found.groups if (g.dataset, g.split, g.judged) == (dataset, None, True) and g.methods]
        if judged:
            group = max(judged, key=lambda group: (group.protocol_digest == today, len(group.methods)))
            best, ceiling = group.methods[0], group.ceiling(ALL_MOVING, ORDERED_BY)
            iou = best.metrics[ORDERED_BY]
            few = "" if iou.ci95 else " (too few recordings for an interval)"
            of = "" if math.isnan(ceiling) else f", ceiling {formats.percent(ceiling)}"
            false = formats.percent(best.metrics[FALSE_POSITIVES].value)
            yield {
                "dataset": dataset,
                "protocol": group.protocol,
                "protocol_digest": group.protocol_digest,
                "rank": "best" if iou.ci95 else "first",
                "method": best.method,
                "of": len(group.methods),
                "score": f"IoU {formats.with_interval(iou)}{few} over all moving object-frames{of}, false positives "
                f"{false} of the image{_unreviewed(group)}",
                "date": best.date,
                "code": best.code,
            }


def best_line(file: Path, *, dataset: str, beside: str = RANKING_PROTOCOL) -> str | None:
    """The best method of a stored leaderboard on a data set, in one line.

    None where it has none, or one by an earlier state of the protocol, whose scores do not compare with today's.

    Args:
        file: `leaderboard.json`.
        dataset: name of the data set.
        beside: protocol of the scores that the line stands beside; with another one they do not compare.
    """
    try:
        best = next(best for best in json.loads(file.read_bytes())["best"] if best["dataset"] == dataset)
        if best["protocol_digest"] != load_protocol(RANKING_PROTOCOL).digest:
            return None
        line = "{rank} of {of} methods on all of {dataset} by {protocol}: {method}, {score} ({file}, {date}, {code})"
        other = "" if beside == RANKING_PROTOCOL else f"; scores by {beside} do not compare with it"
        return line.format(file=file, **best) + other
    except (OSError, ValueError, LookupError, TypeError, StopIteration, RecursionError):
        return None


def group_title(group: Group) -> str:
    """Return the title of a group: what its runs have in common."""
    protocol = f"{group.protocol} ({short_digest(group.protocol_digest)})"
    every = group.rows[ALL_MOVING]
    return (
        f"{group.dataset}, {group.split or 'all recordings'}, {protocol}, "
        f"reference {short_digest(group.reference_digest)}: {group.images} images that all scored, "
        f"{every.object_frames} object-frames, {every.recordings} recordings{_unreviewed(group)}"
    )


def _unreviewed(group: Group) -> str:
    return f"; {group.unreviewed.rstrip('.')}" if group.unreviewed else ""
