"""Large files that are read part by part, with a limit on how much one part may hold."""

from __future__ import annotations

from pathlib import Path
from typing import IO

from bench.errors import DataError

READ_BYTES = 65_536


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
