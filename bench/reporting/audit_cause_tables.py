"""Why cells are missed, and why cells are flagged."""

from __future__ import annotations

from bench.harness.audit import ALL, AuditSummary, FalseCause, MissCause, MissFigures
from bench.reference import Category
from bench.reporting.audit_sheet import AuditTable, decimal, share
from bench.reporting.sheets import Sheet
from bench.reporting.tables import LABELS

MISSES = {
    MissCause.NEAR_EPIPOLE: "blind: at the epipole",
    MissCause.ENTERED: "blind: just entered",
    MissCause.ABOVE_HORIZON: "blind: above horizon",
    MissCause.BELOW_THRESHOLD: "blind: below threshold",
    MissCause.UNCOVERED: "flow: hidden before",
    MissCause.FLOW: "flow",
    MissCause.EGO_MOTION: "ego-motion, calibration",
}
FALSE_ALARMS = {
    FalseCause.ANTI_PARALLEL: "method: anti-parallel",
    FalseCause.OTHER_CONSTRAINT: "method: other constraint",
    FalseCause.UNCOVERED: "flow: hidden before",
    FalseCause.BESIDE_OBJECT: "flow: beside a moving object",
    FalseCause.FLOW: "flow: elsewhere",
    FalseCause.EGO_MOTION: "ego-motion, calibration",
}


def miss_table(audit: AuditSummary) -> AuditTable:
    """One line per kind of motion, then all."""
    rows = [_miss_cells(row) for row in audit.misses if row.cells]
    return AuditTable(
        sheet=Sheet(
            title="Why cells of moving objects are missed, in percent of the missed ones",
            headings=("Type", "Frames", "Cells", "Found %", "by error %", *MISSES.values(), "flow error px"),
            rows=tuple(rows),
        ),
        note="Cells of the exact masks. By error: share of all cells that are found although the exact flow fires "
        "nothing there. Blind: the exact flow with exact ego-motion fires nothing either, since the motion lies in the "
        "epipolar plane or the deviation stays below the threshold; above the horizon no height constraint can help. "
        "Flow: it would have fired by the exact flow. Ego-motion: it would have fired by the exact ego-motion. Each "
        "cell has one cause, so a line adds up to 100. Flow error: median over object-frames.",
        labels=1,
    )


def _miss_cells(row: MissFigures) -> tuple[str, ...]:
    shares = [share(row.causes[cause.value], row.missed) for cause in MISSES]
    found = [share(row.hit, row.cells), share(row.hit_by_error, row.cells)]
    label = "All moving" if row.category == ALL else LABELS[Category(row.category)]
    return (label, str(row.object_frames), str(row.cells), *found, *shares, decimal(row.flow_error_px.median))


def false_alarm_table(audit: AuditSummary) -> AuditTable:
    """One line."""
    row = audit.false_alarms
    assert row is not None, "asked for only where there is exact flow"
    shares = [share(row.causes[cause.value], row.flagged) for cause in FALSE_ALARMS]
    return AuditTable(
        sheet=Sheet(
            title="Why cells of the static world are flagged, in percent of the flagged ones",
            headings=("Images", "Cells", "Flagged %", *FALSE_ALARMS.values(), "flow error px"),
            rows=(
                (str(row.images), str(row.cells), share(row.flagged, row.cells), *shares,
                 decimal(row.flow_error_px.median)),
            ),
        ),
        note="Method: the exact flow with exact ego-motion flags them as well; anti-parallel is the paper's own, "
        "static points between the road and the camera's height. Flow: only the estimated flow flags them. Ego-motion: "
        "only the recorded ego-motion and calibration do.",
        labels=0,
    )  # fmt: skip
