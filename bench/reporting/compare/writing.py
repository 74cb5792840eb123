"""A comparison for people and programs: Markdown, CSV, JSON, LaTeX, terminal."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from bench.evaluation import Metric, find_metric
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.plain_text import escape_markdown
from bench.recordings import replacing, write_bytes
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
from bench.reporting.formats import (
    CEILING,
    INTERVALS,
    TextTable,
    csv_text,
    detection_levels,
    hundredths,
    json_text,
    markdown_table,
    number_columns,
    terminal_table,
    with_interval,
    write_texts,
)
from bench.reporting.stored_run import StoredRun
from bench.reporting.table_files import LatexNames, latex_label, latex_table

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


def to_markdown(comparisons: Sequence[RunComparison]) -> str:
    """The first run with each of the others as GitHub's Markdown."""
    first = comparisons[0].before.summary
    title = f"{', '.join(c.after.label for c in comparisons)} against {comparisons[0].before.label}"
    compared = (
        f"Data set {first.dataset}, {first.split or 'all recordings'}, protocol {first.protocol.name} "
        f"({first.protocol.digest[:12]}), reference {first.reference_fingerprint[:12]}."
    )
    parts = [f"# {escape_markdown(title)}", escape_markdown(compared)]
    for comparison in comparisons:
        parts += _section(comparison)
    return "\n\n".join([*parts, NOTE]) + "\n"


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


def bounds(cell: MetricChange) -> str:
    """The interval in percentage points, for example "-1.2 to +0.3"; empty where there is none."""
    return "" if cell.change.ci95 is None else " to ".join(points(end) for end in cell.change.ci95)


def _section(comparison: RunComparison) -> list[str]:
    before, after = comparison.before.label, comparison.after.label
    parts = [
        f"## {escape_markdown(f'{after} against {before}')}",
        f"**{escape_markdown(verdict_line(comparison))}**",
        escape_markdown(category_line(comparison)),
        escape_markdown(f"Before: {before}, {comparison.methods[0]}. After: {after}, {comparison.methods[1]}."),
        *map(escape_markdown, comparison.notes),
        *(_metric_table(comparison.rows, metric) for metric in _metrics(comparison.rows)),
        _detections(comparison),
    ]
    for kind in Kind:
        frames = [frame for frame in comparison.frames if frame.kind is kind]
        if frames:
            parts.append(_frames_table(kind, frames))
    for picture in comparison.drawn:
        title = escape_markdown(picture.title)
        parts += [f"**{title}**", f"![{title}](pictures/{picture.name})"]
    return parts + [f"*{escape_markdown(remark)}*" for remark in comparison.remarks]


def _metrics(rows: Sequence[RowChange]) -> list[str]:
    """Headlines first, then the others in their own order."""
    every = dict.fromkeys(metric for row in rows for metric in row.metrics)
    return [*(m for m in HEADLINES if m in every), *(m for m in every if m not in HEADLINES)]


def _metric_table(rows: Sequence[RowChange], metric: str) -> str:
    cells = [(row, row.metrics[metric]) for row in rows if metric in row.metrics]
    with_chance = any(cell.chance for _, cell in cells)
    headings = ["Type", "Frames", "Recordings", "before", "after", "difference", "95 %"]
    headings += ["chance before", "after"] if with_chance else []
    with_ceiling = any(cell.ceiling is not None for _, cell in cells)
    headings += ["ceiling"] if with_ceiling else []
    headings += ["p (Holm)", "verdict"] if metric in HEADLINES else []
    lines = []
    for row, cell in cells:
        change = cell.change
        line = [row.label, str(row.frames), str(change.recordings), hundredths(change.before), hundredths(change.after)]
        line += [points(change.difference), bounds(cell)]
        if cell.chance:
            line += [hundredths(metric.value) for metric in cell.chance]
        if with_ceiling:
            line.append("" if cell.ceiling is None else hundredths(cell.ceiling))
        if metric in HEADLINES:
            line += [p_text(cell.p_holm), "" if cell.verdict is None else verdict_text(cell.verdict, change)]
        lines.append(line)
    return f"**{find_metric(metric).label}, percent**\n\n{markdown_table(headings, lines)}"


