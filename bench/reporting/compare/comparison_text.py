"""The comparison as Markdown."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.plain_text import escape_markdown
from bench.reporting.compare.changes import HEADLINES, MetricChange, RowChange
from bench.reporting.compare.comparison import RunComparison, category_line, verdict_line
from bench.reporting.compare.detections import LISTED, ChangedFrame, Kind
from bench.reporting.compare.pictures import DrawnFrame, frame_title
from bench.reporting.compare.verdicts import verdict_text

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
