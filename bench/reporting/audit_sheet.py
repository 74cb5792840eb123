"""A table of an audit, and how its numbers are written."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bench.reporting.sheets import Sheet


@dataclass(frozen=True, slots=True, kw_only=True)
class AuditTable:
    """A table and how to read it.

    Attributes:
        sheet: the table.
        note: one or two sentences.
        labels: how many columns from the left are words.
    """

    sheet: Sheet
    note: str
    labels: int


def decimal(value: float) -> str:
    """A number with two decimals, "n/a" for NaN."""
    return "n/a" if math.isnan(value) else f"{value:.2f}"


def share(part: int, whole: int) -> str:
    """A share in percent, "n/a" of nothing."""
    return f"{100 * part / whole:.1f}" if whole else "n/a"
