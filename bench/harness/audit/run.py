"""A whole audit: data set, method and protocol in, figures and tables out."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from bench.errors import BenchError, DataError, UsageError
from bench.evaluation import Protocol
from bench.evaluation.summary import ProtocolStamp
from bench.harness import provenance as origin
from bench.harness.audit.figures import AuditSummary
from bench.harness.audit.polygons import POLYGON_KINDS
from bench.harness.audit.recording import RecordingAudit, Scoring, audit_recording, joined
from bench.harness.audit.reduce import aims, false_alarm_figures, miss_figures, polygon_figures, scores
from bench.harness.audit.sources import NO_SCENARIO, AuditSource, audit_sources
from bench.harness.audit.stored import SCHEMA_VERSION, write_audit
from bench.harness.method_stamp import MethodStamp
from bench.harness.progress import Progress, recording_reporter
from bench.methods import Method
from bench.methods.spherical.method import SphericalMethod
from bench.recordings import DatasetCard
from bench.threads import single_threaded, use_one_thread

Outcome = RecordingAudit | BenchError


def run_audit(
    card: DatasetCard,
    *,
    method: Method,
    protocol: Protocol,
    out: Path,
    split: str | None = None,
    recordings: int | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> AuditSummary:
    """Audit a rendered data set and store what comes out.

    Args:
        card: the data set.
        method: whose detections are scored and explained.
        protocol: the rules.
        out: folder of the audit.
        split: of the data set; None for all of it.
        recordings: how many of them; None for all.
        workers: processes; what comes out does not depend on it.
        progress: called with the recordings done and their number.

    Returns:
        The figures, also stored as `audit.json`.

    Raises:
        DataError: nothing of the data set could be audited, above all where it has no rendered masks.
        UsageError: fewer than one worker.
    """
    if workers < 1:
        raise UsageError(f"--workers: wanted at least 1, came {workers}")
    start = origin.Start.now()
    sources = audit_sources(card, split=split, recordings=recordings)
    audit_one = partial(audit_recording, method=method, protocol=protocol)
    outcomes = dict(_in_turn(sources, audit_one, progress) if workers == 1 or len(sources) == 1
                    else _side_by_side(sources, audit_one, workers, progress))  # fmt: skip
    found = [outcomes[k] for k in sorted(outcomes)]
    audits = [outcome for outcome in found if isinstance(outcome, RecordingAudit)]
    if not audits:
        raise next(outcome for outcome in found if isinstance(outcome, BenchError))
    audit = joined(audits)
    failures = [
        f"recording {sources[number].recorded.name!r}: {outcome}"
        for number, outcome in sorted(outcomes.items())
        if isinstance(outcome, BenchError)
    ]
    summary = _summary(
        audit,
        card=card,
        split=split,
        method=method,
        protocol=protocol,
        recordings=len(audits),
        left_out=_left_out(sources, method, audit),
        failures=(*failures, *audit.problems),
        provenance=origin.provenance_since(
            start,
            fingerprints=audit.fingerprints,
            stage_seconds=audit.seconds,
            images=len(audit.scores[Scoring.LIDAR.value][1]),
        ),
    )
    write_audit(out, summary, audit)
    return summary


def _summary(
    audit: RecordingAudit,
    *,
    card: DatasetCard,
    split: str | None,
    method: Method,
    protocol: Protocol,
    recordings: int,
    left_out: str,
    failures: tuple[str, ...],
    provenance: origin.Provenance,
) -> AuditSummary:
    own = protocol.reference.polygon_kind
    kinds = (own, *(kind for kind in POLYGON_KINDS if kind != own))
    explained = len(audit.false_alarms) > 0
    return AuditSummary(
        schema_version=SCHEMA_VERSION,
        dataset=card.name,
        card=str(card.file),
        split=split,
        recordings=recordings,
        method=MethodStamp.of(method),
        protocol=ProtocolStamp(name=protocol.name, version=protocol.version, digest=protocol.digest),
        polygon_kinds=kinds,
        polygons=polygon_figures(audit.polygons, protocol=protocol, kinds=kinds),
        aims=aims(audit.polygons, kinds=kinds),
        not_seen=audit.not_seen,
        scores={name: scores(*tables, protocol=protocol) for name, tables in audit.scores.items()},
        misses=miss_figures(audit.misses, protocol=protocol) if explained else (),
        false_alarms=false_alarm_figures(audit.false_alarms) if explained else None,
        left_out=left_out,
        failures=failures,
        provenance=provenance,
    )


def _left_out(sources: tuple[AuditSource, ...], method: Method, audit: RecordingAudit) -> str:
    """Why nothing is explained by exact flow; empty where something is."""
    if len(audit.false_alarms):
        return ""
    if not isinstance(method, SphericalMethod):
        return f"the method {method.name!r} does not take flow from outside; only 'spherical' does"
    if sources[0].scenario is None:
        return NO_SCENARIO
    return "the scene of no recording could be staged again; see the failures"


def _in_turn(
    sources: tuple[AuditSource, ...], audit_one: partial[RecordingAudit], progress: Progress | None
) -> Iterator[tuple[int, Outcome]]:
    with single_threaded():
        for number, source in enumerate(sources):
            report = recording_reporter(progress, number, len(sources))
            yield number, _outcome(partial(audit_one, progress=report), source)
            report(1.0)


def _side_by_side(
    sources: tuple[AuditSource, ...], audit_one: partial[RecordingAudit], workers: int, progress: Progress | None
) -> Iterator[tuple[int, Outcome]]:
    processes = min(workers, len(sources))
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn"), initializer=use_one_thread) as pool:
        numbers = {pool.submit(_outcome, audit_one, source): number for number, source in enumerate(sources)}
        try:
            for done, future in enumerate(as_completed(numbers), start=1):
                yield numbers[future], future.result()
                if progress is not None:
                    progress(done, len(sources))
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _outcome(audit_one: partial[RecordingAudit], source: AuditSource) -> Outcome:
    """The audit, or the user's mistake that prevents it; a bug goes on upwards."""
    try:
        return audit_one(source)
    except DataError as error:
        return error
