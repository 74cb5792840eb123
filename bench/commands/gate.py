"""`gate`: judge a run by a baseline, or make the baseline."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands.command import TEXT, Flag, Place
from bench.commands.console import annotate, note, print_blocks, say
from bench.commands.run import NamedRun, Run
from bench.errors import BenchError, UsageError

if TYPE_CHECKING:
    from bench.gate.verdict import Verdict

FAILED, NO_VERDICT = 1, 3  # exit statuses


class MissingBaselineError(UsageError):
    """There is no baseline to judge by, which is never a pass."""


def judge(
    run: NamedRun,
    baseline: Annotated[str | Path | Run | None, typer.Option(), TEXT] = None,
    *,
    tolerances: Annotated[str | Path, typer.Option(), TEXT] = "default-v1",
    update: Flag = False,
) -> Verdict:
    """Judge a run against a baseline; exit status 0 passed, 1 a regression, 2 usage or data error, 3 no verdict.

    With --update the exit status is 0, whatever the old baseline says of the run.

    Args:
        run: stored, or its folder.
        baseline: folder of a baseline, or of an earlier run; default: reports/baselines/<data set>-<protocol>, without
            -<protocol> for paper-v1; if it is missing, the baseline that ships with the package.
        tolerances: rules: default-v1, rendered-v1, or a YAML file.
        update: store the run as the baseline, and print what changes by it.

    Returns:
        The verdict: `passed` is True only where something was judged and nothing failed, `why_none` says why there is
        no verdict, as where there is no baseline, one of other data, or a damaged one. `bench.write_verdict` hands it
        to a CI server.

    Raises:
        UnknownNameError: no tolerances of this name.
        UsageError, DataError: with `update`, a run that makes no baseline.

    Examples:
        fisheye-bench gate reports/runs/demo-spherical --junit gate.xml
        fisheye-bench gate reports/runs/demo-spherical --update
    """
    from bench.gate.baseline import find_baseline, read_baseline, read_run_sums, write_baseline
    from bench.gate.judge import judge as judge_sums
    from bench.gate.judge import judgeable
    from bench.gate.tolerances import load_tolerances
    from bench.gate.verdict import Verdict

    rules, scored = load_tolerances(tolerances), None
    folder, place = (named.folder if isinstance(named, Run) else Path(named or "") for named in (run, baseline))
    try:
        scored = read_run_sums(folder)
        place = find_baseline(scored.manifest, own=update) if baseline is None else place
        if not place.exists():
            raise MissingBaselineError(f"{place}: no baseline there, so nothing was judged; make one with --update")
        verdict = judge_sums(read_baseline(place), scored, tolerances=rules)
    except BenchError as error:
        if update and scored is None:
            raise
        manifest = None if scored is None else scored.manifest
        verdict = Verdict(baseline=None, run=manifest, tolerances=rules.title, refusal=error)
    stored = ""
    if update and scored is not None:
        write_baseline(scored, place)
        stored = judgeable(scored, tolerances=rules)
    return replace(verdict, baseline_folder=place, run_folder=folder, stored=stored)


def show(verdict: Verdict, *, junit: Place = None, json: Place = None, github: Flag = False) -> int:
    """Print the verdict, hand it to the CI server, and return the exit status.

    Args:
        verdict: of a run.
        junit: write JUnit XML to this file.
        json: write the verdict with all rows as JSON to this file.
        github: print GitHub annotations.
    """
    from bench.reporting.verdict import append_summary, to_annotations, write_verdict

    if verdict.refusal is None:
        _print_verdict(verdict)
    write_verdict(verdict, junit=junit, json=json)
    if github:
        annotate(to_annotations(verdict))
    if summary := os.environ.get("GITHUB_STEP_SUMMARY"):
        append_summary(Path(summary), verdict)
    missing = isinstance(verdict.refusal, MissingBaselineError)
    if verdict.stored:
        assert verdict.run is not None
        if missing:
            say("the first baseline of this name")
        elif verdict.refusal is not None:
            say(f"REPLACES WITHOUT COMPARING: {verdict.refusal}", style="bold red")
        elif verdict.judged and not verdict.passed:
            say("the new baseline accepts what failed by the one before it", style="bold red")
        say(f"{verdict.baseline_folder}: {verdict.run.title}, {verdict.run.code.text}")
        say(verdict.stored)
        return 0
    if verdict.refusal is not None and not missing:
        raise verdict.refusal
    if verdict.why_none:
        say(f"error: {verdict.why_none}", to_errors=True)
        return NO_VERDICT
    return 0 if verdict.passed else FAILED


def _print_verdict(verdict: Verdict) -> None:
    """Print what is read first, how to compare the two runs, then the other rows."""
    from bench.gate.baseline import how_to_compare
    from bench.gate.verdict import Outcome
    from bench.reporting.verdict import accept_blocks, first_blocks, other_blocks

    assert verdict.baseline is not None
    assert verdict.run is not None
    say(verdict.headline, style="green" if verdict.passed else "bold red")
    note(f"baseline {verdict.baseline_folder}")
    print_blocks(first_blocks(verdict))
    if not verdict.stored and (not verdict.passed or verdict.rows_with(Outcome.SUSPECT)):
        for line in how_to_compare(verdict.baseline, verdict.run, folder=verdict.run_folder):
            say(line)
    print_blocks([*other_blocks(verdict), *accept_blocks(verdict)])
    note("--json FILE has all rows")


command = judge  # `bench.gate` is a package
