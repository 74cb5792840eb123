"""Judge a run by a baseline, and make the baseline."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bench.api.runs import Run, run_folder
from bench.errors import BenchError
from bench.gate import MissingBaselineError, find_baseline, read_baseline, read_run_sums, write_baseline
from bench.gate import judge as judge_sums
from bench.gate.baseline import own_baseline
from bench.gate.judge import incomparable_reason, judgeable, refuse
from bench.gate.tolerances import DEFAULT, load_tolerances
from bench.gate.verdict import Verdict
from bench.harness.manifest import Manifest


def judge(
    run: str | Path | Run, baseline: str | Path | Run | None = None, *, tolerances: str | Path = DEFAULT
) -> Verdict:
    """Judge a run by a baseline, as `fisheye-bench gate` does; `bench.write_verdict` hands the verdict to a CI server.

    Args:
        run: stored, or its folder.
        baseline: folder of a baseline, or another run; None for `reports/baselines/<data set>`, with -<protocol>
            behind the name unless that is paper-v1, or the one that ships with the package.
        tolerances: by name or file.

    Returns:
        The verdict: `passed` is True only where something was judged and nothing failed.

    Raises:
        MissingBaselineError: there is no such baseline; a `UsageError`, as all that follow.
        UnknownNameError: no tolerances of this name.
        UsageError: the baseline is of another data set, split or protocol.
        DataError: run or baseline is missing or damaged.
    """
    rules, scored = load_tolerances(tolerances), read_run_sums(run_folder(run))
    before = read_baseline(find_baseline(scored.manifest) if baseline is None else run_folder(baseline))
    return judge_sums(before, scored, tolerances=rules)


def refused_verdict(run: str | Path | Run, *, reason: str, tolerances: str | Path = DEFAULT) -> Verdict:
    """No verdict on a run, for a CI server that shall be told why `judge` made none.

    Args:
        run: stored, or its folder, which may be missing or damaged.
        reason: one line.
        tolerances: by name or file.

    Raises:
        UnknownNameError: no tolerances of this name.
    """
    rules = load_tolerances(tolerances)
    try:
        manifest = read_run_sums(run_folder(run)).manifest
    except BenchError:
        manifest = None
    return refuse(manifest, tolerances=rules, reason=reason)


@dataclass(frozen=True, slots=True, kw_only=True)
class BaselineUpdate:
    """A run that was stored as the baseline.

    Attributes:
        folder: of the baseline.
        run: its manifest.
        difference: from the baseline that it replaces; None where there was none that compares.
        replaced: what there was instead, in words; "" where there is a difference.
        judgeable: how many of its metrics can be judged, in words.
        why_few: why none can; "" for some.
    """

    folder: Path
    run: Manifest
    difference: Verdict | None
    replaced: str
    judgeable: str
    why_few: str

    @property
    def replaces_blindly(self) -> bool:
        """True if it replaces a baseline that it could not be compared with."""
        return self.replaced.startswith("REPLACES")


def update_baseline(
    run: str | Path | Run, baseline: str | Path | None = None, *, allow_dirty: bool = False
) -> BaselineUpdate:
    """Store a run as the baseline, as `fisheye-bench gate --update` does, and say what changes by it.

    Args:
        run: stored, or its folder.
        baseline: folder of the baseline; None for the one that `judge` looks for below the working folder.
        allow_dirty: also of changed, uncommitted code.

    Raises:
        DataError: the run is missing or damaged.
        UsageError: it has failures or was made by code that nobody can repeat, or the folder is that of a run.
    """
    scored = read_run_sums(run_folder(run))
    folder = own_baseline(scored.manifest) if baseline is None else Path(baseline)
    rules, difference, replaced = load_tolerances(), None, ""
    try:
        before = read_baseline(folder)
        if differing := incomparable_reason(before.manifest, scored.manifest):
            replaced = f"REPLACES WHAT DOES NOT COMPARE: {differing[0]}"
        else:
            difference = judge_sums(before, scored, tolerances=rules)
    except MissingBaselineError:
        replaced = "the first baseline of this name"
    except BenchError as error:
        replaced = f"REPLACES WHAT CANNOT BE READ: {error}"
    write_baseline(scored, folder, allow_dirty=allow_dirty)
    counted, why_few = judgeable(scored, tolerances=rules)
    return BaselineUpdate(
        folder=folder,
        run=scored.manifest,
        difference=difference,
        replaced=replaced,
        judgeable=counted,
        why_few=why_few,
    )
