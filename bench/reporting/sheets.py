"""The table as sheets of text, which Markdown and LaTeX set in their own way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.reporting.numbers import count, difference, mean, ours, ours_with_interval, paper
from bench.reporting.tables import FALSE_POSITIVES, TableRow

COMPARED = {"detection_rate": "Detection rate", "tpr": "TPR", "iou_detected": "IoU"}
COVERAGES = {
    "tpr": "TPR, detected",
    "tpr_all": "TPR, all",
    "iou": "IoU, all",
    "iou_detected": "IoU, detected",
}
INTERVALS = (
    "Intervals: 95 %, by recording, since images of one recording are not independent (jackknife, Student's t on the "
    f"logit scale); figures with cases in fewer than {FEWEST_RECORDINGS} recordings have none."
)
NOTE = (
    "TPR and IoU beside the paper's are averages over the detected object-frames. Chance: the same objects on the mask "
    f"of another frame. {INTERVALS} Differences in percentage points. In the last row, "
    "the area of the image. The paper's recordings are private: same form, not the same data."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """A table of text; the first column names the row."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def sheets(rows: Sequence[TableRow]) -> tuple[Sheet, ...]:
    """Ours beside the paper's; detection and coverage with their intervals; the false positives."""
    rates: dict[str, str] = {}
    for name, heading in detection_figures(rows).items():
        rates |= {name: heading, name.replace("detection_rate", "chance"): "chance"}
    return (
        _beside_the_paper(rows),
        _with_intervals(rows, title="Detection with 95 % intervals", shown=rates),
        _with_intervals(rows, title="Coverage with 95 % intervals", shown=COVERAGES),
        _false_positives(rows),
    )


def detection_figures(rows: Sequence[TableRow]) -> dict[str, str]:
    """Names and headings of the detection rates, with the protocol's own levels."""
    names = next((list(row.figures) for row in rows if row.name != FALSE_POSITIVES), [])
    levels = sorted((name for name in names if name.startswith("detection_rate_")), key=_level)
    return {"detection_rate": "Detection rate"} | {name: f"at {_level(name):g} %" for name in levels}


def _level(name: str) -> float:
    return float(name.removeprefix("detection_rate_"))


def _beside_the_paper(rows: Sequence[TableRow]) -> Sheet:
    headings = ["Type", "Recordings", "# Frames", "paper"]
    for heading in COMPARED.values():
        headings += [heading, "paper", "diff."]
    lines = []
    for row in rows:
        line = [row.label, count(row.recordings), count(row.frames), count(row.paper_frames)]
        # The paper prints the false-positive coverage in the column of the detection rate.
        names = ["coverage"] if row.name == FALSE_POSITIVES else list(COMPARED)
        for name in names:
            figure = row.figures[name]
            line += [ours(figure), paper(figure), difference(figure)]
        lines.append(tuple(line) + ("",) * (len(headings) - len(line)))
    return Sheet(
        title="Results by category of objects, beside the paper's", headings=tuple(headings), rows=tuple(lines)
    )


def _with_intervals(rows: Sequence[TableRow], *, title: str, shown: Mapping[str, str]) -> Sheet:
    lines = [
        (
            row.label,
            count(row.recordings),
            count(row.frames),
            count(row.tracks),
            *(ours_with_interval(row.figures[name]) for name in shown),
        )
        for row in rows
        if row.name != FALSE_POSITIVES
    ]
    return Sheet(
        title=title, headings=("Type", "Recordings", "# Frames", "Objects", *shown.values()), rows=tuple(lines)
    )


def _false_positives(rows: Sequence[TableRow]) -> Sheet:
    lines = [
        (
            count(row.recordings),
            count(row.frames),
            ours_with_interval(row.figures["coverage"]),
            ours_with_interval(row.figures["coverage_valid"]),
            ours_with_interval(row.figures["frame_rate"]),
            mean(row.figures["components_per_frame"]),
        )
        for row in rows
        if row.name == FALSE_POSITIVES
    ]
    headings = (
        "Recordings",
        "Image-frames",
        "False-positive coverage",
        "of the valid pixels",
        "Frames with a large false positive",
        "Components per frame",
    )
    return Sheet(title="False positives", headings=headings, rows=tuple(lines))
