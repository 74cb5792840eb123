"""A run in tables and lines: the rows of the paper's table, ours beside the paper's where that says something.

The same rows make the table of the terminal, `table.md`, `.csv` and `.tex`, and the tables of a run's page. Totals say
what became of objects and images, and what the run cost.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from bench.atomic import write_text
from bench.errors import BenchError
from bench.evaluation import Metric, Protocol, ThresholdFreeMetrics, definitions, find_metric, published
from bench.evaluation.rows import EVALUATED, NOT_ANNOTATED, read_parts
from bench.evaluation.summary import Summary, not_annotated
from bench.evaluation.sums import ALL_MOVING
from bench.harness import Provenance, RunSummary, StoredRun
from bench.plain_text import counted
from bench.recordings import load_card
from bench.records.reference import Category, IgnoreReason
from bench.reporting.canvas import write_picture
from bench.reporting.charts import draw_run_maps
from bench.reporting.document import Block, Cell, Column, Paragraph, Report, Table, to_latex
from bench.reporting.formats import (
    CEILING,
    INTERVALS,
    annotations_field,
    chance_of,
    detection_levels,
    hundredths,
    level_percent,
    mean_cell,
    metric_cell,
    metric_record,
    percent,
    row_label,
    short_interval,
    shortened,
    with_interval,
)

FALSE_POSITIVES = "false_positives"
FALSE_POSITIVE_METRICS = tuple(metric.field for metric in definitions.FALSE_POSITIVES)
COMPARED = {"detection_rate": "Detection rate", "tpr": "TPR", "iou_detected": "IoU"}
_OF_PAPER = {"detection_rate": "detection_rate", "tpr": "tpr", "iou_detected": "iou"}  # its name of each
COVERAGES = {name: find_metric(name).label for name in ("iou", "tpr_all", "iou_detected", "tpr")}
CASES_NOTE = "Cases: object-frames; in the last row images, and the area of the image."
BESIDE_NOTE = (
    "TPR and IoU beside the paper's are averages over the detected object-frames. Differences in percentage points. "
    "The paper's recordings are private: same form, not the same data."
)
CHANCE_NOTE = "Chance: the same objects on the mask of another frame."
NO_CHANCE_NOTE = "No chance level where the recordings are shorter than the protocol's chance_lag_s."
COVERAGE_NOTE = (
    "TPR is the mean coverage, IoU the mean intersection over union: over the detected object-frames, or over all, an "
    "undetected one having 0."
)
FALSE_POSITIVE_NOTE = (
    "False-positive coverage: what is marked outside of all moving objects, as a share of the image and of its valid "
    "pixels. A large false positive has more pixels than the protocol states."
)
FURTHER = {name: find_metric(name).label for name in ("ceiling_iou", "unknown_share")}  # of some data and protocols
FURTHER_NOTES = {
    "ceiling_iou": f"Ceiling: {CEILING}; IoU over all object-frames.",
    "unknown_share": "Unknown: share of the pixels of an object and its unknown band that lie in the band, where "
    "nothing counts; averages over all object-frames. All else is of cores, against which the paper's outlines are "
    "another measure.",
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

    def difference(self, name: str) -> str:
        """Return the difference in points as "+0.1"; "" for NaN."""
        points = self.difference_points(name)
        return "" if math.isnan(points) else f"{points:+.1f}"

    def paper_percent(self, name: str) -> str:
        """The paper's value as it prints it, "72 %"; "" where it has none."""
        return percent(self.paper[name], digits=0) if name in self.paper else ""


def is_rendered(card: str) -> bool:
    """True for a data set that is rendered from a scenario: ours, so that pages may show it, beside the paper's too."""
    try:
        return load_card(card).scenario is not None
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
                label=row_label(name, summary.false_positive_causes),
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


def rows_with_cases(rows: Sequence[TableRow]) -> list[TableRow]:
    """Those that hold object-frames, and the false positives."""
    return [row for row in rows if row.frames or row.name == FALSE_POSITIVES]


def left_out_note(rows: Sequence[TableRow]) -> str:
    """Names the rows without cases; "" where there are none."""
    with_cases = rows_with_cases(rows)
    without = [row.name.replace("_", " ") for row in rows if row not in with_cases]
    return f"Left out, without cases: {', '.join(without)}." if without else ""


def threshold_free_line(found: ThresholdFreeMetrics) -> str:
    """For example "Over all thresholds: AUPRC 71.2 % [60.1, 80.3], ... ", with what the bins leave open."""
    auprc, rate = (
        " to ".join(percent(bound, digits=2) for bound in bounds) for bounds in (found.auprc_bounds, found.fpr95_bounds)
    )
    return (
        f"Over all thresholds: AUPRC {with_interval(found.auprc)}, false-positive rate at 95 % recall "
        f"{with_interval(found.fpr95)}; over the pixels of {found.images} images, from histograms"
        + (f": without bins AUPRC lies in {auprc}, the rate in {rate}." if found.auprc.cases else ".")
    )


