"""Scored runs by hand: sums of a few recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bench.evaluation.summary import ProtocolStamp
from bench.gate import ScoredRun, Tolerances, Verdict, judge, load_tolerances
from bench.gate.baseline import MetricSums, Origin, RecordingSums
from bench.harness.method_stamp import MethodStamp

CASES = 10
RULES = load_tolerances()


def sums(values: Sequence[float], *, cases: int = CASES) -> MetricSums:
    """A mean of `values[k]` over `cases` cases in each recording k."""
    names = [f"drive-{k}" for k in range(len(values))]
    return MetricSums(
        numerators={name: value * cases for name, value in zip(names, values, strict=True)},
        denominators=dict.fromkeys(names, float(cases)),
    )


def scored(
    slices: Mapping[str, Mapping[str, MetricSums]],
    *,
    counts: Mapping[str, Mapping[str, int]] | None = None,
    commit: str | None = "c0ffee",
    **changes: object,
) -> ScoredRun:
    found = {name: dict(metrics) for name, metrics in slices.items()}
    run = ScoredRun(
        schema_version=1,
        dataset="demo",
        split=None,
        protocol=ProtocolStamp(name="paper-v1", version=1, digest="d" * 64),
        method=MethodStamp(name="spherical", settings={"weights": {"epipolar": 1.0}, "threshold": 6e-4}),
        reference_fingerprint="r" * 64,
        data_fingerprint="f" * 64,
        origin=Origin(version="1", commit=commit, python="3.11", libraries={}, started_utc="2026-11-21T00:00:00"),
        sheet=RecordingSums(slices=found, counts={name: dict(part) for name, part in (counts or {}).items()}),
    )
    return run.model_copy(update=changes)


def one(values: Sequence[float], *, metric: str = "tpr_all", cases: int = CASES) -> ScoredRun:
    """A run with one metric of one slice."""
    return scored({"crossing": {metric: sums(values, cases=cases)}})


def verdict_of(before: ScoredRun, after: ScoredRun, rules: Tolerances = RULES) -> Verdict:
    return judge(before, after, tolerances=rules)
