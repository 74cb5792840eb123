"""Runs in tables and lines: the rows of the paper's table, ours beside the paper's where that says something.

One table shows them on the terminal, in `table.md` and on a run's page; `table.csv` has their numbers. Totals say what
became of objects and images, and what the run cost. A sweep has one table of the runs for its values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from bench.errors import BenchError
from bench.evaluation import definitions, published
from bench.evaluation.definitions import find_metric
from bench.evaluation.protocol import Protocol
from bench.evaluation.rows import EVALUATED, NOT_ANNOTATED
from bench.evaluation.summary import Metric, Summary, not_annotated
from bench.evaluation.sums import ALL_MOVING
from bench.evaluation.thresholds import ThresholdFreeMetrics
from bench.harness.manifest import Manifest
from bench.harness.stored import Provenance, RunSummary, StoredRun
from bench.plain_text import counted
from bench.recordings import load_card
from bench.records.reference import Category, IgnoreReason
from bench.reporting import formats
from bench.reporting.document import Block, Cell, Column, Paragraph, Report, Table

FALSE_POSITIVES = "false_positives"
PAPER_PROTOCOL = "paper-v1"
FALSE_POSITIVE_METRICS = tuple(metric.field for metric in definitions.FALSE_POSITIVES)
_OF_PAPER = {"detection_rate": "detection_rate", "tpr": "tpr", "iou_detected": "iou"}  # its name of each
_FIRST = ("iou", "tpr_all", "iou_detected", "tpr")  # then whatever else is defined, beside the detection rates
_OTHERS = (metric.name for metric in definitions.OF_OBJECTS if metric.name not in {"detection_rate", "chance"})
COVERAGES = {name: find_metric(name).label for name in dict.fromkeys((*_FIRST, *_OTHERS))}
ON_TERMINAL = (*_FIRST, "detection_rate", "detection_rate_50", "ceiling_iou")
CASES_NOTE = "Cases: object-frames; in the last row images, and the share of the image that is wrongly marked."
BESIDE_NOTE = (
    "TPR and IoU beside the paper's are over the detected object-frames. Below the paper's value the difference in "
    "percentage points. The paper's recordings are private: same form, not the same data."
)
CHANCE_NOTE = (
    "Chance: the same objects on the mask of another frame; none where recordings are shorter than chance_lag_s."
)
COVERAGE_NOTE = "TPR: mean coverage, IoU: mean intersection over union, of the detected object-frames or of all."
COLUMN_NOTES = {
    "ceiling_iou": f"Ceiling: {formats.CEILING}.",
    "unknown_share": "Unknown: share of an object's pixels in its unknown band, where nothing counts.",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRow:
    """One row of the table.

    Attributes:
        name: category, "all_moving", or "false_positives".
        label: as in the paper; of a method without its constraints only the kind of motion.
        frames: object-frames, in the last row image-frames.
        paper_frames: the paper's; None where it states none.
        tracks: objects; None in the last row.
        recordings: that hold the frames.
        metrics: ours, by the names of `ObjectMetrics`, in the last row of `FalsePositiveMetrics`.
        paper: the paper's values of those metrics that it states, in [0, 1].
    """

    name: str
    label: str
    frames: int
    paper_frames: int | None
    tracks: int | None
    recordings: int | None
    metrics: Mapping[str, Metric]
    paper: Mapping[str, float]

    def difference_points(self, name: str) -> float:
        """Ours minus the paper's in percentage points; NaN where either is missing."""
        difference = self.metrics[name].value - self.paper.get(name, math.nan)
        return round(100.0 * difference, 10)  # without the noise of binary fractions


def is_beside_paper(run: Manifest) -> bool:
    """True for what compares with the paper: its own rules, on scenes that are rendered in its form."""
    try:
        return run.protocol.name == PAPER_PROTOCOL and load_card(run.dataset.card).scenario is not None
    except BenchError:
        return False


