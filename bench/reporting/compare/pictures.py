"""Both methods on one frame, side by side: the frames of two runs that changed most."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.errors import BenchError
from bench.harness import ProcessedFrame
from bench.harness.frames import UnscorableFrame
from bench.harness.replay import StoredFrames
from bench.reporting.canvas import figure_pixels, jpeg_bytes, new_figure, styled
from bench.reporting.compare.changes import ChangedFrame, DrawnFrame, Kind, RunComparison
from bench.reporting.count_view import detected_pixels, draw_counts
from bench.reporting.formats import shortened
from bench.reporting.overlay import overlay_frame

PICTURED = 2  # of each kind
QUALITY = 90  # of JPEG; as PNG a picture takes 2 MB
_TITLE_IN, _HEAD_IN, _SIDE_IN = 0.34, 0.22, 3.5
Picture = NDArray[np.uint8]


def draw_changed_frames(
    comparison: RunComparison,
    *,
    number: int,
    progress: Callable[[float, int], None] | None = None,
) -> RunComparison:
    """Draw the frames that changed most as both methods were scored on them.

    Args:
        comparison: of two runs.
        number: of the comparison, for the names of the files.
        progress: called with the pictures done and their number.

    Returns:
        The comparison with the pictures, and with a line for every reason why one could not be made.
    """
    chosen = [frame for kind in Kind for frame in [f for f in comparison.frames if f.kind is kind][:PICTURED]]
    try:
        runs = (comparison.before, comparison.after) if chosen else ()
        stored = [StoredFrames(run.folder, run.summary, run.protocol) for run in runs]
    except BenchError as error:
        return replace(comparison, remarks=(f"no pictures: {error}",))
    drawn, remarks = [], []
    for ordinal, frame in enumerate(chosen, start=1):
        name = f"{number:02d}-{ordinal:02d}-{frame.kind.value.replace(' ', '-')}.jpg"
        try:
            sides = [one.process(frame.recording, frame.camera, frame.timestamp_ns) for one in stored]
        except (BenchError, UnscorableFrame) as error:
            remarks.append(f"no picture {name}: {error}")
            continue
        title = frame_title(frame)
        drawn.append(DrawnFrame(title=title, name=name, jpeg=_compose(title, frame, sides, comparison)))
        if progress is not None:
            progress(ordinal, len(chosen))
    return replace(comparison, drawn=tuple(drawn), remarks=tuple(remarks))


def frame_title(frame: ChangedFrame) -> str:
    """For example "newly missed: pedestrian 'a', crossing, 5.0 m (drive-1, front, 1200 ms)"."""
    what = f": {frame.what}" if frame.what else ""
    return f"{frame.kind.value}{what} ({frame.recording}, {frame.camera}, {frame.timestamp_ns / 1e6:.0f} ms)"


@styled
def _compose(title: str, frame: ChangedFrame, sides: Sequence[ProcessedFrame], comparison: RunComparison) -> bytes:
    """Title; then for each run its name and values, what it detects, and what that counts as."""
    columns = []
    runs, methods = (comparison.before, comparison.after), comparison.methods
    values, ious = (frame.before, frame.after), (frame.iou_before, frame.iou_after)
    for side, run, method, value, iou in zip(sides, runs, methods, values, ious, strict=True):
        shares = f"false positives {100 * value:.1f} %"
        if iou is not None:
            shares = f"coverage {100 * value:.1f} %, IoU {100 * iou:.1f} %"
        detected = detected_pixels(side)
        areas = figure_pixels(draw_counts(side.pixels, reference=side.reference, detected=detected))
        overlay = overlay_frame(side.pixels, reference=side.reference, detected=detected)
        height = round(overlay.shape[0] * areas.shape[1] / overlay.shape[1])
        overlay = np.asarray(cv2.resize(overlay, (areas.shape[1], height), interpolation=cv2.INTER_AREA), np.uint8)
        name = run.label if method == run.label else f"{run.label}: {method}"
        head = _text([shortened(name, 78), shares], width_in=_SIDE_IN, height_in=_HEAD_IN + 0.08, size=6.5)
        columns.append(np.vstack([head, overlay, areas]))
    gap = np.full((columns[0].shape[0], 8, 3), 255, np.uint8)
    body = np.hstack([columns[0], gap, columns[1]])
    strip = _text([shortened(title, 120)], width_in=2 * _SIDE_IN, height_in=_TITLE_IN, size=8.0, bold=True)
    strip = np.pad(strip, ((0, 0), (0, body.shape[1] - strip.shape[1]), (0, 0)), constant_values=255)
    return jpeg_bytes(np.vstack([strip, body]), quality=QUALITY)


def _text(lines: Sequence[str], *, width_in: float, height_in: float, size: float, bold: bool = False) -> Picture:
    figure = new_figure(width_in, height_in)
    weight = "bold" if bold else "normal"
    figure.text(0.02, 0.5, "\n".join(lines), ha="left", va="center", fontsize=size, fontweight=weight)
    return figure_pixels(figure)
