"""Which images of a camera are looked at."""

from __future__ import annotations

import re

import numpy as np

from bench.errors import UsageError
from bench.recordings import ImageRef


def chosen_frames(
    images: tuple[ImageRef, ...],
    *,
    history: int,
    frame: int | None,
    frames: str | None,
    time_ns: int | None,
    all_without: bool,
) -> range:
    """Indices of images, from whichever of the three options is given.

    Args:
        images: of the camera.
        history: images before the first that can be chosen.
        frame: one index.
        frames: "FIRST:LAST" or "FIRST:LAST:STEP", the last one included; either end may be left out.
        time_ns: the image nearest to this time.
        all_without: without an option all images, else the middle one.

    Raises:
        UsageError: two options, an index that does not exist, or a time outside of the images.
    """
    given = [
        name for name, value in (("--frame", frame), ("--frames", frames), ("--time-ns", time_ns)) if value is not None
    ]
    if len(given) > 1:
        raise UsageError(f"expected one of --frame, --frames and --time-ns, got {' and '.join(given)}")
    last = len(images) - 1
    if history > last:
        raise UsageError(f"expected more than {history} images of the camera, got {len(images)}")
    if frames is not None:
        return _span(frames, history, last)
    if time_ns is not None:
        return _at(images, time_ns, history)
    if frame is None and all_without:
        return range(history, last + 1)
    index = max(len(images) // 2, history) if frame is None else frame
    if not history <= index <= last:
        raise UsageError(f"--frame: expected {history} to {last}, got {index}")
    return range(index, index + 1)


def _span(frames: str, history: int, last: int) -> range:
    match = re.fullmatch(r"(\d{0,9}):(\d{0,9})(?::(\d{1,9}))?", frames)
    if match is None:
        raise UsageError(f"--frames: expected FIRST:LAST or FIRST:LAST:STEP, got {frames!r}")
    first = int(match[1]) if match[1] else history
    end = int(match[2]) if match[2] else last
    step = int(match[3]) if match[3] else 1
    if not (history <= first <= end <= last and step > 0):
        raise UsageError(f"--frames: expected indices from {history} to {last}, rising, got {frames!r}")
    return range(first, end + 1, step)


def _at(images: tuple[ImageRef, ...], time_ns: int, history: int) -> range:
    times_ns = [image.timestamp_ns for image in images]
    index = int(np.argmin([abs(time - time_ns) for time in times_ns]))
    first, last = times_ns[history], times_ns[-1]
    step_ns = int(np.median(np.diff(times_ns)))
    if index < history or abs(times_ns[index] - time_ns) > step_ns:
        raise UsageError(f"--time-ns: expected a time from {first} to {last}, got {time_ns}")
    return range(index, index + 1)
