"""The tables of an audit as sheets of text, each with a note that says how to read it."""

from __future__ import annotations

from bench.harness.audit import AuditSummary
from bench.reporting.audit_cause_tables import false_alarm_table, miss_table
from bench.reporting.audit_polygon_tables import aim_table, compensation_table, polygon_table
from bench.reporting.audit_score_table import score_table
from bench.reporting.audit_sheet import AuditTable


def audit_tables(audit: AuditSummary) -> tuple[AuditTable, ...]:
    """Polygons by class and range, the aim, compensation, scores; missed cells and false alarms by exact flow."""
    tables = [polygon_table(audit), aim_table(audit), compensation_table(audit), score_table(audit)]
    if audit.false_alarms is not None:
        tables += [miss_table(audit), false_alarm_table(audit)]
    return tuple(tables)
