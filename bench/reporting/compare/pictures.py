"""Both methods on one frame, side by side: the frames of two runs that changed most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bench.harness import FramePipeline, ProcessedFrame
from bench.reporting.canvas import figure_pixels, jpeg_bytes
from bench.reporting.compare.changes import ChangedFrame, DrawnFrame, Kind, RunComparison
from bench.reporting.side_by_side import ImageKey, Progress, Side, draw_images, draw_side_by_side

PICTURED = 2  # of each kind
QUALITY = 90  # of JPEG; as PNG a picture takes 2 MB


def draw_changed_frames(
    comparison: RunComparison,
    *,
    number: int,
    progress: Progress | None = None,
) -> RunComparison:
    """Draw the frames that changed most as both methods were scored on them.

    Args:
        comparison: of two runs.
        number: of the comparison, for the names of the files.
        progress: called with the pictures done and their number.

    Returns:
        The comparison with the pictures, and with a line for every reason why one could not be made.
    """
    chosen: dict[ImageKey, dict[str, ChangedFrame]] = {}  # by image and name
    largest = [frame for kind in Kind for frame in [f for f in comparison.frames if f.kind is kind][:PICTURED]]
    for ordinal, frame in enumerate(largest, start=1):
        name = f"{number:02d}-{ordinal:02d}-{frame.kind.value.replace(' ', '-')}.jpg"
        chosen.setdefault((frame.recording, frame.camera, frame.timestamp_ns), {})[name] = frame

    def draw(key: ImageKey, both: Sequence[ProcessedFrame], _: FramePipeline) -> list[DrawnFrame]:
        return [_drawn(name, frame, _sides(frame, both, comparison)) for name, frame in chosen[key].items()]

    found, problems = draw_images((comparison.before, comparison.after), chosen, draw, progress=progress)
    drawn = sorted((picture for pictures in found.values() for picture in pictures), key=lambda picture: picture.name)
    return replace(comparison, drawn=tuple(drawn), remarks=tuple(f"no picture: {problem}" for problem in problems))


def _drawn(name: str, frame: ChangedFrame, sides: Sequence[Side]) -> DrawnFrame:
    jpeg = jpeg_bytes(figure_pixels(draw_side_by_side(sides, title=_headline(frame))), quality=QUALITY)
    return DrawnFrame(title=frame_title(frame), name=name, jpeg=jpeg)


def frame_title(frame: ChangedFrame) -> str:
    """For example "newly missed: pedestrian 'a', crossing, 5.0 m (drive-1, front, 1200 ms)"."""
    return f"{_headline(frame)} ({frame.recording}, {frame.camera}, {frame.timestamp_ns / 1e6:.0f} ms)"


def _headline(frame: ChangedFrame) -> str:
    return f"{frame.kind.value}: {frame.what}" if frame.what else frame.kind.value


def _sides(frame: ChangedFrame, both: Sequence[ProcessedFrame], comparison: RunComparison) -> list[Side]:
    """Each run with its name, and with the coverage of the object where it is one that changed."""
    sides = []
    runs, values = (comparison.before, comparison.after), (frame.before, frame.after)
    ious = frame.iou_before, frame.iou_after
    for processed, run, method, value, iou in zip(both, runs, comparison.methods, values, ious, strict=True):
        label = run.label if method == run.label else f"{run.label}: {method}"
        note = "" if iou is None else f"coverage {100 * value:.1f} %, IoU {100 * iou:.1f} %"
        sides.append(Side(label=label, processed=processed, note=note))
    return sides
