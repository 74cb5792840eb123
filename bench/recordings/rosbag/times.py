"""The clock of a topic: which of its messages have a time that can be used."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError
from bench.recordings.validation import LATEST_NS

Clock = Literal["header", "bag"]
JUMP_NS = 10_000_000_000  # a stamp whose distance to the time of recording differs more from the others' is of no clock


def usable_times(
    log_ns: NDArray[np.int64],
    stamp_ns: NDArray[np.int64],
    *,
    clock: Clock,
    what: str,
    file: Path,
    losses: list[DataError],
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The times of messages, and which of them increase.

    Args:
        log_ns: (N,) int64, when they were recorded, increasing.
        stamp_ns: (N,) int64, the times in their headers; not above 0 where there is none.
        clock: which of the two counts.
        what: the topic, for messages.
        file: for messages.
        losses: takes a fault for each kind of message that is left out.

    Returns:
        times_ns: (N,) int64.
        valid: (N,) bool; False without a time, for one that jumps, and for one not after all valid ones before it.
    """
    times_ns = log_ns if clock == "bag" else stamp_ns
    stamped = (times_ns > 0) & (times_ns < LATEST_NS)
    if not stamped.all():
        got = f"none in {int((~stamped).sum())} of {len(times_ns)} messages"
        do = "set the card's option clock: bag where the driver sets no stamps"
        losses.append(DataError(file, field=what, expected="a time in the header", got=got, do=do))
    valid = stamped.copy()
    if clock == "header" and stamped.any():
        away_ns = times_ns - log_ns
        jumps = stamped & (np.abs(away_ns - int(np.median(away_ns[stamped]))) > JUMP_NS)
        if jumps.any():
            first = int(times_ns[np.argmax(jumps)])
            got = f"{int(jumps.sum())} of {len(times_ns)} stamps that jump, the first {first}"
            losses.append(DataError(file, field=what, expected="stamps of one clock", got=got))
        valid &= ~jumps
    before = np.concatenate([[0], np.maximum.accumulate(np.where(valid, times_ns, 0))[:-1]])[: len(times_ns)]
    back = valid & (times_ns <= before)
    if back.any():
        first = int(np.argmax(back))
        got = f"{int(back.sum())} that do not, the first {times_ns[first]} after {before[first]}"
        losses.append(DataError(file, field=what, expected="times that increase", got=got))
    return times_ns, valid & ~back