def table_rows(summary: Summary, *, beside_paper: bool = True) -> list[TableRow]:
    """The rows of the table: the categories in the paper's order, all moving objects, the false positives.

    The paper's TPR and IoU stand beside ours over the detected object-frames: as averages over all of them they would
    contradict its detection rate (0.72 x 0.64 is less than 0.55).

    Args:
        summary: of the run.
        beside_paper: with the paper's values, which say something of scenes that were staged as its own.
    """
    rows = []
    for name, found in (summary.categories | {ALL_MOVING: summary.all_moving}).items():
        theirs = published.CATEGORIES.get(Category(name)) if name != ALL_MOVING and beside_paper else None
        rows.append(
            TableRow(
                name=name,
                label=formats.row_label(name, summary.false_positive_causes),
                frames=found.object_frames,
                paper_frames=theirs.object_frames if theirs else None,
                tracks=found.tracks,
                recordings=found.recordings,
                metrics={metric: found.metric(metric) for metric in found.metric_names()},
                paper={metric: getattr(theirs, field) for metric, field in _OF_PAPER.items()} if theirs else {},
            )
        )
    false = summary.false_positives
    of_images = TableRow(
        name=FALSE_POSITIVES,
        label="False positives",
        frames=false.frames,
        paper_frames=published.IMAGE_FRAMES if beside_paper else None,
        tracks=None,
        recordings=false.recordings,
        metrics={name: getattr(false, name) for name in FALSE_POSITIVE_METRICS},
        paper={"coverage": published.FALSE_POSITIVE_COVERAGE} if beside_paper else {},
    )
    return [*rows, of_images]


def threshold_free_line(found: ThresholdFreeMetrics) -> str:
    """For example "Over all thresholds: AUPRC 71.2 % [60.1, 80.3], ... ", or why there is none."""
    images = counted(found.images, "image")
    if math.isnan(found.auprc.value):
        return f"Over all thresholds: no AUPRC, since no object was evaluated in the {images} with a likelihood."
    return (
        f"Over all thresholds: AUPRC {formats.with_interval(found.auprc)}, false-positive rate at 95 % recall "
        f"{formats.with_interval(found.fpr95)}; over the pixels of {images}, from histograms."
    )


def results_table(rows: Sequence[TableRow], *, title: str, short: bool = False) -> Table:
    """A row for each kind of motion with cases: each metric over its interval, chance level and the paper's value.

    Args:
        rows: of the run.
        title: above them.
        short: for 100 columns: the metrics of `ON_TERMINAL`, the ends of intervals in whole percent.
    """
    rows = [row for row in rows if row.frames or row.name == FALSE_POSITIVES]
    names = _columns(rows, short=short)
    interval = formats.short_interval if short else formats.interval

    def cells(row: TableRow) -> list[Cell | None]:
        if row.name != FALSE_POSITIVES:
            return [_cell(row, name, interval) if name in row.metrics else None for name in names]
        # The paper prints the false-positive coverage in the column of the detection rate.
        return [_cell(row, "coverage", interval) if name == "detection_rate" else None for name in names]

    return Table(
        title=title,
        columns=["Type", "Recs", "Cases", "Objects", *(find_metric(name).label for name in names)],
        rows=[[_label(row), row.recordings, row.frames, row.tracks, *cells(row)] for row in rows],
    )


def _columns(rows: Sequence[TableRow], *, short: bool) -> list[str]:
    """Names of the metrics in the table of these rows."""
    known = {name for row in rows for name in row.metrics}
    names = [*COVERAGES, "detection_rate", *formats.detection_levels(known), "ceiling_iou", "unknown_share"]
    return [name for name in names if name in known and (name in ON_TERMINAL or not short)]


def _label(row: TableRow) -> Cell:
    """A kind of motion over its constraint and the paper's cases."""
    name, _, constraint = row.label.partition(" (")
    of_paper = "" if row.paper_frames is None else f"paper: {row.paper_frames}"
    return Cell(name, tuple(filter(None, (constraint and f"({constraint}", of_paper))))


def _cell(row: TableRow, name: str, interval: Callable[[tuple[float, float] | None], str]) -> Cell:
    metric = row.metrics[name]
    if math.isnan(metric.value):
        return Cell("n/a", (f"({metric.cases} cases)",))
    below = [interval(metric.ci95)]
    if not math.isnan(chance := _chance(row, name)):
        below.append(f"chance {100 * chance:.0f}")
    if name in row.paper:
        below += [f"paper {100 * row.paper[name]:.0f}", f"{row.difference_points(name):+.1f}"]
    return Cell(formats.hundredths(metric.value), tuple(filter(None, below)), "strong")


