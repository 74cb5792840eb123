"""What can be wrong with a folder of predictions."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from bench.errors import DataError


class FaultKind(StrEnum):
    """Kinds of faults, in the order in which they are told."""

    MISSING = "missing"
    UNREADABLE = "unreadable"
    WRONG_SIZE = "wrong size"
    UNCLEAR = "unclear"
    TWICE = "twice"
    EXTRA = "extra"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One thing that is wrong.

    Attributes:
        kind: of fault.
        place: the file relative to the folder of predictions, or the image that has none.
        reason: what was expected and what was found.
    """

    kind: FaultKind
    place: str
    reason: str


class WrongSizeError(DataError):
    """A prediction of a size that neither divides nor multiplies the image's."""


class UnclearError(DataError):
    """A prediction whose values do not say what moves."""


def kind_of(error: DataError) -> FaultKind:
    """The kind of fault that an error of a reader is."""
    kinds = {WrongSizeError: FaultKind.WRONG_SIZE, UnclearError: FaultKind.UNCLEAR}
    return kinds.get(type(error), FaultKind.UNREADABLE)


def reason_of(error: DataError) -> str:
    """What an error says, without the file."""
    where = f"{error.field}: " if error.field else ""
    return f"{where}expected {error.expected}, got {error.got}" + (f"; {error.do}" if error.do else "")
