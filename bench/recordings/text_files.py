"""Text files of data sets, never read without a limit: small ones whole, large ones part by part."""

from __future__ import annotations

from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError

LARGEST_BYTES = 100_000_000  # a million rows of poses
LARGEST_NUMBER = 1e12  # nothing that is measured comes near, and squares of it stay finite
READ_BYTES = 65_536


def read_text(file: Path, *, largest_bytes: int = LARGEST_BYTES) -> str:
    """Read a text file.

    Args:
        file: UTF-8 text.
        largest_bytes: a larger file is refused before it is read.

    Raises:
        DataError: missing, too large, empty, or not UTF-8.
    """
    try:
        size = file.stat().st_size
        if size > largest_bytes:
            raise DataError(file, expected=f"at most {largest_bytes} bytes", got=str(size))
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise DataError(file, expected="a readable text file", got=error.strerror or str(error)) from error
    except UnicodeDecodeError as error:
        raise DataError(
            file, expected="UTF-8 text", got=f"byte {error.object[error.start]:#04x} at {error.start}"
        ) from None
    if not text.strip():
        raise DataError(file, expected="text", got="an empty file")
    return text


def number_rows(file: Path, columns: int) -> NDArray[np.float64]:
    """Read rows of numbers, separated by blanks.

    Args:
        file: text; blank lines are passed over.
        columns: numbers in each row.

    Returns:
        (N, columns) float64, N >= 1, finite.

    Raises:
        DataError: a row of another length, or something that is not a finite number.
    """
    rows: list[list[float]] = []
    for number, line in enumerate(read_text(file).splitlines(), start=1):
        words = line.split()
        if words:
            rows.append(numbers(words, columns, file=file, field=f"line {number}"))
    return np.array(rows, dtype=np.float64)


def numbers(words: list[str], count: int, *, file: Path, field: str) -> list[float]:
    """Turn words into finite numbers, at most `LARGEST_NUMBER`.

    Args:
        words: as they stand in the file.
        count: how many there must be.
        file: where they come from.
        field: where in the file.

    Raises:
        DataError: more or fewer, or something that is not a finite number.
    """
    if len(words) != count:
        raise DataError(file, field=field, expected=f"{count} numbers", got=str(len(words)))
    values = []
    for word in words:
        try:
            value = float(word)
        except ValueError:
            value = float("nan")
        if not abs(value) <= LARGEST_NUMBER:
            expected = f"numbers up to {LARGEST_NUMBER:g}" if np.isfinite(value) else "finite numbers"
            raise DataError(file, field=field, expected=expected, got=repr(word[:40]))
        values.append(value)
    return values


class MeteredFile:
    """Hands out a file and stops where one part of it goes on for too long.

    Args:
        raw: the open file.
        file: its path, for messages.
        part: what a part is, in the plural, for messages.
        largest_bytes: of a part.
    """

    def __init__(self, raw: IO[bytes], file: Path, *, part: str, largest_bytes: int) -> None:
        self._raw, self._file, self._part, self._largest, self._since = raw, file, part, largest_bytes, 0

    def read(self, size: int = READ_BYTES) -> bytes:
        """The next bytes, at most `READ_BYTES`.

        Raises:
            DataError: the part is longer than it may be.
        """
        content = self._raw.read(min(size, READ_BYTES) if size > 0 else READ_BYTES)
        self._since += len(content)
        if self._since > self._largest:
            expected = f"{self._part} of at most {self._largest} bytes"
            raise DataError(self._file, expected=expected, got="a longer one")
        return content

    def restart(self) -> None:
        """A new part begins."""
        self._since = 0
