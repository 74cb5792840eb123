"""Handlers of errors on opening a recording: raise, or collect and go on with the rest (lenient reading).

An adapter has one opener. It reports every error to its error handler and goes on without what could not be read; with
the handler `STRICT`, the first error ends it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, NoReturn

import numpy as np
from scipy.spatial.transform import Rotation

from bench.egomotion import Trajectory
from bench.errors import DataError

Part = Literal["trajectory", "annotations"]
OnError = Callable[[DataError], None]
FindAll = Callable[[DataError], Iterable[DataError]]

STAND_IN_NS = 2**61  # the stand-in for a missing trajectory reaches this far to both sides of 0


class NothingUsableError(Exception):
    """Lenient reading ends without a recording; the reasons are reported already."""


def only_this(error: DataError) -> Iterable[DataError]:
    """No search for further errors."""
    return (error,)


class ErrorHandler:
    """The strict one: the first error is raised."""

    def __call__(self, error: DataError, find_all: FindAll = only_this) -> None:  # noqa: ARG002
        """Take an error.

        Args:
            error: the first of a file.
            find_all: finds every error of the file; where it finds none, `error` counts. Strict reading never calls it.
        """
        raise error

    def leave_out(self, part: Part) -> None:
        """Note that a part of the recording only has a stand-in: a stationary trajectory, no tracks."""

    def stop(self) -> NoReturn:
        """End lenient reading where the errors leave nothing usable."""
        raise NothingUsableError


STRICT = ErrorHandler()


class ErrorCollector(ErrorHandler):
    """The lenient one: errors are collected, and reading goes on.

    Attributes:
        errors: one for each fault.
        missing: parts of the recording that only have a stand-in.
    """

    def __init__(self) -> None:
        self.errors: list[DataError] = []
        self.missing: set[Part] = set()

    def __call__(self, error: DataError, find_all: FindAll = only_this) -> None:
        """Collect all errors of the file."""
        self.errors.extend(tuple(find_all(error)) or (error,))

    def leave_out(self, part: Part) -> None:
        """Note the part."""
        self.missing.add(part)


@contextmanager
def reporting(on_error: OnError) -> Iterator[None]:
    """Report an error of the block, which ends there."""
    try:
        yield
    except DataError as error:
        on_error(error)


@contextmanager
def reporting_all(on_error: ErrorHandler, find_all: FindAll) -> Iterator[None]:
    """Report an error of the block, which ends there; `find_all` as for `ErrorHandler`."""
    try:
        yield
    except DataError as error:
        on_error(error, find_all)


def at_most(count: int, on_error: OnError) -> OnError:
    """Report no more than `count` errors."""
    left = iter(range(count))

    def report(error: DataError) -> None:
        if next(left, None) is not None:
            on_error(error)

    return report


def stationary(source: Path) -> Trajectory:
    """Stands in for a missing trajectory, at all times."""
    return Trajectory(
        source=str(source),
        timestamps_ns=np.array([-STAND_IN_NS, STAND_IN_NS], dtype=np.int64),
        rotations=Rotation.identity(2),
        positions_m=np.zeros((2, 3)),
        max_gap_ns=2 * STAND_IN_NS,
    )
