"""Where every annotated object and every image ended; nothing is left out in silence."""

from __future__ import annotations

from collections import Counter

import pandas as pd

from bench.evaluation.summary import FrameLedger, ObjectLedger
from bench.reference.records import IgnoreReason, Status


def object_ledger(objects: pd.DataFrame) -> ObjectLedger:
    """Count all rows of the objects table by status and reason."""
    status = Counter(objects["status"])
    reasons = Counter(objects.loc[objects["status"] == Status.IGNORED.value, "reason"])
    ledger = ObjectLedger(
        annotated=len(objects),
        evaluated=status[Status.EVALUATED.value],
        static=status[Status.STATIC.value],
        ignored={reason.value: reasons[reason.value] for reason in IgnoreReason if reasons[reason.value]},
    )
    ended = ledger.evaluated + ledger.static + sum(ledger.ignored.values())
    assert ended == ledger.annotated, "every annotated object is evaluated, static or ignored for a known reason"
    return ledger


def frame_ledger(frames: pd.DataFrame) -> FrameLedger:
    """Count all rows of the frames table by status, and the problems by their message."""
    status = Counter(frames["status"])
    ledger = FrameLedger(
        images=len(frames),
        evaluated=status["evaluated"],
        failed=status["failed"],
        skipped=status["skipped"],
        problems=dict(sorted(Counter(frames["problem"].dropna()).items())),
    )
    assert ledger.evaluated + ledger.failed + ledger.skipped == ledger.images, "every image is scored or accounted for"
    return ledger