def detection_columns(rows: Sequence[TableRow]) -> dict[str, str]:
    """Names and headings of the detection rates, with the protocol's own levels."""
    names = next((list(row.metrics) for row in rows if row.name != FALSE_POSITIVES), [])
    levels = {name: f"at {level_percent(name):g} %" for name in detection_levels(names)}
    return {"detection_rate": find_metric("detection_rate").label} | levels


def further_columns(rows: Sequence[TableRow]) -> dict[str, str]:
    """Names and headings of what only some runs have: the ceiling of exact masks, the share of unknown bands."""
    return {name: heading for name, heading in FURTHER.items() if any(name in row.metrics for row in rows)}


def table_note(rows: Sequence[TableRow]) -> str:
    """Return the note on how to read the tables of these rows."""
    return " ".join([CASES_NOTE, *_beside_notes(rows), *_chance_notes(rows), INTERVALS, *_further_notes(rows)])


def _beside_notes(rows: Sequence[TableRow]) -> list[str]:
    return [BESIDE_NOTE] if any(row.paper for row in rows) else []


def _chance_notes(rows: Sequence[TableRow]) -> list[str]:
    """Return notes on what chance is, and on why a row that has cases has none."""
    chances = [row.metrics["chance"].value for row in rows if row.frames and "chance" in row.metrics]
    return [CHANCE_NOTE, NO_CHANCE_NOTE] if any(map(math.isnan, chances)) else [CHANCE_NOTE]


def _further_notes(rows: Sequence[TableRow]) -> list[str]:
    return [FURTHER_NOTES[name] for name in further_columns(rows)]


def text_tables(rows: Sequence[TableRow]) -> tuple[Table, ...]:
    """Ours beside the paper's; detection and coverage with their intervals; the false positives."""
    rates: dict[str, str] = {}
    for name, heading in detection_columns(rows).items():
        rates |= {name: heading, chance_of(name): "chance"}
    coverages = COVERAGES | further_columns(rows)
    return (
        _beside_the_paper(rows),
        _with_intervals(rows, title="Detection", shown=rates, notes=_chance_notes(rows)),
        _with_intervals(rows, title="Coverage", shown=coverages, notes=[COVERAGE_NOTE, *_further_notes(rows)]),
        _false_positives(rows),
    )


def _beside_the_paper(rows: Sequence[TableRow]) -> Table:
    """The paper's metrics, with its values and the differences where it states any of these rows."""
    beside = any(row.paper for row in rows)
    columns = ["Type", "Recordings", "Cases", *(["paper"] if beside else [])]
    for heading in COMPARED.values():
        columns += [heading, *(["paper", "diff."] if beside else [])]
    lines: list[list[object]] = []
    for row in rows:
        line: list[object] = [_label(row.label), row.recordings, row.frames, *([row.paper_frames] if beside else [])]
        # The paper prints the false-positive coverage in the column of the detection rate.
        for name in ["coverage"] if row.name == FALSE_POSITIVES else COMPARED:
            line.append(percent(row.metrics[name].value, cases=row.metrics[name].cases))
            line += [row.paper_percent(name), row.difference(name)] if beside else []
        lines.append(line + [None] * (len(columns) - len(line)))
    title = f"Results by category of objects{', beside the paper' if beside else ''}"
    return Table(title=title, columns=columns, rows=lines, note=" ".join([CASES_NOTE, *_beside_notes(rows)]))


def _with_intervals(rows: Sequence[TableRow], *, title: str, shown: Mapping[str, str], notes: Sequence[str]) -> Table:
    """One line per kind of motion; intervals are named where one has them."""
    of_objects = [row for row in rows if row.name != FALSE_POSITIVES]
    bounded = any(row.metrics[name].ci95 for row in of_objects for name in shown)
    return Table(
        title=f"{title} with 95 % intervals" if bounded else title,
        columns=["Type", "Recordings", "Cases", "Objects", *(Column(text, metric_cell) for text in shown.values())],
        rows=[
            [_label(row.label), row.recordings, row.frames, row.tracks, *map(row.metrics.get, shown)]
            for row in of_objects
        ],
        note=" ".join([*notes, INTERVALS]),
    )


