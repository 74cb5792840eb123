"""An image as one or several methods were scored on it: the areas of each beside each other under one legend."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from bench.errors import BenchError, UsageError
from bench.evaluation.counts import ObjectCounts, count_frame
from bench.harness import FramePipeline, ProcessedFrame
from bench.harness.frames import UnscorableFrame
from bench.harness.replay import StoredFrames
from bench.harness.stages import Progress
from bench.harness.stored import StoredRun
from bench.records.reference import ReferenceFrame
from bench.reporting import canvas
from bench.reporting.formats import frame_name, shortened
from bench.reporting.overlay import (
    AREA_COLOURS,
    AREA_NAMES,
    PixelClass,
    areas_of,
    detected_pixels,
    draw_outline,
    false_positive_text,
    outlined,
    overlay_areas,
    pixel_classes,
    place_labels,
)

ImageKey = tuple[str, str, int]  # recording, camera, timestamp_ns
Drawn = TypeVar("Drawn")
COLUMNS = 2
WIDTH_IN = 3.5  # of a picture: a column of a paper
_MARGIN_IN, _LEGEND_IN, _TITLE_IN, _LINE_IN = 0.04, 0.36, 0.18, 0.13
_LONGEST_LABEL, _LONGEST_TITLE = 62, 120
_BACKGROUND_STRENGTH, _OUTSIDE_STRENGTH, _TINT = 0.8, 0.3, 0.62


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Side:
    """Result of one method on the image.

    Attributes:
        processed: the image with the method's mask and the reference.
        label: names the run or the method; empty where they are named beside the picture.
        note: a line of values; empty for the false positives of the image.
    """

    processed: ProcessedFrame
    label: str = ""
    note: str = ""


@canvas.styled
def draw_side_by_side(sides: Sequence[Side], *, title: str = "") -> Figure:
    """Draw an image as methods were scored on it, two in a row, with recording, camera and time above.

    Args:
        sides: at least one, of the same image.
        title: a line above all; empty for none.

    Raises:
        UsageError: sides of different images.

    Source:
        Mariotti and Eising 2020, the figure that explains the detection rates.
    """
    reference = sides[0].processed.reference
    names = {(r.recording, r.camera, r.timestamp_ns) for r in (side.processed.reference for side in sides)}
    if len(names) != 1:
        raise UsageError(f"side by side: expected one image, got {len(names)}: {sorted(names)}")
    columns = min(COLUMNS, len(sides))
    lines = -(-len(sides) // columns)
    height, width = reference.valid.shape
    picture_in = float((WIDTH_IN - 2 * _MARGIN_IN) * height / width)
    head_in = (1 + any(side.label for side in sides)) * _LINE_IN + _MARGIN_IN
    full_in = _TITLE_IN * (1 + bool(title)) + lines * (head_in + picture_in) + _LEGEND_IN
    figure = canvas.new_figure(columns * WIDTH_IN, full_in)
    heading = f"{shortened(title, _LONGEST_TITLE)}\n{frame_name(reference)}".lstrip()
    figure.text(0.5, 1 - 0.03 / full_in, heading, ha="center", va="top", fontsize=8)
    for number, side in enumerate(sides):
        row, column = divmod(number, columns)
        bottom_in = _LEGEND_IN + (lines - 1 - row) * (head_in + picture_in)
        axes = canvas.axes_at(figure, column * WIDTH_IN + _MARGIN_IN, bottom_in, WIDTH_IN - 2 * _MARGIN_IN, picture_in)
        banded = _draw_areas(axes, side.processed)
        note = side.note or false_positive_text(side.processed)
        axes.set_title(f"{shortened(side.label, _LONGEST_LABEL)}\n{note}".lstrip(), pad=2, fontsize=7)
    figure.legend(handles=_legend(banded), loc="lower center", ncols=3, frameon=False, fontsize=6.5, handlelength=1.6,
                  labelspacing=0.3, columnspacing=1.2, borderaxespad=0.1)  # fmt: skip
    return figure


def _draw_areas(axes: Axes, processed: ProcessedFrame) -> bool:
    """Draw the areas of a frame, and the name, TPR and IoU of each object; True if there are unknown bands."""
    reference, detected = processed.reference, detected_pixels(processed)
    classes = pixel_classes(reference, detected=detected)
    banded = bool((classes == PixelClass.UNKNOWN).any())
    canvas.show_image(axes, _tinted(processed.pixels, classes))
    _hatch_ignored(axes, classes)
    _, objects = count_frame(reference, detected, component_size_px=0)
    _name_objects(axes, reference, objects, outline=not banded)
    return banded


def _tinted(image: NDArray[np.uint8], classes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    grey = canvas.faded(image, _BACKGROUND_STRENGTH)
    darker = np.where(classes == PixelClass.OUTSIDE, _OUTSIDE_STRENGTH * grey, grey).astype(np.uint8)
    return overlay_areas(darker, areas_of(classes), strength=_TINT)


def _hatch_ignored(axes: Axes, classes: NDArray[np.uint8]) -> None:
    ignored = classes == PixelClass.IGNORED
    if ignored.any():
        filled = axes.contourf(ignored.astype(float), levels=[0.5, 1.5], colors=[(1, 1, 1, 0.35)], hatches=["//////"])
        filled.set_edgecolor("#404040")
        filled.set_linewidth(0.0)


def _name_objects(axes: Axes, reference: ReferenceFrame, counts: Sequence[ObjectCounts], *, outline: bool) -> None:
    """Label the evaluated objects; their outlines would hide unknown bands."""
    polygons, texts = [], []
    for target, count in zip(reference.objects, counts, strict=True):
        for _, polygon in outlined([target]):
            if outline:
                draw_outline(axes, polygon, colour="white", style="--", width=0.9)
            polygons.append(polygon)
            texts.append(_label(target.track_id, count))
    place_labels(axes, polygons, texts)


def _label(track_id: str, count: ObjectCounts) -> str:
    """Track, coverage and IoU of an evaluated object, whose region is never empty."""
    coverage = count.tp / (count.tp + count.fn)
    iou = count.tp / (count.tp + count.fp + count.fn)
    return f"{track_id}: TPR {100 * coverage:.0f} %, IoU {100 * iou:.0f} %"


def _legend(banded: bool) -> list[Patch | Line2D]:
    shown = [kind for kind in AREA_COLOURS if banded or kind is not PixelClass.UNKNOWN]
    polygon = Line2D([], [], color=canvas.GREY, linestyle="--", linewidth=1.2, label="reference polygon")
    return [
        *(Patch(color=AREA_COLOURS[kind], label=AREA_NAMES[kind]) for kind in shown),
        *([] if banded else [polygon]),
        Patch(facecolor="white", edgecolor="#404040", hatch="//////", linewidth=0.4, label="ignored"),
        Patch(color="#404040", label="not evaluated"),
    ]


def draw_images(
    runs: Sequence[StoredRun],
    images: Iterable[ImageKey],
    draw: Callable[[ImageKey, Sequence[ProcessedFrame], FramePipeline], Drawn],
    *,
    progress: Progress | None = None,
) -> tuple[dict[ImageKey, Drawn], list[str]]:
    """Draw images as runs were scored on them, from the data set that they name.

    Args:
        runs: of the same data set.
        images: in any order, also several times.
        draw: called with an image, the frame of every run, and the pipeline of the first.
        progress: called with the images done and their number.

    Returns:
        drawn: of the images that could be processed.
        problems: why others could not, one line each: a run holds no masks or did not score them, the data set is not
            there, or code or data have changed since.
    """
    keys, drawn, problems = sorted(set(images)), dict[ImageKey, Drawn](), dict[str, None]()  # a recording at a time
    try:
        stored = [StoredFrames(run) for run in runs if keys]
    except BenchError as error:
        return {}, [str(error)]
    for number, key in enumerate(keys, start=1):
        try:
            drawn[key] = draw(key, [one.process(*key) for one in stored], stored[0].pipeline(*key[:2]))
        except (BenchError, UnscorableFrame) as error:
            problems[str(error)] = None
        if progress is not None:
            progress(number, len(keys))
    return drawn, list(problems)