def _chance(row: TableRow, name: str) -> float:
    """The chance level of a detection rate; NaN of other metrics, and where it is not known."""
    chance = row.metrics.get(formats.chance_of(name)) if name.startswith("detection_rate") else None
    return math.nan if chance is None else chance.value


def left_out_note(summary: Summary) -> str:
    """Names the kinds of motion without cases, which no table shows; "" where there are none."""
    without = [name.replace("_", " ") for name, row in summary.categories.items() if not row.object_frames]
    return f"Left out, without cases: {', '.join(without)}." if without else ""


def legend(rows: Sequence[TableRow], *, short: bool = False) -> str:
    """Return the note on how to read the tables of these rows: of what they show.

    Args:
        rows: of one or several tables.
        short: as of `results_table`.
    """
    columns = _columns(rows, short=short)
    beside = [BESIDE_NOTE] if any(row.paper for row in rows) else []
    chance = [CHANCE_NOTE] if any(_chance(row, name) >= 0 for row in rows for name in columns) else []
    of_columns = [note for name, note in COLUMN_NOTES.items() if name in columns]
    return " ".join([CASES_NOTE, *beside, *chance, COVERAGE_NOTE, *of_columns, formats.INTERVALS])


def report(rows: Sequence[TableRow], *, notes: Sequence[str] = (), unreviewed: str = "") -> Report:
    """The table of a run; a line of numbers per row and metric, ratios in [0, 1].

    Args:
        rows: of the table.
        notes: on the method and the data, below the note on how to read the table.
        unreviewed: `RunSummary.unreviewed`, which stands in each line of numbers of such a run.
    """
    reviewed = {"annotations": unreviewed.partition(": ")[2].rstrip(".")} if unreviewed else {}
    numbers: list[dict[str, object]] = [
        {"row": row.name, "label": row.label, "frames": row.frames, "paper_frames": row.paper_frames,
         "tracks": row.tracks, "metric": name, "value": metric.value, **formats.ends(metric), "cases": metric.cases,
         "recordings": row.recordings, "paper": row.paper.get(name), "difference_points": row.difference_points(name),
         **reviewed}
        for row in rows
        for name, metric in row.metrics.items()
    ]  # fmt: skip
    table = results_table(rows, title="Results by kind of motion, in percent")
    blocks: list[Block] = [table, *map(Paragraph, (legend(rows), *filter(None, notes)))]
    return Report(title="", blocks=blocks, numbers=pd.DataFrame(numbers, dtype=object))


def write_report_files(run: StoredRun) -> tuple[Path, ...]:
    """Write `table.md` and `table.csv` into the folder of a run.

    Raises:
        DataError: a table of the run is damaged.
    """
    summary = run.summary
    rows = table_rows(summary, beside_paper=is_beside_paper(run.manifest))
    over_all = "" if summary.threshold_free is None else threshold_free_line(summary.threshold_free)
    caveats = f"The data: {' '.join(summary.caveats.split())}" if summary.caveats.strip() else ""
    notes = (left_out_note(summary), over_all, caveats)
    return report(rows, notes=notes, unreviewed=summary.unreviewed).write(run.folder, "table")


FILLED = 0.5  # of the valid pixels: more in every image is no moving object


def total_lines(summary: RunSummary, protocol: Protocol) -> Iterator[str]:
    """Numbers of objects and images that were evaluated, and reasons that the others were not."""
    ledger, images = summary.objects, summary.images
    if left_out := left_out_note(summary):
        yield left_out
    limits: dict[str, str] = {IgnoreReason.RANGE: f" (beyond {protocol.reference.range_limit_m:g} m)"}
    reasons = [f"{count} {reason}{limits.get(reason, '')}" for reason, count in ledger.ignored.items() if count]
    yield (
        f"{counted(ledger.annotated, 'annotated object-frame')}: {ledger.evaluated} evaluated, {ledger.static} static, "
        f"ignored: {', '.join(reasons) or 'none'}"
    )
    if summary.threshold_free is not None:
        yield threshold_free_line(summary.threshold_free)
    ended = f"{images.evaluated} scored, {images.skipped} skipped, {images.failed} failed"
    yield f"{counted(images.images, 'image')}: {ended}"
    if unscored := not_annotated(summary):
        yield unscored
    if summary.unreviewed:
        yield summary.unreviewed