def _false_positives(rows: Sequence[TableRow]) -> Table:
    shares = "False-positive coverage", "of the valid pixels", "Frames with a large false positive"
    columns = [*(Column(heading, metric_cell) for heading in shares), Column("Components per frame", mean_cell)]
    return Table(
        title="False positives",
        columns=["Recordings", "Images", *columns],
        rows=[
            [row.recordings, row.frames, *map(row.metrics.get, FALSE_POSITIVE_METRICS)]
            for row in rows
            if row.name == FALSE_POSITIVES
        ],
        words=0,
        note=f"{FALSE_POSITIVE_NOTE} {INTERVALS}",
    )


def _label(text: str, *, before: str = " (") -> Cell:
    """A kind of motion over its constraint."""
    first, _, second = text.partition(before)
    return Cell(first, (before[1:] + second,) if second else ())


_SHORT = {"detection_rate": Cell("Detec-", ("tion",)), "tpr": Cell("TPR", ("det.",)), "tpr_all": Cell("TPR", ("all",)),
          "iou": Cell("IoU", ("all",)), "iou_detected": Cell("IoU", ("det.",)), "ceiling_iou": Cell("IoU", ("ceil.",)),
          "unknown_share": Cell("Un-", ("known",))}  # fmt: skip


def terminal_report(rows: Sequence[TableRow], *, title: str) -> list[Block]:
    """For 100 columns: the value of each metric over its 95 % interval, its chance level, the paper's, the difference.

    Args:
        rows: of the table; kinds of motion without cases are left out.
        title: says what run it is of.
    """
    shown = {**COVERAGES, **detection_columns(rows), **further_columns(rows)}
    lines = []
    for row in rows_with_cases(rows):
        of_images = row.name == FALSE_POSITIVES
        below = ["95 %", *([] if of_images else ["chance"]), *(["paper", "diff."] if row.paper else [])]
        frames = tuple(str(row.paper_frames) if name == "paper" else "" for name in below)
        # The paper prints the false-positive coverage in the column of the detection rate.
        names = [None] * len(COVERAGES) + ["coverage"] + [None] * (len(shown) - len(COVERAGES) - 1)
        cells = [name and _cell(row, name, below) for name in (names if of_images else shown)]
        head = [
            _label(row.label),
            Cell("ours" if row.paper else "", tuple(below)),
            row.recordings,
            Cell(str(row.frames), frames),
        ]
        lines.append([*head, row.tracks, *cells])
    headings = [_SHORT.get(name) or _label(heading, before=" ") for name, heading in shown.items()]
    table = Table(
        title=title,
        columns=["Type", "", "Recs", "Cases", "Objects", *headings],
        rows=lines,
        words=2,
    )
    return [table, *(Paragraph(note, "dim") for note in _terminal_notes(rows))]


def _cell(row: TableRow, name: str, below: Sequence[str]) -> Cell:
    metric = row.metrics[name]
    no_cases = math.isnan(metric.value)
    chance = row.metrics.get(chance_of(name)) if name.startswith("detection_rate") else None
    texts = {
        "95 %": f"({metric.cases})" if no_cases else short_interval(metric),
        "chance": "" if chance is None or math.isnan(chance.value) else hundredths(chance.value),
        "paper": f"{100 * row.paper[name]:.0f}" if name in row.paper else "",
        "diff.": row.difference(name),
    }
    return Cell(hundredths(metric.value), tuple(texts[line] for line in below), "" if no_cases else "strong")


def _terminal_notes(rows: Sequence[TableRow]) -> list[str]:
    large = [f"{percent(row.metrics['frame_rate'].value)} of the images have a large false positive."
             for row in rows if row.name == FALSE_POSITIVES and row.frames]  # fmt: skip
    return [*filter(None, [left_out_note(rows)]), *large, f"{table_note(rows)} {COVERAGE_NOTE}"]


_LONGEST_SETTINGS = 80  # characters in a caption


def report(rows: Sequence[TableRow], *, notes: Sequence[str] = (), unreviewed: str = "") -> Report:
    """The table of a run; a line of numbers per row and metric, ratios in [0, 1].

    Args:
        rows: of the table.
        notes: on the method and the data, around the note on how to read the table.
        unreviewed: `RunSummary.unreviewed`, which stands in each line of numbers of such a run.
    """
    numbers: list[dict[str, object]] = [
        {"row": row.name, "label": row.label, "frames": row.frames, "paper_frames": row.paper_frames,
         "tracks": row.tracks, "metric": name} | metric_record(metric)
        | {"recordings": row.recordings, "paper": row.paper.get(name), "difference_points": row.difference_points(name)}
        | annotations_field(unreviewed)
        for row in rows
        for name, metric in row.metrics.items()
    ]  # fmt: skip
    tables = [replace(table, note="") for table in text_tables(rows)]
    said = map(Paragraph, filter(None, [*notes[:1], table_note(rows), *notes[1:]]))
    return Report(title="", blocks=[*tables, *said], numbers=numbers)


