"""What validation finds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from bench.errors import DataError
from bench.recordings import Recording


class Severity(StrEnum):
    """How sure it is that something is wrong."""

    ERROR = "error"  # wrong: a file that cannot be used, or a value that cannot be
    WARNING = "warning"  # odd: true in some recordings, and worth a look


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One fault, told once however often it occurs.

    Attributes:
        check: name of the check, for example "clock-drift".
        severity: how sure it is.
        recording: name; empty for the data set as a whole.
        file: the file, or the folder where none can be named.
        field: the field, camera or object in it; None for the whole file.
        expected: what is due.
        got: what was found.
        do: what the user can do about it.
        times: how often it was found.
        timestamp_ns: of the first time; None where no time belongs to it.
    """

    check: str
    severity: Severity = Severity.ERROR
    recording: str = ""
    file: str
    field: str | None = None
    expected: str
    got: str
    do: str = ""
    times: int = 1
    timestamp_ns: int | None = None


def unusable(error: DataError, *, check: str = "file", timestamp_ns: int | None = None) -> Finding:
    """A file that cannot be read, as its reader tells."""
    return Finding(
        check=check,
        file=error.file,
        field=error.field,
        expected=error.expected,
        got=error.got,
        do=error.do,
        timestamp_ns=timestamp_ns,
    )


def calibration_file(recording: Recording) -> str:
    """Where the calibration stands, as far as the recording tells."""
    return _known(recording.root / "recording.json", recording)


def annotation_file(recording: Recording) -> str:
    """Where the annotations stand, as far as the recording tells."""
    return _known(recording.root / "annotations.json", recording)


def _known(file: Path, recording: Recording) -> str:
    return str(file if file.is_file() else recording.root)


def listed(names: Sequence[str], most: int = 5) -> str:
    """The first few of many names."""
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")
