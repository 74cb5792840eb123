"""The verdict as JSON, for other programs."""

from __future__ import annotations

import json
import math

from bench.gate.verdict import Check, Row, Verdict

SCHEMA_VERSION = 1


def to_json(verdict: Verdict) -> str:
    """All checks and all rows; NaN and infinity become null."""
    content = {
        "schema_version": SCHEMA_VERSION,
        "passed": verdict.passed,
        "headline": verdict.headline,
        "dataset": verdict.dataset,
        "method": verdict.method,
        "tolerances": verdict.tolerances,
        "baseline": verdict.baseline_origin.model_dump(mode="json"),
        "run": verdict.run_origin.model_dump(mode="json"),
        "checks": [_check(check) for check in verdict.checks],
        "rows": [_row(row) for row in verdict.rows],
    }
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _check(check: Check) -> dict[str, object]:
    return {"name": check.name, "outcome": check.outcome.value, "message": check.message}


def _row(row: Row) -> dict[str, object]:
    change = row.change
    return {
        "slice": row.slice_name,
        "metric": row.metric,
        "outcome": row.outcome.value,
        "reason": row.reason,
        "before": _number(change.before),
        "after": _number(change.after),
        "difference": _number(change.difference),
        "difference_ci95": None if change.ci95 is None else list(change.ci95),
        "p_value": change.p_value,
        "worsening": _number(row.worsening),
        "allowed": _number(row.allowed),
        "cases_before": change.cases_before,
        "cases_after": change.cases_after,
        "recordings": change.recordings,
        "worst_recording": row.worst_recording,
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
