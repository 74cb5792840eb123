"""A comparison for people and programs: Markdown, CSV, JSON, LaTeX, terminal."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bench.atomic import replacing, write_bytes
from bench.evaluation import Metric, find_metric
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.reporting import document
from bench.reporting.compare.changes import (
    FALSE_POSITIVE_COVERAGE,
    HEADLINES,
    LISTED,
    ChangedFrame,
    Kind,
    MetricChange,
    RowChange,
    RunComparison,
    Verdict,
    category_line,
    compare_runs,
    paired_objects,
    verdict_line,
    verdict_text,
)
from bench.reporting.compare.pictures import draw_changed_frames, frame_title
from bench.reporting.compare.runs import read_comparable
from bench.reporting.document import Block, Cell, Column, Heading, Paragraph, Picture, Style, Table
from bench.reporting.formats import (
    CEILING,
    INTERVALS,
    detection_levels,
    hundredths,
    metric_cell,
    write_texts,
)
from bench.reporting.stored_run import StoredRun

NOTE = (
    "Differences are after minus before, in percentage points, with 95 % intervals by recording, in pairs: the "
    "difference is taken again without each recording (jackknife). p: two-sided, of no difference, corrected after "
    "Holm over the rows of one metric that have a p-value (the categories and all moving objects; false-positive "
    "coverage has one row), for each pair of runs by itself. Only IoU and TPR over all object-frames, detection at "
    "50 % and false-positive coverage are judged; other metrics are shown with their interval and without a p-value. "
    "Better or worse is said only if the interval excludes 0 and the corrected p-value is at most 5 %; both "
    f"need {FEWEST_RECORDINGS} recordings with cases of both runs: with fewer, the same change in all of them could be "
    "chance. Recordings: with cases of both runs. TPR and IoU over detected object-frames are taken over other "
    "object-frames in each run where detection differs; TPR and IoU over all are not. Chance: the same objects on the "
    f"mask of another frame. Ceiling: on the same images, {CEILING}."
)


def report(comparisons: Sequence[RunComparison]) -> Iterator[Block]:
    """The first run with each of the others."""
    first = comparisons[0].before.summary
    data = first.manifest.dataset
    yield Heading(f"{', '.join(c.after.label for c in comparisons)} against {comparisons[0].before.label}", 1)
    yield Paragraph(
        f"Data set {data.name}, {data.split or 'all recordings'}, protocol {first.protocol.name} "
        f"({first.protocol.digest[:12]}), reference {str(first.manifest.reference)[:12]}."
    )
    for comparison in comparisons:
        yield from _section(comparison)
    yield Paragraph(NOTE)


def points(ratio: float) -> str:
    """A difference in percentage points, for example "+1.2"; no sign for exactly 0, "n/a" for NaN."""
    if ratio == 0:
        return "0.0"
    return "n/a" if math.isnan(ratio) else f"{100 * ratio:+.1f}"


def p_text(p_value: float | None) -> str:
    """For example "0.012" or "<0.001"; empty for None."""
    if p_value is None:
        return ""
    return "<0.001" if p_value < 0.001 else f"{p_value:.3f}"


def bounds(cell: MetricChange, between: str = " to ") -> str:
    """The interval in percentage points, for example "-1.2 to +0.3"; empty where there is none."""
    return "" if cell.change.ci95 is None else between.join(points(end) for end in cell.change.ci95)


def _section(comparison: RunComparison) -> Iterator[Block]:
    before, after = comparison.before.label, comparison.after.label
    yield Heading(f"{after} against {before}")
    yield Paragraph(verdict_line(comparison), "strong")
    yield Paragraph(category_line(comparison))
    yield Paragraph(f"Before: {before}, {comparison.methods[0]}. After: {after}, {comparison.methods[1]}.")
    yield from map(Paragraph, comparison.notes)
    yield from (_metric_table(comparison.rows, metric) for metric in _metrics(comparison.rows))
    yield _detection_table(comparison)
    for kind in Kind:
        if frames := [frame for frame in comparison.frames if frame.kind is kind]:
            yield _frame_table(kind, frames)
    for picture in comparison.drawn:
        yield Paragraph(picture.title, "strong")
        yield Picture(f"pictures/{picture.name}", picture.title)
    yield from (Paragraph(remark, "dim") for remark in comparison.remarks)


def _metrics(rows: Sequence[RowChange]) -> list[str]:
    """Headlines first, then the others in their own order."""
    every = dict.fromkeys(metric for row in rows for metric in row.metrics)
    return [*(m for m in HEADLINES if m in every), *(m for m in every if m not in HEADLINES)]


def _metric_table(rows: Sequence[RowChange], metric: str) -> Table:
    cells = [(row, row.metrics[metric]) for row in rows if metric in row.metrics]
    values = [Column(heading, hundredths) for heading in ("before", "after")]
    columns: list[Column | str] = ["Type", "Frames", "Recordings", *values, Column("difference", points), "95 %"]
    further: dict[str, Callable[[MetricChange], object]] = {}
    if any(cell.chance for _, cell in cells):
        further = {"chance before": lambda cell: _chance(cell, 0), "after": lambda cell: _chance(cell, 1)}
    if any(cell.ceiling is not None for _, cell in cells):
        further["ceiling"] = lambda cell: "" if cell.ceiling is None else hundredths(cell.ceiling)
    if metric in HEADLINES:
        further |= {"p (Holm)": lambda cell: p_text(cell.p_holm), "verdict": _verdict}
    lines = []
    for row, cell in cells:
        change = cell.change
        line = [row.label, row.frames, change.recordings, change.before, change.after, change.difference, bounds(cell)]
        lines.append([*line, *(form(cell) for form in further.values())])
    return Table(title=f"{find_metric(metric).label}, percent", columns=[*columns, *further], rows=lines)


def _chance(cell: MetricChange, run: int) -> str:
    return "" if cell.chance is None else hundredths(cell.chance[run].value)


def _verdict(cell: MetricChange) -> str:
    return "" if cell.verdict is None else verdict_text(cell.verdict, cell.change)


def _detection_table(comparison: RunComparison) -> Table:
    labels = {row.name: row.label for row in comparison.rows}
    counted = comparison.detections
    return Table(
        title="Object-frames gained and lost",
        columns=["Type", "Object-frames", "detected before", "after", "newly detected", "newly missed"],
        rows=[[labels[c.name], c.object_frames, c.before, c.after, c.gained, c.lost] for c in counted],
    )


def _frame_table(kind: Kind, frames: Sequence[ChangedFrame]) -> Table:
    what, which = "share of the image", "the image with most"
    if frames[0].track_id is not None:
        what, which = "coverage", f"largest first, one per object, at most {LISTED}"
    names = [frame_title(frame).removeprefix(kind.value).lstrip(": ") for frame in frames]
    return Table(
        title=f"{kind.value.capitalize()}: {which}",
        columns=["Frame", Column(f"{what} before, percent", hundredths), Column("after", hundredths)],
        rows=[[name, frame.before, frame.after] for name, frame in zip(names, frames, strict=True)],
    )


_OF_LATEX = {"iou": "IoU", "tpr_all": "TPR", FALSE_POSITIVE_COVERAGE: "False positives"}
_LATEX_NOTE = (
    "IoU and TPR over all object-frames, an undetected one having 0; false positives as a share of the image, over all "
    f"images. On the images that both runs scored. {INTERVALS}"
)


def to_latex(comparisons: Sequence[RunComparison]) -> str:
    r"""A float for each pair of runs, both runs in the lines of each row; `\label` "tab:compare-<run>-<run>"."""
    return "\n".join(map(_latex, comparisons))


def _latex(comparison: RunComparison) -> str:
    runs, first = (comparison.before, comparison.after), comparison.before.summary
    table = Table(
        title=" and ".join(run.label for run in runs),
        columns=["Type", "Run", "Recordings", "Cases", *_OF_LATEX.values()],
        rows=[
            [row.label, run.label, row.recordings, row.frames]
            + [_value(row.metrics.get(metric), side) for metric in _OF_LATEX]
            for row in comparison.rows
            if row.frames
            for side, run in enumerate(runs)
        ],
        words=2,
        note=_LATEX_NOTE,
    )
    split = first.manifest.dataset.split
    data = f"data set {first.manifest.dataset.name}{f', split {split}' if split else ''}, {first.protocol.name}"
    about = f"{comparison.methods[0]} and {comparison.methods[1]}, {data}"
    return document.to_latex([table], label="-".join(["compare", *(run.label for run in runs)]), about=about)


def _value(cell: MetricChange | None, side: int) -> Cell | None:
    """Of the run before (0) or after (1), with its interval."""
    if cell is None:
        return None
    value, cases = ((cell.change.before, cell.change.cases_before), (cell.change.after, cell.change.cases_after))[side]
    return metric_cell(Metric(value=value, ci95=cell.intervals[side], cases=cases, recordings=cell.change.recordings))


SCHEMA_VERSION = 1
_CHANGED = ("gained", "lost", "both")


def to_csv(comparisons: Sequence[RunComparison]) -> str:
    """One line per pair of runs, row and metric, ratios at full precision; empty where there is no number."""
    return document.to_csv(
        [
            _csv_row(comparison, row, metric, cell)
            for comparison in comparisons
            for row in comparison.rows
            for metric, cell in row.metrics.items()
        ]
    )


def _csv_row(comparison: RunComparison, row: RowChange, metric: str, cell: MetricChange) -> dict[str, object]:
    change = cell.change
    low, high = change.ci95 or (None, None)
    chance_before, chance_after = cell.chance or (None, None)
    images_before, images_after, images_compared = comparison.images
    return {
        "before_run": comparison.before.label, "after_run": comparison.after.label, "row": row.name,
        "frames": row.frames, "metric": metric, "before": change.before, "after": change.after,
        "difference": change.difference, "ci95_low": low, "ci95_high": high, "p_value": change.p_value,
        "p_holm": cell.p_holm, "cases_before": change.cases_before, "cases_after": change.cases_after,
        "recordings": change.recordings, "chance_before": chance_before and chance_before.value,
        "chance_after": chance_after and chance_after.value, "ceiling": cell.ceiling,
        "verdict": cell.verdict, "images_before": images_before, "images_after": images_after,
        "images_compared": images_compared,
    }  # fmt: skip


def write_object_changes(file: Path, comparisons: Sequence[RunComparison]) -> None:
    """Write one line per object-frame that was gained, was lost, or changed its coverage, a part of them at a time."""
    columns = ["before_run", "after_run", "recording", "camera", "timestamp_ns", "track_id", "object_class", "category",
               "range_m", "region_px", "change", "coverage_before", "coverage_after", "iou_before",
               "iou_after"]  # fmt: skip
    with replacing(file) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        stream.write(",".join(columns) + "\n")
        for comparison in comparisons:
            for rows in paired_objects(comparison.before, comparison.after):
                changed = rows[rows["change"].isin(_CHANGED) & (rows["coverage_before"] != rows["coverage_after"])]
                changed = changed.assign(before_run=comparison.before.label, after_run=comparison.after.label)
                changed[columns].to_csv(stream, header=False, index=False, lineterminator="\n")


def to_json(comparisons: Sequence[RunComparison]) -> str:
    """Everything but the object-frames, at full precision; null where there is no number."""
    first = comparisons[0].before.summary
    content = {
        "schema_version": SCHEMA_VERSION,
        "note": NOTE,
        "dataset": first.manifest.dataset.name,
        "split": first.manifest.dataset.split,
        "protocol": first.protocol.model_dump(),
        "reference": first.manifest.reference,
        "comparisons": [_json_comparison(comparison) for comparison in comparisons],
    }
    return document.to_json(content)


def _json_comparison(comparison: RunComparison) -> dict[str, Any]:
    return {
        "before": _json_run(comparison.before),
        "after": _json_run(comparison.after),
        "images": dict(zip(("before", "after", "compared"), comparison.images, strict=True)),
        "verdict": verdict_line(comparison),
        "categories": category_line(comparison),
        "notes": list(comparison.notes),
        "rows": [
            {
                "name": row.name,
                "frames": row.frames,
                "recordings": row.recordings,
                "metrics": {metric: _json_change(cell) for metric, cell in row.metrics.items()},
            }
            for row in comparison.rows
        ],
        "detections": [asdict(counts) for counts in comparison.detections],
        "changed_frames": [asdict(frame) for frame in comparison.frames],
        "pictures": [{"file": f"pictures/{picture.name}", "title": picture.title} for picture in comparison.drawn],
        "remarks": comparison.remarks,
    }


def _json_run(run: StoredRun) -> dict[str, Any]:
    return {
        "run": run.label,
        "method": run.summary.manifest.method.model_dump(),
        "version": run.summary.manifest.code.version,
        "commit": run.summary.manifest.code.commit,
        "started_utc": run.summary.provenance.started_utc,
    }


def _json_change(cell: MetricChange) -> dict[str, Any]:
    chance = None if cell.chance is None else [metric.value for metric in cell.chance]
    own = {"p_holm": cell.p_holm, "verdict": cell.verdict, "chance": chance, "ceiling": cell.ceiling}
    return asdict(cell.change) | own


_SHORT = {
    Verdict.BETTER: "better",
    Verdict.WORSE: "worse",
    Verdict.NOT_SHOWN: "not shown",
    Verdict.THE_SAME: "the same",
    Verdict.TOO_FEW: "few: {}",
    Verdict.NO_CASES: "",
}
_STYLES: dict[Verdict | None, Style] = {Verdict.BETTER: "good", Verdict.WORSE: "bad"}
_LINES = ("before", "after", "diff.", "95 %", "p Holm", "verdict", "chance", "ceiling")
_TERMINAL_NOTES = (
    "Diff.: percentage points, 95 % interval in pairs over recordings. p: corrected over a column.",
    "Verdict: of any-pixel detection, TPR and IoU detected, false positives only; from "
    f"{FEWEST_RECORDINGS} recordings on.",
    "Not shown: no difference that the data can show. Few: 4: cases of both in 4 recordings.",
    "Chance: before/after, on the mask of another frame. Ceiling: of the exact masks. False positives: of the image.",
)


def terminal_report(comparison: RunComparison) -> list[Block]:
    """For 100 columns, in lines: before, after, difference, interval, corrected p-value, verdict, chance, ceiling."""
    shown = _shown(comparison.rows)
    rows = []
    for row in comparison.rows:
        of_images = FALSE_POSITIVE_COVERAGE in row.metrics
        metrics = [FALSE_POSITIVE_COVERAGE] if of_images else list(shown)
        with_ceiling = any(row.metrics[metric].ceiling is not None for metric in metrics)
        first, *below = _LINES[:-2] if of_images else _LINES[: None if with_ceiling else -1]
        cells = [_terminal_cell(row.metrics[metric], below) for metric in metrics]
        label = Cell(row.label, (f"{row.frames} frames", f"{row.recordings} recordings"))
        rows.append([label, Cell(first, tuple(below)), *cells, *[None] * (len(shown) - len(cells))])
    title = f"{comparison.after.label} (after) against {comparison.before.label} (before), in percent"
    table = Table(title=title, columns=["Type", "", *shown.values()], rows=rows, words=2)
    return [table, *(Paragraph(note, "dim") for note in _TERMINAL_NOTES)]


def _shown(rows: Sequence[RowChange]) -> dict[str, Cell]:
    """IoU and TPR over all, detection at the highest level and of any pixel; IoU and TPR over detected."""
    at_level = detection_levels(rows[0].metrics)[-1:]
    names = ("iou", "tpr_all", *at_level, "detection_rate", "iou_detected", "tpr")
    return {name: _narrow(find_metric(name).label) for name in names}


def _narrow(label: str) -> Cell:
    """A heading in two lines."""
    first, _, second = label.partition(", " if "," in label else " ")
    return Cell(first, (second,) if second else ())


def _terminal_cell(cell: MetricChange, below: Sequence[str]) -> Cell:
    """The lines of a metric, in the colour of its verdict."""
    change = cell.change
    found = {
        "after": hundredths(change.after),
        "diff.": points(change.difference),
        "95 %": bounds(cell, ","),
        "p Holm": p_text(cell.p_holm),
        "verdict": "" if cell.verdict is None else _SHORT[cell.verdict].format(change.recordings),
        "chance": "" if cell.chance is None else "/".join(hundredths(level.value) for level in cell.chance),
        "ceiling": "" if cell.ceiling is None else hundredths(cell.ceiling),
    }
    return Cell(hundredths(change.before), tuple(found[line] for line in below), _STYLES.get(cell.verdict, ""))


CHANGES = "object_changes.csv"
NAMES = ("compare.md", "compare.csv", CHANGES, "compare.json", "compare.tex")
_PICTURE_NAME = re.compile(r"\d\d-\d\d-[a-z-]+\.jpg")


def write_comparison(
    folders: Sequence[Path],
    out: Path,
    *,
    pictures: bool = True,
    progress: Callable[[float, int], None] | None = None,
) -> tuple[list[RunComparison], tuple[Path, ...]]:
    """Compare runs and write `compare.md`, `.csv`, `.json`, `.tex`, `object_changes.csv` and `pictures/`.

    Each file appears whole or not at all. Pictures of an earlier comparison in `out` are removed, other files are left.

    Args:
        folders: of the runs, the one compared against first.
        out: folder, is made.
        pictures: draw the frames that changed most; needs the data set and the methods.
        progress: called with the pictures done and their number, for each pair anew.

    Returns:
        comparisons: the first run with each of the others.
        files: paths, texts first.

    Raises:
        DataError: a run is damaged.
        UsageError: fewer than two runs, or runs that do not compare.
    """
    comparisons = compare_runs(read_comparable(folders))
    if pictures:
        numbered = enumerate(comparisons, start=1)
        comparisons = [draw_changed_frames(found, number=number, progress=progress) for number, found in numbered]
    texts = {
        "compare.md": document.to_markdown(report(comparisons)),
        "compare.csv": to_csv(comparisons),
        "compare.json": to_json(comparisons),
        "compare.tex": to_latex(comparisons),
    }
    shown = {picture.name: picture.jpeg for comparison in comparisons for picture in comparison.drawn}
    for name, jpeg in shown.items():
        write_bytes(out / "pictures" / name, jpeg)
    write_texts(out, texts)
    write_object_changes(out / CHANGES, comparisons)
    for old in sorted((out / "pictures").glob("*.jpg")):
        if old.name not in shown and _PICTURE_NAME.fullmatch(old.name):
            old.unlink()
    return comparisons, (*(out / name for name in NAMES), *(out / "pictures" / name for name in shown))
