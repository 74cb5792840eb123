"""Sums of runs by hand: a few recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import pandas as pd

from bench.evaluation.definitions import image_metrics, object_metrics
from bench.evaluation.sums import CATEGORY, FRAMES, KEY, TERMS
from bench.gate.baseline import RunSums
from bench.gate.judge import judge
from bench.gate.tolerances import Tolerance, Tolerances, load_tolerances
from bench.gate.verdict import Verdict
from bench.harness.manifest import CodeOfRun, DatasetOfRun, Manifest
from tests.support.manifests import manifest

CASES = 10
RULES = load_tolerances()
TOLERATED = tuple(
    m.name for m in (*object_metrics((0.1, 0.5)), *image_metrics()) if m.higher_is_better is not None and m.tolerated
)
ALL_DECIDE = RULES.model_copy(update={"metrics": dict.fromkeys(TOLERATED, Tolerance(decides=True))})
Sums = Mapping[str, tuple[float, float]]  # recording -> numerator and denominator
BREAKDOWNS = {FRAMES: FRAMES, "all_moving": "all_moving"}


def sums(values: Sequence[float], *, cases: int = CASES) -> Sums:
    """A mean of `values[k]` over `cases` cases in each recording k."""
    return {f"drive-{k}": (value * cases, float(cases)) for k, value in enumerate(values)}


def table(slices: Mapping[str, Mapping[str, Sums]]) -> pd.DataFrame:
    """A table of sums; "range_m=[0, 2)" is a slice of a breakdown."""
    rows = []
    for called, metrics in slices.items():
        breakdown, _, name = called.partition("=") if "=" in called else (BREAKDOWNS.get(called, CATEGORY), "", called)
        rows += [
            (breakdown, name, drive, metric, *terms) for metric, own in metrics.items() for drive, terms in own.items()
        ]
    return pd.DataFrame(rows, columns=[*KEY, *TERMS])


def scored(slices: Mapping[str, Mapping[str, Sums]], *, failures: tuple[str, ...] = (), **changes: object) -> RunSums:
    """A run with these sums, in what `changed` takes like any other."""
    settings = {"weights": {"epipolar": 1.0}, "threshold": 6e-4}
    of_run = manifest(
        method="spherical", settings=settings, commit="c0ffee", reference="r" * 64, recordings={"drive-0": "f" * 16}
    )
    return changed(RunSums(manifest=of_run, sums=table(slices), failures=failures), **changes)


def changed(run: RunSums, **changes: object) -> RunSums:
    """The same run of another manifest: fields of it, of its data set (`name`, `split`, `data`, ...) or `commit`."""
    if "data" in changes:
        changes["recordings"] = {"drive-0": changes.pop("data")}
    dataset = {name: value for name, value in changes.items() if name in DatasetOfRun.model_fields}
    code = {name: value for name, value in changes.items() if name in CodeOfRun.model_fields}
    own = {name: value for name, value in changes.items() if name in Manifest.model_fields}
    assert {*dataset, *code, *own} == {*changes}
    of_run = run.manifest
    parts = {"dataset": of_run.dataset.model_copy(update=dataset), "code": of_run.code.model_copy(update=code)}
    return replace(run, manifest=of_run.model_copy(update=parts | own))


def one(values: Sequence[float], *, metric: str = "tpr_all", cases: int = CASES) -> RunSums:
    """A run with one metric of one slice."""
    return scored({"crossing": {metric: sums(values, cases=cases)}})


def verdict_of(before: RunSums, after: RunSums, rules: Tolerances = RULES) -> Verdict:
    return judge(before, after, tolerances=rules)
