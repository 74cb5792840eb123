"""Formats of values and intervals and names of images, the same in every output of this package."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Container, Iterable
from dataclasses import replace

from bench.evaluation.definitions import HALF, IMAGE_FRAMES, headlines
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.protocol import Protocol
from bench.evaluation.summary import Metric, Summary
from bench.evaluation.sums import ALL_MOVING, FRAMES
from bench.records.reference import Category, ReferenceFrame
from bench.reporting.document import Bar, Cell

LABELS: dict[str, str] = {
    Category.CROSSING: "Crossing",
    Category.OVERTAKING: "Overtaking",
    Category.PRECEDING: "Preceding",
    Category.APPROACHING: "Approaching",
    Category.STATIC_EGO: "Static ego-vehicle",
    Category.MOVING: "Moving",
    ALL_MOVING: "All moving",
    FRAMES: "False positives",
}
# The constraint of the paper for a kind of motion: the cause that methods name, if any, and what the paper calls it.
CONSTRAINTS: dict[str, tuple[str, str]] = {
    Category.CROSSING: ("epipolar", "epipolar"),
    Category.OVERTAKING: ("positive_depth", "positive depth"),
    Category.PRECEDING: ("positive_height", "positive height"),
    Category.APPROACHING: ("anti_parallel", "anti-parallel"),
    Category.STATIC_EGO: ("static_camera", "degenerate"),
    Category.MOVING: ("", "kind unknown"),
}
INTERVALS = (
    "Intervals: 95 %, by recording, since images of one recording are not independent (jackknife, Student's t on the "
    f"logit scale); metrics with cases in fewer than {FEWEST_RECORDINGS} recordings have none."
)

LARGE_FALSE = "false_positive_frame_rate"  # a headline for readers beside false-positive coverage, which hides it
CEILING = "what the exact masks score under the same protocol; under paper-v1 other masks can score more"


def row_label(name: str, causes: Container[str]) -> str:
    """For example "Crossing (epipolar)", as the paper's rows are called; "Crossing" for a method without constraints.

    Args:
        name: of a kind of motion, or of all.
        causes: that the method names.
    """
    cause, words = CONSTRAINTS.get(name, ("", ""))
    return f"{LABELS[name]} ({words})" if words and (not cause or cause in causes) else LABELS[name]


def percent(ratio: float) -> str:
    """A ratio as "72.1 %"; "n/a (0 cases)" for NaN."""
    return "n/a (0 cases)" if math.isnan(ratio) else f"{100 * ratio:.1f} %"


def interval(ci95: tuple[float, float] | None, *, unit: float = 100.0, digits: int = 1) -> str:
    """A 95 % interval in percent, "[65.0, 78.3]", or in another unit; "" for none."""
    return "" if ci95 is None else "[{:.{d}f}, {:.{d}f}]".format(*(unit * end for end in ci95), d=digits)


def points(ratio: float) -> str:
    """A difference in percentage points, for example "+1.2"; no sign for exactly 0, "n/a" for NaN."""
    if ratio == 0:
        return "0.0"
    return "n/a" if math.isnan(ratio) else f"{100 * ratio:+.1f}"


def number(digits: int, *, times: float = 1.0, none: str = "") -> Callable[[float], str]:
    """Return the function that formats the numbers of a column in another unit; `none` for NaN."""
    return lambda value: none if math.isnan(value) else f"{times * value:.{digits}f}"


hundredths = number(1, times=100, none="n/a")  # a ratio in percent without the sign, "72.1"


def points_interval(ci95: tuple[float, float]) -> str:
    """In percentage points, for example "-1.2 to +0.3"."""
    return " to ".join(map(points, ci95))


def short_interval(ci95: tuple[float, float] | None) -> str:
    """A 95 % interval in whole percent, "65-78"; "" without one."""
    return "" if ci95 is None else "{:.0f}-{:.0f}".format(*(100 * end for end in ci95))


def metric_cell(metric: Metric) -> Cell:
    """A ratio, "72.1 %", over its interval, "[65.0, 78.3]"; "n/a" over "(0 cases)" for NaN."""
    if math.isnan(metric.value):
        return Cell("n/a", (f"({metric.cases} cases)",))
    return Cell(percent(metric.value), (interval(metric.ci95),) if metric.ci95 else ())


def bar_cell(metric: Metric, *notes: str, tick: float | None = None) -> Cell:
    """A ratio with its bar, and its interval and notes below."""
    cell = metric_cell(metric)
    if math.isnan(metric.value):
        return cell
    below = tuple(filter(None, (*cell.below, *notes)))
    bar = Bar(share=metric.value, interval=metric.ci95, tick=tick)
    return replace(cell, below=below, style="strong", bar=bar)


def with_interval(metric: Metric) -> str:
    """A ratio as "72.1 % [65.0, 78.3]", "72.1 %" without interval, "n/a (0 cases)" for NaN."""
    cell = metric_cell(metric)
    return " ".join((cell.text, *cell.below))


def ends(metric: Metric) -> dict[str, float | None]:
    """The ends of the interval as columns of CSV; None without one."""
    return dict(zip(("ci95_low", "ci95_high"), metric.ci95 or (None, None), strict=True))


def headline_metrics(summary: Summary) -> dict[str, Metric]:
    """The headline metrics of a run over all moving objects, and the false positives of its images.

    Detection at 50 % is missing where the protocol has no such level.
    """
    moving = summary.all_moving
    of_objects = {m.name: moving.metric(m.name) for m in headlines() if m.name in moving.metric_names()}
    return of_objects | {m.name: summary.false_positives.coverage for m in headlines() if m.over == IMAGE_FRAMES}


def detection_levels(names: Iterable[str]) -> list[str]:
    """Those of the names that are detection rates at a level, as "detection_rate_50", the lowest level first."""
    levels = {name: name.removeprefix("detection_rate_") for name in names if name.startswith("detection_rate_")}
    return sorted(levels, key=lambda name: float(levels[name]))


def found_level(protocol: Protocol) -> float:
    """The least coverage that counts as found: half of the core under a protocol with unknown bands, else 0, any pixel.

    Methods that mark much of the image touch every object: "any pixel" says nothing of them.
    """
    return 0.0 if protocol.reference.unknown_band is None else HALF


def found_by(protocol: Protocol) -> str:
    """What of an object has to be marked for `found_level`, in words."""
    return "half of the core" if found_level(protocol) else "any pixel"


CORE = (
    "Core: the part of an object's region that the lidar shows for certain. The unknown band around it counts neither "
    "way."
)


def chance_of(name: str) -> str:
    """Name of the chance level of a detection rate."""
    return name.replace("detection_rate", "chance")


def image_name(recording: str, camera: str, timestamp_ns: int) -> str:
    """Return the name of an image as every picture shows it: "drive-1, camera front, 1.20 s"."""
    return f"{recording}, camera {camera}, {timestamp_ns / 1e9:.2f} s"


def frame_name(reference: ReferenceFrame) -> str:
    """Return the name of the image of a reference, as `image_name` writes it."""
    return image_name(reference.recording, reference.camera, reference.timestamp_ns)


def made_by(method: str, protocol: str) -> str:
    """Return what a picture shows beside the name of its image: "method spherical, protocol paper-v1"."""
    return f"method {method}, protocol {protocol}"


def file_name(name: str) -> str:
    """A name as part of a file's; names come from data files and may hold anything."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", name)[:80]
