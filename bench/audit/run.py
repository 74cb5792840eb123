"""A whole audit: data set, method and protocol in, metrics and tables out."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from bench.audit.causes import EXPLAINED
from bench.audit.recording import audit_recording, joined
from bench.audit.reduce import aims, false_alarm_figures, miss_figures, polygon_figures, scores
from bench.audit.results import AuditSummary, write_audit
from bench.audit.sources import NO_SCENARIO, audit_each
from bench.evaluation import Protocol
from bench.evaluation.summary import ProtocolOfRun
from bench.execution import SerialExecutor, TaskExecutor
from bench.harness.method_of_run import MethodOfRun
from bench.harness.stages import Progress
from bench.methods import FlowMethod, Method
from bench.recordings import DatasetCard
from bench.reference import REGION_KINDS


def run_audit(
    card: DatasetCard,
    *,
    method: Method,
    protocol: Protocol,
    out: Path,
    split: str | None = None,
    recordings: int | None = None,
    executor: TaskExecutor = SerialExecutor(),  # noqa: B008 - it holds nothing
    progress: Progress | None = None,
) -> AuditSummary:
    """Audit a rendered data set and store what comes out; nothing is stored before the last recording is done.

    Args:
        card: the data set.
        method: whose detections are scored and explained.
        protocol: the rules.
        out: folder of the audit.
        split: of the data set; None for all of it.
        recordings: how many of them; None for all.
        executor: audits the recordings; the result does not depend on it.
        progress: called with the recordings done and their number.

    Returns:
        The metrics, also stored as `audit.json`.

    Raises:
        DataError: nothing of the data set could be audited, above all where it has no rendered masks.
    """
    audits, stored = audit_each(
        partial(audit_recording, method=method, protocol=protocol),
        card=card,
        split=split,
        recordings=recordings,
        executor=executor,
        progress=progress,
    )
    audit = joined(audits)
    own = protocol.reference_settings().polygon_kind
    kinds = (own, *(kind for kind in REGION_KINDS if kind != own))
    explained = len(audit.false_alarms) > 0
    summary = AuditSummary(
        **dict(stored),
        method=MethodOfRun.of(method),
        protocol=ProtocolOfRun(name=protocol.name, version=protocol.version, digest=protocol.digest),
        polygon_kinds=kinds,
        polygons=polygon_figures(audit.polygons, protocol=protocol, kinds=kinds),
        aims=aims(audit.polygons, kinds=kinds),
        not_seen=audit.not_seen,
        scores={name: scores(*tables, protocol=protocol) for name, tables in audit.scores.items()},
        misses=miss_figures(audit.misses, protocol=protocol) if explained else (),
        false_alarms=false_alarm_figures(audit.false_alarms) if explained else None,
        left_out="" if explained else _left_out(card, method),
    )
    write_audit(out, summary, audit)
    return summary


def _left_out(card: DatasetCard, method: Method) -> str:
    """Reason that nothing is explained by exact flow."""
    if not isinstance(method, FlowMethod):
        return f"the method {method.name!r} does not take flow from outside, {EXPLAINED}"
    if card.scenario is None:
        return NO_SCENARIO
    return "the scene of no recording could be simulated again; see the failures"
