"""Everything that is wrong with KITTI-360's text files of times and poses, line by line."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from bench.errors import DataError
from bench.recordings.kitti360.files import LARGEST_FRAME, FrameClock, read_pose, stamp_ns
from bench.recordings.text_files import numbers, read_text
from bench.recordings.validation import MOST_FAULTS


def clock_faults(file: Path) -> tuple[DataError, ...]:
    """Lines of `timestamps.txt` that `read_clock` would refuse, at most 200."""
    return _most(_clock_faults(file))


def pose_faults(file: Path, clock: FrameClock | None) -> tuple[DataError, ...]:
    """Rows of `poses.txt` that `read_drive` would refuse, at most 200; without a clock frames may have any time."""
    return _most(_pose_faults(file, clock))


def _most(faults: Iterator[DataError]) -> tuple[DataError, ...]:
    return tuple(islice(faults, MOST_FAULTS))


def _lines(file: Path) -> tuple[list[str], tuple[DataError, ...]]:
    try:
        return read_text(file).rstrip().splitlines(), ()
    except DataError as error:
        return [], (error,)


def _clock_faults(file: Path) -> Iterator[DataError]:
    lines, faults = _lines(file)
    yield from faults
    before_ns: int | None = None
    for row, line in enumerate(lines, start=1):
        try:
            time_ns = stamp_ns(line, row, file)
        except DataError as error:
            yield error
            continue
        if before_ns is not None and time_ns <= before_ns:
            yield DataError(file, field=f"line {row}", expected="times that increase", got=line.strip()[:40])
        before_ns = time_ns


def _pose_faults(file: Path, clock: FrameClock | None) -> Iterator[DataError]:
    lines, faults = _lines(file)
    yield from faults
    before = -1.0
    for row, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            frame, *matrix = numbers(line.split(), 13, file=file, field=f"line {row}")
            if frame != round(frame) or not 0 <= frame <= LARGEST_FRAME:
                raise DataError(file, field=f"line {row}", expected="a whole frame number", got=f"{frame:g}")
            read_pose(np.array(matrix).reshape(3, 4), file, row)
            if clock is not None:
                clock.at(int(frame), file=file)
        except DataError as error:
            yield error
            continue
        if frame <= before:
            got = f"{frame:.0f} after {before:.0f}"
            yield DataError(file, field=f"line {row}", expected="frames that increase", got=got)
        before = frame
