"""Several methods on one image: the areas that each is scored by, beside each other under one legend."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from bench.errors import BenchError, UsageError
from bench.harness import ProcessedFrame
from bench.harness.frames import UnscorableFrame
from bench.harness.replay import StoredFrames
from bench.reporting import canvas
from bench.reporting.count_view import (
    MARGIN_IN,
    WIDTH_IN,
    detected_pixels,
    draw_areas,
    draw_legend,
    false_positive_text,
    legend_height_in,
    picture_height_in,
)
from bench.reporting.formats import frame_name, shortened
from bench.reporting.overlay import unknown_bands
from bench.reporting.stored_run import StoredRun

ImageKey = tuple[str, str, int]  # recording, camera, timestamp_ns
COLUMNS = 2
_TITLE_IN, _LINE_IN = 0.18, 0.13
_LONGEST_LABEL, _LONGEST_TITLE = 62, 120


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Side:
    """Result of one method on the image.

    Attributes:
        label: names the run or the method.
        processed: the image with the method's mask and the reference.
        note: a line of values; empty for the false positives of the image.
    """

    label: str
    processed: ProcessedFrame
    note: str = ""


@canvas.styled
def draw_side_by_side(sides: Sequence[Side], *, title: str = "") -> Figure:
    """Draw an image as several methods were scored on it, two in a row, with recording, camera and time above.

    Args:
        sides: at least one, of the same image.
        title: a line above all; empty for none.

    Raises:
        UsageError: sides of different images.
    """
    references = [side.processed.reference for side in sides]
    names = {(one.recording, one.camera, one.timestamp_ns) for one in references}
    if len(names) != 1:
        raise UsageError(f"side by side: expected one image, got {len(names)}: {sorted(names)}")
    has_bands = any(unknown_bands(one).any() for one in references)
    columns = min(COLUMNS, len(sides))
    lines = -(-len(sides) // columns)
    picture_in, legend_in = picture_height_in(references[0]), legend_height_in(bool(has_bands))
    head_in = 2 * _LINE_IN + MARGIN_IN
    full_in = (_TITLE_IN if title else _LINE_IN) + _LINE_IN + lines * (head_in + picture_in) + legend_in
    figure = canvas.new_figure(columns * WIDTH_IN, full_in)
    told = ([shortened(title, _LONGEST_TITLE)] if title else []) + [frame_name(references[0])]
    figure.text(0.5, 1 - 0.03 / full_in, "\n".join(told), ha="center", va="top", fontsize=8)
    for number, (side, reference) in enumerate(zip(sides, references, strict=True)):
        row, column = divmod(number, columns)
        bottom_in = legend_in + (lines - 1 - row) * (head_in + picture_in)
        axes = canvas.axes_at(figure, column * WIDTH_IN + MARGIN_IN, bottom_in, WIDTH_IN - 2 * MARGIN_IN, picture_in)
        detected = detected_pixels(side.processed)
        draw_areas(axes, side.processed.pixels, reference=reference, detected=detected)
        note = side.note or false_positive_text(reference, detected=detected)
        axes.set_title(f"{shortened(side.label, _LONGEST_LABEL)}\n{note}", pad=2, fontsize=7)
    draw_legend(figure, has_bands=bool(has_bands))
    return figure


def frames_of_runs(runs: Sequence[StoredRun], images: Iterable[ImageKey]) -> Iterator[tuple[ProcessedFrame, ...] | str]:
    """Images as several runs were scored on them, from their data set.

    Args:
        runs: of the same data set.
        images: recording, camera and timestamp_ns of each; those of a recording are best together.

    Returns:
        For each image that of every run, or the reason why there is none: a run did not score it, or code or data have
        changed since.

    Raises:
        DataError: a run holds no masks, or its data set is not there.
    """
    stored = [StoredFrames(run.folder, run.summary, run.protocol) for run in runs]
    return (_processed(stored, key) for key in images)


def _processed(stored: Sequence[StoredFrames], key: ImageKey) -> tuple[ProcessedFrame, ...] | str:
    try:
        return tuple(one.process(*key) for one in stored)
    except (BenchError, UnscorableFrame) as error:
        return str(error)