def _detections(comparison: RunComparison) -> str:
    labels = {row.name: row.label for row in comparison.rows}
    counted = [(c.name, (c.object_frames, c.before, c.after, c.gained, c.lost)) for c in comparison.detections]
    lines = [[labels[name], *map(str, counts)] for name, counts in counted]
    headings = ("Type", "Object-frames", "detected before", "after", "newly detected", "newly missed")
    return f"**Object-frames gained and lost**\n\n{markdown_table(headings, lines)}"


def _frames_table(kind: Kind, frames: Sequence[ChangedFrame]) -> str:
    names = [frame_title(frame).removeprefix(kind.value).lstrip(": ") for frame in frames]
    lines = [[name, hundredths(f.before), hundredths(f.after)] for name, f in zip(names, frames, strict=True)]
    what, which = "share of the image", "the image with most"
    if frames[0].track_id is not None:
        what, which = "coverage", f"largest first, one per object, at most {LISTED}"
    table = markdown_table(("Frame", f"{what} before, percent", "after"), lines)
    return f"**{kind.value.capitalize()}: {which}**\n\n{table}"


_OF_LATEX = {"iou": "IoU", "tpr_all": "TPR", FALSE_POSITIVE_COVERAGE: "False positives"}
_LATEX_NOTE = (
    "IoU and TPR over all object-frames, an undetected one having 0; false positives as a share of the image, over all "
    f"images. On the images that both runs scored. {INTERVALS}"
)


def to_latex(comparisons: Sequence[RunComparison]) -> str:
    r"""A float for each pair of runs, both runs in the lines of each row; `\label` "tab:compare-<run>-<run>"."""
    return "\n".join(map(_latex, comparisons))


def _latex(comparison: RunComparison) -> str:
    runs = comparison.before, comparison.after
    lines = [
        [row.label, run.label, str(row.recordings), str(row.frames)]
        + [_value(row.metrics.get(metric), side) for metric in _OF_LATEX]
        for row in comparison.rows
        if row.frames
        for side, run in enumerate(runs)
    ]
    first = comparison.before.summary
    compared = f"data set {first.dataset}{f', split {first.split}' if first.split else ''}, {first.protocol.name}"
    table = TextTable(
        title=" and ".join(run.label for run in runs),
        headings=["Type", "Run", "Recordings", "Cases", *_OF_LATEX.values()],
        rows=lines,
        labels=2,
        note=_LATEX_NOTE,
    )
    label = "-".join(["compare", *(latex_label(run.label) for run in runs)])
    methods = f"{comparison.methods[0]} and {comparison.methods[1]}"
    return latex_table(table, LatexNames(label=label, about=f"{methods}, {compared}"))


def _value(cell: MetricChange | None, side: int) -> str:
    """Of the run before (0) or after (1), with its interval."""
    if cell is None:
        return ""
    value, cases = ((cell.change.before, cell.change.cases_before), (cell.change.after, cell.change.cases_after))[side]
    return with_interval(Metric(value=value, ci95=cell.intervals[side], cases=cases, recordings=cell.change.recordings))


SCHEMA_VERSION = 1
_CHANGED = ("gained", "lost", "both")


def to_csv(comparisons: Sequence[RunComparison]) -> str:
    """One line per pair of runs, row and metric, ratios at full precision; empty where there is no number."""
    return csv_text(
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
        "dataset": first.dataset,
        "split": first.split,
        "protocol": first.protocol.model_dump(),
        "reference_fingerprint": first.reference_fingerprint,
        "comparisons": [_json_comparison(comparison) for comparison in comparisons],
    }
    return json_text(content)


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
    made = run.summary.provenance
    return {
        "run": run.label,
        "method": run.summary.method.model_dump(),
        "version": made.version,
        "commit": made.commit,
        "started_utc": made.started_utc,
    }


def _json_change(cell: MetricChange) -> dict[str, Any]:
    chance = None if cell.chance is None else [metric.value for metric in cell.chance]
    own = {"p_holm": cell.p_holm, "verdict": cell.verdict, "chance": chance, "ceiling": cell.ceiling}
    return asdict(cell.change) | own