def nothing_scored(summary: RunSummary) -> str:
    """Warn that no object was evaluated though some move; "" otherwise."""
    ledger = summary.objects
    moving = ledger.annotated - ledger.static
    if ledger.evaluated or not moving:
        return ""
    return (
        f"no object was scored: {counted(moving, 'moving object-frame')} ignored, for the reasons below; if they "
        "surprise you, calibration, ego-motion or boxes may be wrong: see `fisheye-bench validate` and "
        "`fisheye-bench view`"
    )


def odd_masks(run: StoredRun) -> str:
    """Warn of a run whose masks are all empty, or all fill more than half of the valid pixels; "" otherwise."""
    rows = run.frames(["status", "detected_px", "valid_px"])
    rows = rows[rows["status"].isin([EVALUATED, NOT_ANNOTATED]) & (rows["valid_px"] > 0)]
    shares = rows["detected_px"] / rows["valid_px"]
    if shares.empty or (shares.max() > 0 and shares.min() <= FILLED):
        return ""
    masks = counted(len(shares), "mask")
    if shares.max() > 0:
        what = f"each of {masks} marks more than half of the valid pixels; an inverted mask does that"
    else:
        what = f"none of {masks} marks anything; scores below the threshold, or of another scale, do that"
    return f"{what}: see `fisheye-bench view`"


def cost_lines(made: Provenance) -> Iterator[str]:
    """Work of a run, and the time and memory that it took."""
    rate = f", {made.images_asked / made.seconds:.1f} images per second" if made.images_asked and made.seconds else ""
    yield f"{made.seconds:.1f} s{rate}, peak memory of a process {made.peak_memory_mb:.0f} MB"
    stored = made.images - made.images_asked
    found = f"; the answers of {counted(stored, 'image')} were there" if stored > 0 else ""
    workers = f"{counted(made.workers, 'worker')}; " if made.workers else ""
    yield f"{workers}the method was asked for {counted(made.images_asked, 'image')}{found}"


# A sweep: the headline metrics of a run for each value of one setting.

SWEEP = "sweep.csv"  # the runs in a folder with this file are values of a sweep, and no entries of a leaderboard
METHOD_ONLY = "Injected errors reach the method only: the reference keeps the true calibration and ego-motion."


def sweep_report(setting: str, runs: Mapping[str, RunSummary], *, title: str, note: str = "") -> Report:
    """A row a value over all moving objects, with a chart; of numbers a line a value, ratios in [0, 1].

    Args:
        setting: that was changed.
        runs: by value, in the order in which they are shown.
        title: stands above table and chart.
        note: how to read them.
    """
    from bench.reporting.figures import draw_sweep, drawing  # matplotlib, which no other table needs

    metrics = {value: formats.headline_metrics(summary) for value, summary in runs.items()}
    rows, numbers = list[list[object]](), list[dict[str, object]]()
    for value, summary in runs.items():
        moving, images = summary.all_moving, summary.images.evaluated
        counts = {"images": images, "object_frames": moving.object_frames, "recordings": moving.recordings}
        rows.append([value, *counts.values(), *metrics[value].values()])
        numbers.append({setting: value, **counts})
        for name, metric in metrics[value].items():
            numbers[-1] |= {name: metric.value} | {f"{name}.{end}": at for end, at in formats.ends(metric).items()}
    headings = [Column(find_metric(name).label, formats.metric_cell) for name in next(iter(metrics.values()))]
    table = Table(
        columns=[setting, "Images", "Object-frames", "Recordings", *headings],
        rows=rows,
        note=f"IoU and TPR are averages over all object-frames that move. {formats.INTERVALS} {note}".rstrip(),
    )
    label = f"Headline metrics for each value of {setting}"
    chart = drawing("sweep", draw_sweep(setting, metrics, title=title), label)
    return Report(title=title, blocks=[table, chart], numbers=pd.DataFrame(numbers), page=True)