def latex(rows: Sequence[TableRow], *, label: str, about: str) -> str:
    """The tables as floats; kinds of motion without cases are left out.

    Args:
        rows: of the table.
        label: of the floats, before the title of each.
        about: in their captions, behind the title.
    """
    tables = text_tables([row for row in rows if row.frames])
    return "\n".join(to_latex(table, label=f"{label}-{table.title.partition(' with')[0].partition(',')[0]}",
                               caption=f"{table.title}: {about}.") for table in tables)  # fmt: skip


def _about(run: StoredRun) -> str:
    """Method, data set and protocol; settings that are not the method's defaults; annotations that nobody reviewed."""
    method, data = run.manifest.method, run.manifest.dataset
    settings = [f"{name} = {value}" for name, value in method.changed_settings().items()]
    shown = shortened(", ".join(settings), _LONGEST_SETTINGS) or "default settings"
    split = f", split {data.split}" if data.split else ""
    told = f"method {method.name} ({shown}), data set {data.name}{split}, {run.protocol.name}"
    return ", ".join(part for part in (told, run.summary.unreviewed.rstrip(".")) if part)


def write_report_files(run: StoredRun) -> tuple[list[TableRow], tuple[Path, ...]]:
    """Write `table.md`, `.csv`, `.tex` and `range_map.png`, `.svg` into the folder of a run.

    Returns:
        rows: of the table, for the terminal.
        files: paths, tables first.

    Raises:
        DataError: a table of the run is damaged.
    """
    summary = run.summary
    rows = table_rows(summary, beside_paper=is_rendered(run.manifest.dataset.card))
    over_all = "" if summary.threshold_free is None else threshold_free_line(summary.threshold_free)
    caveats = f"The data: {' '.join(summary.caveats.split())}" if summary.caveats.strip() else ""
    files = report(rows, notes=[over_all, caveats], unreviewed=summary.unreviewed).write(run.folder, "table")
    paper = run.folder / "table.tex"
    write_text(paper, latex(rows, label=run.label, about=_about(run)))
    return rows, (*files, paper, *write_picture(run.folder / "range_map", draw_run_maps(run)))


FILLED = 0.5  # of the valid pixels: more in every image is no moving object


def total_lines(summary: RunSummary, protocol: Protocol) -> Iterator[str]:
    """Numbers of objects and images that were evaluated, and reasons that the others were not."""
    ledger, images = summary.objects, summary.images
    limits: dict[str, str] = {IgnoreReason.RANGE: f" (beyond {protocol.reference.range_limit_m:g} m)"}
    reasons = [f"{count} {reason}{limits.get(reason, '')}" for reason, count in ledger.ignored.items() if count]
    yield (
        f"{ledger.annotated} annotated object-frames: {ledger.evaluated} evaluated, {ledger.static} static, "
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
        f"no object was scored: all {moving} moving object-frames are ignored, for the reasons below; if they surprise "
        "you, calibration, ego-motion or boxes may be wrong: see `fisheye-bench validate` and `fisheye-bench view`"
    )


def odd_masks(run: StoredRun) -> str:
    """Warn of a run whose masks are all empty, or all fill more than half of the valid pixels; "" otherwise."""
    shares = pd.concat(
        (rows["detected_px"] / rows["valid_px"])[
            rows["status"].isin([EVALUATED, NOT_ANNOTATED]) & (rows["valid_px"] > 0)
        ]
        for rows in read_parts(run.frames, ["status", "detected_px", "valid_px"])
    )
    if shares.empty or (shares.max() > 0 and shares.min() <= FILLED):
        return ""
    if shares.max() > 0:
        what = f"each of the {len(shares)} masks marks more than half of the valid pixels; an inverted mask does that"
    else:
        what = (
            f"none of the {len(shares)} masks marks anything; scores below the threshold, or of another scale, do that"
        )
    return f"{what}: see `fisheye-bench view`"


def cost_lines(made: Provenance) -> Iterator[str]:
    """Work of a run, and the time and memory that it took."""
    rate = f", {made.images_asked / made.seconds:.1f} images per second" if made.images_asked and made.seconds else ""
    yield f"{made.seconds:.1f} s{rate}, peak memory of a process {made.peak_memory_mb:.0f} MB"
    stored = made.images - made.images_asked
    found = f"; the answers of {counted(stored, 'image')} were there" if stored > 0 else ""
    yield f"{counted(made.workers, 'process')}; the method was asked for {counted(made.images_asked, 'image')}{found}"
