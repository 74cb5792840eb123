"""The table as sheets of text, which Markdown and LaTeX set in their own way."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.reporting.tables import FALSE_POSITIVES, Comparison, TableRow


def percent(ratio: float, *, cases: int = 0, digits: int = 1) -> str:
    """A ratio as "72.1 %"; "n/a (0 cases)" for NaN."""
    return f"n/a ({cases} cases)" if math.isnan(ratio) else f"{100 * ratio:.{digits}f} %"


def ours(figure: Comparison) -> str:
    """Our figure, for example "72.1 %"."""
    return percent(figure.value, cases=figure.cases)


def interval(figure: Comparison) -> str:
    """Our 95 % interval in percent, for example "[65.0, 78.3]"; empty where there is none."""
    return "" if figure.ci95 is None else f"[{100 * figure.ci95[0]:.1f}, {100 * figure.ci95[1]:.1f}]"


def ours_with_interval(figure: Comparison) -> str:
    """For example "72.1 % [65.0, 78.3]"."""
    return f"{ours(figure)} {interval(figure)}".rstrip()


def paper(figure: Comparison) -> str:
    """The paper's figure as it prints it, for example "72 %"; empty where it has none."""
    return "" if math.isnan(figure.paper) else percent(figure.paper, digits=0)


def difference(figure: Comparison) -> str:
    """Ours minus the paper's in percentage points, for example "+0.1"; empty where either is missing."""
    return "" if math.isnan(figure.difference_points) else f"{figure.difference_points:+.1f}"


def mean(figure: Comparison) -> str:
    """A mean that is no ratio, for example "3.2 [2.8, 3.9]"."""
    if math.isnan(figure.value):
        return f"n/a ({figure.cases} cases)"
    bounds = "" if figure.ci95 is None else f" [{figure.ci95[0]:.1f}, {figure.ci95[1]:.1f}]"
    return f"{figure.value:.1f}{bounds}"


def count(number: int | None) -> str:
    """A count as "3848"; empty for None."""
    return "" if number is None else str(number)


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
