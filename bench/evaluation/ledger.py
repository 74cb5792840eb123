"""Where every annotated object and every image ended; nothing is left out in silence."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bench.evaluation.columns import Columns
from bench.evaluation.summary import FrameLedger, ObjectLedger
from bench.reference.records import IgnoreReason, Status


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowLedger:
    """All rows of a table.

    Attributes:
        statuses: rows by status.
        reasons: rows by status and reason, or problem; "" where there is none.
    """

    statuses: Counter[str]
    reasons: Counter[tuple[str, str]]

    @property
    def rows(self) -> int:
        """How many there are."""
        return self.statuses.total()

    def with_rows(self, rows: Columns, *, reasons: str) -> RowLedger:
        """This and more rows, counted by the column `reasons`."""
        (status, statuses), (reason, found) = rows.words("status"), rows.words(reasons)
        assert (status >= 0).all(), "every row has a status"
        pairs, counts = np.unique(status * (len(found) + 1) + reason + 1, return_counts=True)
        more: Counter[tuple[str, str]] = Counter()
        for pair, count in zip(pairs.tolist(), counts.tolist(), strict=True):
            of_status, of_reason = divmod(pair, len(found) + 1)
            more[statuses[of_status], ("", *found)[of_reason]] += count
        return RowLedger(statuses=self.statuses + _by_status(more.items()), reasons=self.reasons + more)


def object_ledger(ledger: RowLedger) -> ObjectLedger:
    """The ledger of the objects table."""
    status = ledger.statuses
    reasons = {reason: ledger.reasons[Status.IGNORED.value, reason.value] for reason in IgnoreReason}
    found = ObjectLedger(
        annotated=ledger.rows,
        evaluated=status[Status.EVALUATED.value],
        static=status[Status.STATIC.value],
        ignored={reason.value: count for reason, count in reasons.items() if count},
    )
    ended = found.evaluated + found.static + sum(found.ignored.values())
    assert ended == found.annotated, "every annotated object is evaluated, static or ignored for a known reason"
    return found


def frame_ledger(ledger: RowLedger) -> FrameLedger:
    """The ledger of the frames table; the problems by their message."""
    status, problems = ledger.statuses, Counter[str]()
    for (_, problem), count in ledger.reasons.items():
        if problem:
            problems[problem] += count
    found = FrameLedger(
        images=ledger.rows,
        evaluated=status["evaluated"],
        failed=status["failed"],
        skipped=status["skipped"],
        problems=dict(sorted(problems.items())),
    )
    assert found.evaluated + found.failed + found.skipped == found.images, "every image is scored or accounted for"
    return found


def _by_status(counted: Iterable[tuple[tuple[str, str], int]]) -> Counter[str]:
    statuses: Counter[str] = Counter()
    for (status, _), count in counted:
        statuses[status] += count
    return statuses
