"""What goes wrong through the user's input, each with one clear line.

A `BenchError` is a mistake in the data, the configuration or the call. The command line prints it without a
traceback and exits with status 2. Anything else is a bug of ours and keeps its traceback.
"""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


LONGEST_CAME = 1000  # characters of what was found instead


class BenchError(Exception):
    """A mistake that the user can mend; `str()` is one line that says how."""


class UsageError(BenchError):
    """A call or option that cannot be carried out."""


class ShapeError(BenchError, ValueError):
    """An array of another shape, or a number out of its domain."""


class DataError(BenchError):
    """A file that is not what the format asks for.

    Args:
        file: the file, or the folder where a file is missing.
        field: the field, column or array inside the file; None for the file as a whole.
        wanted: what the format asks for.
        came: what was found instead.
        do: what the user can do about it.
    """

    def __init__(self, file: Path | str, *, field: str | None = None, wanted: str, came: str, do: str = "") -> None:
        came = came if len(came) <= LONGEST_CAME else came[: LONGEST_CAME - 3] + "..."
        self.file, self.field, self.wanted, self.came, self.do = str(file), field, wanted, came, do
        where = self.file if field is None else f"{self.file}: {field}"
        line = f"{where}: wanted {wanted}, came {came}" + (f"; {do}" if do else "")
        super().__init__("".join(c if c.isprintable() else "?" for c in line))  # names in files may hold anything

    def __reduce__(self) -> tuple[object, ...]:
        """Survive the way back from a worker process, keyword arguments included."""
        return _data_error, (self.file, self.field, self.wanted, self.came, self.do)


class UnknownNameError(UsageError):
    """A name that a registry does not know; the message lists the known ones and the nearest.

    Args:
        kind: what was looked up, for example "method".
        name: the name that came.
        known: the names that exist.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        self.kind, self.name, self.known = kind, name, sorted(known)
        nearest = get_close_matches(name, self.known, n=1, cutoff=0.5)
        hint = f"; did you mean {nearest[0]!r}?" if nearest else ""
        super().__init__(f"unknown {kind} {name!r}: known are {', '.join(self.known) or 'none'}{hint}")

    def __reduce__(self) -> tuple[object, ...]:
        return UnknownNameError, (self.kind, self.name, self.known)


def _data_error(file: str, field: str | None, wanted: str, came: str, do: str) -> DataError:
    return DataError(file, field=field, wanted=wanted, came=came, do=do)
