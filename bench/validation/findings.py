"""Findings of the checks. What each expects, and what a user can do about it, stands in findings.yaml."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import TypedDict

import numpy as np
import yaml
from numpy.typing import NDArray

from bench.errors import DataError


class Severity(StrEnum):
    """Certainty that something is wrong."""

    ERROR = "error"  # wrong: a file that cannot be used, or a value that cannot be
    WARNING = "warning"  # unusual: correct in some recordings, worth checking


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One fault, reported once however often it occurs.

    Attributes:
        check: name of the check, for example "clock-drift".
        severity: how sure it is.
        recording: name; empty for the data set as a whole.
        file: the file, or the folder where none can be named; empty for the one that `report.CHECKS` names.
        field: the field, camera or object in it; None for the whole file.
        expected: the correct state.
        got: what was found.
        hint: what the user can do about it.
        times: how often it was found.
        timestamp_ns: of the first time; None where no time belongs to it.
    """

    check: str
    severity: Severity = Severity.ERROR
    recording: str = ""
    file: str = ""
    field: str | None = None
    expected: str
    got: str
    hint: str = ""
    times: int = 1
    timestamp_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Undecided:
    """A quantity that a recording cannot tell.

    Attributes:
        about: the quantity.
        why: what is missing.
    """

    about: str
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """A mistake from which others may follow.

    Attributes:
        name: of it.
        known_by: checks whose errors tell it.
        following: checks whose findings may follow from it.
    """

    name: str
    known_by: tuple[str, ...]
    following: tuple[str, ...]


@cache
def _texts() -> tuple[dict[str, dict[str, str]], tuple[Cause, ...]]:
    texts, causes = yaml.safe_load_all(Path(__file__).with_name("findings.yaml").read_text("utf-8"))
    return texts, tuple(Cause(**cause) for cause in causes)


def causes() -> tuple[Cause, ...]:
    """What other findings may follow from."""
    return _texts()[1]


def new_finding(
    kind: str,
    got: str,
    *,
    file: object = "",
    field: str | None = None,
    severity: Severity | None = None,
    hint: str | None = None,
    times: int = 1,
    timestamp_ns: int | None = None,
    **values: object,
) -> Finding:
    """A finding with the texts of findings.yaml.

    Args:
        kind: key there, the name of the check, or "check: variant".
        got: what was found.
        file: as in `Finding`.
        field: as in `Finding`.
        severity: where it is not the one that stands there.
        hint: the same.
        times: as in `Finding`.
        timestamp_ns: as in `Finding`.
        values: named in braces in the text of what is expected.
    """
    text = _texts()[0][kind]
    return Finding(
        check=kind.split(":")[0],
        severity=severity or Severity(text.get("severity", "error")),
        file=str(file),
        field=field,
        expected=text["expected"].format(**values),
        got=got,
        hint=text.get("hint", "") if hint is None else hint,
        times=times,
        timestamp_ns=timestamp_ns,
    )


def unusable(error: DataError, *, check: str = "file", timestamp_ns: int | None = None) -> Finding:
    """Finding of a file that cannot be read, from its reader's error."""
    fields = {name: getattr(error, name) for name in ("file", "field", "expected", "got", "hint")}
    return Finding(check=check, timestamp_ns=timestamp_ns, **fields)


class Occurrences(TypedDict):
    """Number of times that something was found, and the first time, as `Finding` takes it."""

    times: int
    timestamp_ns: int | None


def occurrences(at: NDArray[np.bool_], times_ns: NDArray[np.int64]) -> Occurrences:
    """Number of elements that are True, at least one, and the time of the first."""
    return {"times": int(at.sum()), "timestamp_ns": int(times_ns[np.argmax(at)])}
