"""A comparison for people and programs: Markdown, CSV, JSON, terminal."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.plain_text import escape_markdown
from bench.recordings import replacing, write_bytes, write_text
from bench.reporting.compare.changes import (
    FALSE_POSITIVE_COVERAGE,
    HEADLINES,
    LISTED,
    ChangedFrame,
    Kind,
    MetricChange,
    RowChange,
    Verdict,
    paired_objects,
    verdict_text,
)
from bench.reporting.compare.comparison import RunComparison, category_line, compare_runs, verdict_line
from bench.reporting.compare.pictures import DrawnFrame, draw_changed_frames, frame_title
from bench.reporting.compare.runs import StoredRun, read_comparable

NOTE = (
    "Differences are after minus before, in percentage points, with 95 % intervals by recording, in pairs: the "
    "difference is taken again without each recording (jackknife). p: two-sided, of no difference, corrected after "
    "Holm over the rows of one metric that have a p-value (the categories and all moving objects; false-positive "
    "coverage has one row), for each pair of runs by itself. Only detection rate, TPR and IoU over detected "
    "object-frames and false-positive coverage are judged; other figures stand with their interval and without a "
    "p-value. Better or worse is said only if the interval excludes 0 and the corrected p-value is at most 5 %; both "
    f"need {FEWEST_RECORDINGS} recordings with cases of both runs: with fewer, the same change in all of them could be "
    "chance. Recordings: with cases of both runs. TPR and IoU over detected object-frames are taken over other "
    "object-frames in each run where detection differs; TPR and IoU over all are not. Chance: the same objects on the "
    "mask of another frame."
)
_OTHERS = {
    "tpr_all": "TPR, all",
    "iou": "IoU, all",
    "false_positive_coverage_valid": "False positives of the valid pixels",
    "false_positive_frame_rate": "Frames with a large false positive",
    "segmentation_iou": "IoU of the pixels",
    "precision": "Precision of the pixels",
    "recall": "Recall of the pixels",
}


def to_markdown(
    comparisons: Sequence[RunComparison],
    *,
    drawn: Sequence[Sequence[DrawnFrame]],
    remarks: Sequence[Sequence[str]],
) -> str:
    """The comparison as GitHub's Markdown.

    Args:
        comparisons: of the first run with each of the others.
        drawn: pictures of each.
        remarks: what is to be said about the pictures of each.
    """
    first = comparisons[0].before.summary
    title = f"{', '.join(c.after.label for c in comparisons)} against {comparisons[0].before.label}"
    compared = (
        f"Data set {first.dataset}, {first.split or 'all recordings'}, protocol {first.protocol.name} "
        f"({first.protocol.digest[:12]}), reference {first.reference_fingerprint[:12]}."
    )
    parts = [f"# {escape_markdown(title)}", escape_markdown(compared)]
    for comparison, pictures, said in zip(comparisons, drawn, remarks, strict=True):
        parts += _section(comparison, pictures, said)
    return "\n\n".join([*parts, NOTE]) + "\n"


def metric_label(metric: str) -> str:
    """A metric's name for people."""
    if metric.startswith("detection_rate_"):
        return f"Detection at {metric.removeprefix('detection_rate_')} %"
    return HEADLINES.get(metric) or _OTHERS[metric]


def points(ratio: float) -> str:
    """A difference in percentage points, for example "+1.2"; no sign for exactly 0, "n/a" for NaN."""
    if ratio == 0:
        return "0.0"
    return "n/a" if math.isnan(ratio) else f"{100 * ratio:+.1f}"


def share(ratio: float) -> str:
    """A ratio in percent without the sign, for example "72.1"; "n/a" for NaN."""
    return "n/a" if math.isnan(ratio) else f"{100 * ratio:.1f}"


def p_text(p_value: float | None) -> str:
    """For example "0.012" or "<0.001"; empty for None."""
    if p_value is None:
        return ""
    return "<0.001" if p_value < 0.001 else f"{p_value:.3f}"


def bounds(cell: MetricChange) -> str:
    """The interval in percentage points, for example "-1.2 to +0.3"; empty where there is none."""
    return "" if cell.change.ci95 is None else " to ".join(points(end) for end in cell.change.ci95)