MIN_COLUMNS = 100  # a console narrower than this cuts the table
_SHORT = {
    Verdict.BETTER: "better",
    Verdict.WORSE: "worse",
    Verdict.NOT_SHOWN: "not shown",
    Verdict.THE_SAME: "the same",
    Verdict.TOO_FEW: "few: {}",
    Verdict.NO_CASES: "",
}
_STYLES = {Verdict.BETTER: "green", Verdict.WORSE: "red"}
_LINES = ("before", "after", "diff.", "95 %", "p Holm", "verdict", "chance", "ceiling")
_CAPTION = (
    "Diff.: percentage points, 95 % interval in pairs over recordings. p: corrected over a column.\n"
    "Verdict: of any-pixel detection, TPR and IoU detected, false positives only; from "
    f"{FEWEST_RECORDINGS} recordings on.\n"
    "Not shown: no difference that the data can show. Few: 4: cases of both in 4 recordings.\n"
    "Chance: before/after, on the mask of another frame. Ceiling: of the exact masks. False positives: of the image."
)


def to_rich(comparison: RunComparison) -> Table:
    """Lines per row: before, after, difference, its interval, corrected p-value, verdict, chance levels, ceiling.

    Returns:
        A table to print on a `rich.console.Console` of at least `MIN_COLUMNS`; nothing is printed here.
    """
    shown = _shown(comparison.rows)
    title = f"{comparison.after.label} (after) against {comparison.before.label} (before), in percent"
    table = terminal_table(title, caption=Text(_CAPTION), below=1, right=0)
    table.min_width = MIN_COLUMNS
    table.add_column("Type", no_wrap=True)
    table.add_column("", style="dim", no_wrap=True)
    number_columns(table, shown.values(), min_width=9)
    for row in comparison.rows:
        metrics = [FALSE_POSITIVE_COVERAGE] if FALSE_POSITIVE_COVERAGE in row.metrics else list(shown)
        with_ceiling = any(row.metrics[metric].ceiling is not None for metric in metrics)
        lines = _LINES[:-2] if FALSE_POSITIVE_COVERAGE in row.metrics else _LINES[: None if with_ceiling else -1]
        label = f"{row.label}\n{row.frames} frames\n{row.recordings} recordings"
        table.add_row(Text(label), Text("\n".join(lines)), *(_cell(row.metrics[metric], lines) for metric in metrics))
    return table


def _shown(rows: Sequence[RowChange]) -> dict[str, str]:
    """IoU and TPR over all, detection at the highest level and of any pixel; IoU and TPR over detected."""
    at_level = detection_levels(rows[0].metrics)[-1:]
    names = ("iou", "tpr_all", *at_level, "detection_rate", "iou_detected", "tpr")
    return {name: _narrow(find_metric(name).label) for name in names}


def _narrow(label: str) -> str:
    """A heading in two lines."""
    return label.replace(", ", "\n", 1) if "," in label else label.replace(" ", "\n", 1)


def _cell(cell: MetricChange, lines: Sequence[str]) -> Text:
    change = cell.change
    ends = "" if change.ci95 is None else ",".join(points(end) for end in change.ci95)
    found = {
        "before": hundredths(change.before),
        "after": hundredths(change.after),
        "diff.": points(change.difference),
        "95 %": ends,
        "p Holm": p_text(cell.p_holm),
        "verdict": "" if cell.verdict is None else _SHORT[cell.verdict].format(change.recordings),
        "chance": "" if cell.chance is None else "/".join(hundredths(level.value) for level in cell.chance),
        "ceiling": "" if cell.ceiling is None else hundredths(cell.ceiling),
    }
    text = Text()
    for number, line in enumerate(lines):
        style = "bold" if line == "diff." else ""
        if line == "verdict" and cell.verdict is not None:
            style = _STYLES.get(cell.verdict, "")
        text.append(("\n" if number else "") + found[line], style=style)
    return text


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
        "compare.md": to_markdown(comparisons),
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
