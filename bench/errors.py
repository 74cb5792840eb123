"""Errors through the user's input, each with one clear line.

A `BenchError` is a mistake in the data, the configuration or the call. The command line prints it without a
traceback and exits with status 2. Anything else is a bug of ours and keeps its traceback.
"""

from __future__ import annotations

import errno
import os
from difflib import get_close_matches
from itertools import islice
from typing import TYPE_CHECKING, Any

from bench.plain_text import plain

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


MAX_GOT_CHARS = 1000  # characters of what was found instead
MOST_FAULTS = 200  # of one file that are listed one by one
DISK_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class BenchError(Exception):
    """A mistake that the user can fix; `str()` is one line that says how."""

    def __reduce__(self) -> tuple[object, ...]:
        """Survive the way back from a worker process, whatever arguments it was made of."""
        return _restored, (type(self), str(self), self.__dict__)


def _restored(kind: type[BenchError], message: str, attributes: dict[str, Any]) -> BenchError:
    error = kind.__new__(kind, message)
    error.__dict__.update(attributes)
    return error


class UsageError(BenchError):
    """A call or option that cannot be carried out."""


class ShapeError(BenchError, ValueError):
    """An array of another shape, or a number out of its domain."""


class DataError(BenchError):
    """A file that is not what the format asks for.

    Args:
        file: the file, or the folder where a file is missing.
        field: the field, column or array inside the file; None for the file as a whole.
        expected: what the format asks for.
        got: what was found instead.
        hint: what the user can do about it.
    """

    def __init__(self, file: Path | str, *, field: str | None = None, expected: str, got: str, hint: str = "") -> None:
        got = got if len(got) <= MAX_GOT_CHARS else got[: MAX_GOT_CHARS - 3] + "..."
        self.file, self.field, self.expected, self.got, self.hint = str(file), field, expected, got, hint
        self.others: tuple[DataError, ...] = ()  # of the same file, which `validate` lists too
        where = self.file if field is None else f"{self.file}: {field}"
        super().__init__(plain(f"{where}: expected {expected}, got {got}" + (f"; {hint}" if hint else "")))


def refuse(errors: Iterable[DataError]) -> None:
    """Raise the first of a file's errors, if there is one; it carries the others, at most 200 in all."""
    faults = tuple(islice(errors, MOST_FAULTS))
    if faults:
        faults[0].others = faults[1:]
        raise faults[0]


class OutputError(BenchError):
    """A file or folder that cannot be written.

    Args:
        file: the file or folder.
        got: the reason.
        hint: what the user can do about it.
    """

    def __init__(self, file: Path | str, *, got: str, hint: str = "") -> None:
        self.file, self.got, self.hint = str(file), got, hint
        line = f"{self.file}: expected a writable path, got {got}" + (f"; {hint}" if hint else "")
        super().__init__(plain(line))

    @classmethod
    def of(cls, error: OSError, file: Path | str) -> OutputError:
        """From what the system says when `file`, or a folder for it, is written."""
        above = error.filename is not None and str(file).startswith(f"{error.filename}{os.sep}")
        culprit = f" ({error.filename})" if above else ""
        hint = "free some disk space, then run the same command again" if error.errno in DISK_FULL else ""
        return cls(file, got=f"{error.strerror or error}{culprit}", hint=hint)


class UnknownNameError(UsageError):
    """A name that a registry does not know; the message lists the known ones and the nearest.

    Args:
        kind: what was looked up, for example "method".
        name: the unknown name.
        known: the names that exist.
        hint: where they were looked up, or what else the user can do.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str], *, hint: str = "") -> None:
        self.kind, self.name, self.known, self.hint = kind, name, sorted(known), hint
        nearest = get_close_matches(name, self.known, n=1, cutoff=0.5)
        advice = f"; {hint}" if hint else ""
        near = f"; did you mean {nearest[0]!r}?" if nearest else ""
        super().__init__(f"unknown {kind} {name!r}: known are {', '.join(self.known) or 'none'}{advice}{near}")