def markdown_table(headings: Sequence[str], rows: Sequence[Sequence[str]], *, text_columns: int = 1) -> str:
    """A table of GitHub's Markdown, the first columns left-aligned, the others right."""
    rule = [":--" if place < text_columns else "--:" for place in range(len(headings))]
    lines = [[escape_markdown(cell) for cell in row] for row in (headings, rule, *rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _section(comparison: RunComparison, drawn: Sequence[DrawnFrame], remarks: Sequence[str]) -> list[str]:
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
    for picture in drawn:
        title = escape_markdown(picture.title)
        parts += [f"**{title}**", f"![{title}](pictures/{picture.name})"]
    return parts + [f"*{escape_markdown(remark)}*" for remark in remarks]


def _metrics(rows: Sequence[RowChange]) -> list[str]:
    """Headlines first, then the others in their own order."""
    every = dict.fromkeys(metric for row in rows for metric in row.metrics)
    return [*(m for m in HEADLINES if m in every), *(m for m in every if m not in HEADLINES)]


def _metric_table(rows: Sequence[RowChange], metric: str) -> str:
    cells = [(row, row.metrics[metric]) for row in rows if metric in row.metrics]
    with_chance = any(cell.chance for _, cell in cells)
    headings = ["Type", "Frames", "Recordings", "before", "after", "difference", "95 %"]
    headings += ["chance before", "after"] if with_chance else []
    headings += ["p (Holm)", "verdict"] if metric in HEADLINES else []
    lines = []
    for row, cell in cells:
        change = cell.change
        line = [row.label, str(row.frames), str(change.recordings), share(change.before), share(change.after)]
        line += [points(change.difference), bounds(cell)]
        if cell.chance:
            line += [share(figure.value) for figure in cell.chance]
        if metric in HEADLINES:
            line += [p_text(cell.p_holm), "" if cell.verdict is None else verdict_text(cell.verdict, change)]
        lines.append(line)
    return f"**{metric_label(metric)}, percent**\n\n{markdown_table(headings, lines)}"


def _detections(comparison: RunComparison) -> str:
    labels: Mapping[str, str] = {row.name: row.label for row in comparison.rows}
    lines = [
        [labels[c.name], *(str(n) for n in (c.object_frames, c.before, c.after, c.gained, c.lost))]
        for c in comparison.detections
    ]
    headings = ("Type", "Object-frames", "detected before", "after", "newly detected", "newly missed")
    return f"**Object-frames gained and lost**\n\n{markdown_table(headings, lines)}"


def _frames_table(kind: Kind, frames: Sequence[ChangedFrame]) -> str:
    lines = [[frame_title(f).removeprefix(kind.value).lstrip(": "), share(f.before), share(f.after)] for f in frames]
    what = "coverage" if frames[0].track_id is not None else "share of the image"
    which = (
        f"largest first, one per object, at most {LISTED}" if frames[0].track_id is not None else "the image with most"
    )
    return (
        f"**{kind.value.capitalize()}: {which}**\n\n"
        f"{markdown_table(('Frame', f'{what} before, percent', 'after'), lines)}"
    )


SCHEMA_VERSION = 1
_CHANGED = ("gained", "lost", "both")


def to_csv(comparisons: Sequence[RunComparison]) -> str:
    """One line per pair of runs, row and metric, ratios at full precision; empty where there is no number."""
    heading = ["before_run", "after_run", "row", "frames", "metric", "before", "after", "difference", "ci95_low",
               "ci95_high", "p_value", "p_holm", "cases_before", "cases_after", "recordings", "chance_before",
               "chance_after", "verdict", "images_before", "images_after", "images_compared"]  # fmt: skip
    lines = []
    for comparison in comparisons:
        for row in comparison.rows:
            for metric, cell in row.metrics.items():
                change, chance = cell.change, cell.chance
                low, high = change.ci95 or (None, None)
                numbers = [change.before, change.after, change.difference, low, high, change.p_value, cell.p_holm]
                chances = [None, None] if chance is None else [figure.value for figure in chance]
                lines.append(
                    [comparison.before.label, comparison.after.label, row.name, row.frames, metric,
                     *map(_or_empty, numbers), change.cases_before, change.cases_after, change.recordings,
                     *map(_or_empty, chances), cell.verdict or "", *comparison.images]
                )  # fmt: skip
    return _csv(heading, lines)


def write_object_changes(file: Path, comparisons: Sequence[RunComparison]) -> None:
    """Write one line per object-frame that was gained, was lost, or changed its coverage, a part of them at a time."""
    columns = ["recording", "camera", "timestamp_ns", "track_id", "object_class", "category", "range_m", "region_px",
               "change", "coverage_before", "coverage_after", "iou_before", "iou_after"]  # fmt: skip
    with replacing(file) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["before_run", "after_run", *columns])
        for comparison in comparisons:
            labels = comparison.before.label, comparison.after.label
            for rows in paired_objects(comparison.before, comparison.after):
                changed = rows[rows["change"].isin(_CHANGED) & (rows["coverage_before"] != rows["coverage_after"])]
                values = [_cells(changed[name]) for name in columns]
                writer.writerows((*labels, *line) for line in zip(*values, strict=True))


def to_json(
    comparisons: Sequence[RunComparison],
    *,
    drawn: Sequence[Sequence[DrawnFrame]],
    remarks: Sequence[Sequence[str]],
) -> str:
    """Everything but the object-frames, at full precision; null where there is no number."""
    first = comparisons[0].before.summary
    content = {
        "schema_version": SCHEMA_VERSION,
        "note": NOTE,
        "dataset": first.dataset,
        "split": first.split,
        "protocol": first.protocol.model_dump(),
        "reference_fingerprint": first.reference_fingerprint,
        "comparisons": [
            _json_comparison(comparison, pictures, said)
            for comparison, pictures, said in zip(comparisons, drawn, remarks, strict=True)
        ],
    }
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _json_comparison(comparison: RunComparison, drawn: Sequence[DrawnFrame], remarks: Sequence[str]) -> dict[str, Any]:
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
        "pictures": [{"file": f"pictures/{picture.name}", "title": picture.title} for picture in drawn],
        "remarks": list(remarks),
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
    change = asdict(cell.change)
    return {
        **{name: _or_none(value) if isinstance(value, float) else value for name, value in change.items()},
        "p_holm": cell.p_holm,
        "verdict": cell.verdict,
        "chance": None if cell.chance is None else [_or_none(figure.value) for figure in cell.chance],
    }


def _cells(column: pd.Series[Any]) -> list[object]:
    values: list[object] = column.tolist()
    return [_or_empty(value) if isinstance(value, float) else value for value in values]


def _csv(heading: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(heading)
    writer.writerows(lines)
    return buffer.getvalue()


def _or_none(number: float) -> float | None:
    return None if math.isnan(number) else number


def _or_empty(number: float | None) -> str:
    return "" if number is None or math.isnan(number) else repr(float(number))


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
_LINES = ("before", "after", "diff.", "95 %", "p Holm", "verdict", "chance")
_CAPTION = (
    "Diff.: percentage points, 95 % interval in pairs over recordings. p: corrected over a column.\n"
    "Not shown: no difference that the data can show. Few: 4: cases of both in 4 recordings, a verdict needs 6.\n"
    "Chance: before/after, on the mask of another frame. False positives: share of the image."
)


def to_rich(comparison: RunComparison) -> Table:
    """Seven lines per row: before, after, difference, its interval, corrected p-value, verdict, chance levels.

    Returns:
        A table to print on a `rich.console.Console` of at least `MIN_COLUMNS`; nothing is printed here.
    """
    shown = _shown(comparison.rows)
    table = Table(
        box=SIMPLE_HEAD,
        padding=(0, 0, 1, 0),
        show_edge=False,
        min_width=MIN_COLUMNS,
        title=f"{comparison.after.label} (after) against {comparison.before.label} (before), in percent",
        title_justify="left",
        caption=Text(_CAPTION),
        caption_justify="left",
    )
    table.add_column("Type", no_wrap=True)
    table.add_column("", style="dim", no_wrap=True)
    for heading in shown.values():
        table.add_column(Text(heading), justify="right", no_wrap=True, min_width=9)
    for row in comparison.rows:
        metrics = [FALSE_POSITIVE_COVERAGE] if FALSE_POSITIVE_COVERAGE in row.metrics else list(shown)
        lines = _LINES[:-1] if FALSE_POSITIVE_COVERAGE in row.metrics else _LINES
        label = f"{row.label}\n{row.frames} frames\n{row.recordings} recordings"
        table.add_row(Text(label), Text("\n".join(lines)), *(_cell(row.metrics[metric], lines) for metric in metrics))
    return table


def _shown(rows: Sequence[RowChange]) -> dict[str, str]:
    """Any detection and that at the highest level; TPR and IoU over detected and over all."""
    levels = [name for name in rows[0].metrics if name.startswith("detection_rate_")]
    highest = max(levels, key=lambda name: float(name.removeprefix("detection_rate_")), default=None)
    at_level = {} if highest is None else {highest: f"Detection\nat {highest.removeprefix('detection_rate_')} %"}
    return {
        "detection_rate": "Detection\nany pixel",
        **at_level,
        "tpr": "TPR\ndetected",
        "iou_detected": "IoU\ndetected",
        "tpr_all": "TPR\nall",
        "iou": "IoU\nall",
    }


def _cell(cell: MetricChange, lines: Sequence[str]) -> Text:
    change = cell.change
    ends = "" if change.ci95 is None else ",".join(points(end) for end in change.ci95)
    found = {
        "before": share(change.before),
        "after": share(change.after),
        "diff.": points(change.difference),
        "95 %": ends,
        "p Holm": p_text(cell.p_holm),
        "verdict": "" if cell.verdict is None else _SHORT[cell.verdict].format(change.recordings),
        "chance": "" if cell.chance is None else "/".join(share(figure.value) for figure in cell.chance),
    }
    text = Text()
    for place, line in enumerate(lines):
        style = "bold" if line == "diff." else ""
        if line == "verdict" and cell.verdict is not None:
            style = _STYLES.get(cell.verdict, "")
        text.append(("\n" if place else "") + found[line], style=style)
    return text


CHANGES = "object_changes.csv"
NAMES = ("compare.md", "compare.csv", CHANGES, "compare.json")
_PICTURE_NAME = re.compile(r"\d\d-\d\d-[a-z-]+\.jpg")


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenComparison:
    """What was written.

    Attributes:
        comparisons: the first run with each of the others, for the terminal.
        remarks: about pictures that could not be made, or that do not show what was stored.
        files: paths, texts first.
    """

    comparisons: tuple[RunComparison, ...]
    remarks: tuple[str, ...]
    files: tuple[Path, ...]


def write_comparison(
    folders: Sequence[Path],
    out: Path,
    *,
    pictures: bool = True,
    progress: Callable[[float, int], None] | None = None,
) -> WrittenComparison:
    """Compare runs and write `compare.md`, `.csv`, `.json`, `object_changes.csv` and `pictures/`.

    Each file appears whole or not at all. Pictures of an earlier comparison in `out` are removed, other files are left.

    Args:
        folders: of the runs, the one compared against first.
        out: folder, is made.
        pictures: draw the frames that changed most; needs the data set and the methods.
        progress: called with the pictures done and their number, for each pair anew.

    Raises:
        DataError: a run is damaged.
        UsageError: fewer than two runs, or runs that do not compare.
    """
    comparisons = compare_runs(read_comparable(folders))
    drawn: list[list[DrawnFrame]] = []
    remarks: list[list[str]] = []
    for number, comparison in enumerate(comparisons, start=1):
        made, said = draw_changed_frames(comparison, number=number, progress=progress) if pictures else ([], [])
        drawn.append(made)
        remarks.append(said)
    texts = {
        "compare.md": to_markdown(comparisons, drawn=drawn, remarks=remarks),
        "compare.csv": to_csv(comparisons),
        "compare.json": to_json(comparisons, drawn=drawn, remarks=remarks),
    }
    shown = {picture.name: picture.jpeg for made in drawn for picture in made}
    for name, jpeg in shown.items():
        write_bytes(out / "pictures" / name, jpeg)
    for name, text in texts.items():
        write_text(out / name, text)
    write_object_changes(out / CHANGES, comparisons)
    for old in sorted((out / "pictures").glob("*.jpg")):
        if old.name not in shown and _PICTURE_NAME.fullmatch(old.name):
            old.unlink()
    return WrittenComparison(
        comparisons=tuple(comparisons),
        remarks=tuple(line for said in remarks for line in said),
        files=(*(out / name for name in NAMES), *(out / "pictures" / name for name in shown)),
    )
