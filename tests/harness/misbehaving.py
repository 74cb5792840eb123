"""Methods that break the contract, each in its own way."""

import inspect
import os
import sys
from contextlib import suppress
from dataclasses import replace

import numpy as np

from bench.methods import Method, Segmentation, build_method


class Misbehaving(Method):
    """Answers each image as the function of its fault does; the cells of a calm answer are 4 px wide."""

    def __init__(self, *, fault: str) -> None:
        self.fault, self.name = fault, f"misbehaving-{fault}"

    def segment(self, frame):
        return FAULTS[self.fault](frame)


def calm(frame):
    height, width = frame.valid.shape
    cells = np.zeros((-(-height // 4), -(-width // 4)), dtype=bool)
    cells[10:20, 10:30] = True
    return Segmentation(cell_size_px=4, mask=cells)


def altered(**fields):
    return lambda frame: replace(calm(frame), **fields)


def helper(frame):
    raise ValueError(f"boom at\n{frame.timestamps_ns[-1]}")


def not_finite(frame):
    found = calm(frame)
    likelihood = found.mask.astype(np.float32)
    likelihood[3, 4] = np.nan
    return replace(found, likelihood=likelihood)


def cause_out_of_range(frame):
    found = calm(frame)
    return replace(found, causes=("a", "b"), cause=np.full(found.mask.shape, 2, np.uint8))


def change_valid(frame):
    mask = frame.valid
    mask &= False
    return calm(frame)


def change_image(frame):
    frame.images[-1][:] = 0
    return calm(frame)


def force_valid(frame):
    """Not by accident: what it is given is made writeable first."""
    frame.valid.flags.writeable = True
    frame.valid[:] = False
    for image in frame.images:
        image.flags.writeable = True
        image[:] = 0
    frame.road.down.flags.writeable = True
    frame.road.down[:] = 0
    return calm(frame)


returned = []


def change_later(frame):
    """Answers that were returned are other ones afterwards."""
    for found in returned:
        found.mask[:] = True
    returned.append(calm(frame))
    return returned[-1]


def go_away(frame):
    os.chdir("/")
    return calm(frame)


def lower_limits(frame):
    """Too few calls for anything that follows, and every rounding an error."""
    limit = len(inspect.stack(0))
    while sys.getrecursionlimit() != limit:  # calls of C count as well, how many nobody tells
        limit += 5
        with suppress(RecursionError):
            sys.setrecursionlimit(limit)
    sys.setrecursionlimit(limit + 10)
    np.seterr(all="raise")
    return calm(frame)


seen = []


def remember(frame):
    """Each answer depends on how many images the process was asked for before."""
    seen.append(frame.timestamps_ns[-1])
    found = calm(frame)
    found.mask[0, : len(seen) % found.mask.shape[1]] = True
    return found


FAULTS = {
    "none": calm,
    "returns_none": lambda _: None,
    "returns_array": lambda frame: calm(frame).mask,
    "float_mask": lambda frame: replace(calm(frame), mask=calm(frame).mask.astype(np.float32)),
    "wrong_shape": lambda frame: replace(calm(frame), cell_size_px=2),
    "cell_size_zero": altered(cell_size_px=0),
    "cell_size_huge": lambda _: Segmentation(cell_size_px=10**30, mask=np.ones((1, 1), dtype=bool)),
    "not_finite": not_finite,
    "negative": lambda frame: replace(calm(frame), likelihood=-calm(frame).mask.astype(np.float32)),
    "score_above_one": lambda frame: replace(
        calm(frame), likelihood=2 * calm(frame).mask.astype(np.float32), likelihood_is_score=True
    ),
    "threshold_of_something_else": lambda frame: replace(
        calm(frame), likelihood=calm(frame).mask.astype(np.float32), likelihood_is_score=True, threshold=1.5
    ),
    "cause_out_of_range": cause_out_of_range,
    "raises": helper,
    "exits": lambda _: sys.exit(0),
    "change_valid": change_valid,
    "change_image": change_image,
    "force_valid": force_valid,
    "change_later": change_later,
    "go_away": go_away,
    "lower_limits": lower_limits,
    "remember": remember,
    "bench_error": lambda _: build_method("spherical", {"threshold": -1.0}),
}
