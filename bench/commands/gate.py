"""`gate`: judge a run by a baseline, or make the baseline."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands.console import annotate, note, print_blocks, say
from bench.commands.options import StoredRun
from bench.errors import BenchError, UsageError

if TYPE_CHECKING:
    from bench.commands.runs import Run
    from bench.gate import Verdict
    from bench.harness.manifest import Manifest

FAILED, NO_VERDICT = 1, 3  # exit statuses
DEFAULT = "default-v1"


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
    from bench.commands.runs import run_folder
    from bench.gate import find_baseline, read_baseline, read_run_sums
    from bench.gate import judge as judge_sums
    from bench.gate.tolerances import load_tolerances

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
    from bench.commands.runs import run_folder
    from bench.gate import read_run_sums
    from bench.gate.judge import refuse
    from bench.gate.tolerances import load_tolerances

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
    from bench.commands.runs import run_folder
    from bench.gate import MissingBaselineError, read_baseline, read_run_sums, write_baseline
    from bench.gate import judge as judge_sums
    from bench.gate.baseline import own_baseline
    from bench.gate.judge import incomparable_reason, judgeable
    from bench.gate.tolerances import load_tolerances

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


def command(
    run: StoredRun,
    baseline: Annotated[
        Path | None,
        typer.Option(
            help="Folder of a baseline or run; default: reports/baselines/<data set>[-<protocol>], without the "
            "protocol for paper-v1, else the shipped one."
        ),
    ] = None,
    tolerances: Annotated[
        str | None, typer.Option(help="default-v1, rendered-v1, or a YAML file; default: default-v1.")
    ] = None,
    junit: Annotated[Path | None, typer.Option(help="Write JUnit XML to this file.")] = None,
    json: Annotated[Path | None, typer.Option(help="Write the verdict as JSON to this file.")] = None,
    github: Annotated[bool, typer.Option("--github", help="Print GitHub annotations.")] = False,
    whole: Annotated[bool, typer.Option("--all", help="List all rows, including those of breakdowns.")] = False,
    update: Annotated[
        bool, typer.Option("--update", help="Store the run as the baseline and print what changes; no verdict.")
    ] = False,
    allow_dirty: Annotated[bool, typer.Option("--allow-dirty", help="With --update: accept uncommitted code.")] = False,
) -> None:
    """Judge a run against a baseline; exit status 0 passed, 1 a regression, 2 usage or data error, 3 no verdict."""
    from bench.commands.runs import run_folder
    from bench.gate import MissingBaselineError, Outcome, find_baseline
    from bench.gate.changes import how_to_compare

    folder = run_folder(run)
    if update:
        _refuse_with_update(tolerances=tolerances, junit=junit, json=json, github=github)
        _update(folder, baseline=baseline, allow_dirty=allow_dirty, whole=whole)
        return
    rules = tolerances or DEFAULT
    hand_over = partial(_hand_over, junit=junit, json=json, github=github)
    try:
        verdict = judge(folder, baseline, tolerances=rules)
    except BenchError as error:
        hand_over(refused_verdict(folder, reason=str(error), tolerances=rules))
        if not isinstance(error, MissingBaselineError):
            raise
        say(f"error: {error}", to_errors=True)
        raise typer.Exit(NO_VERDICT) from error
    assert verdict.baseline is not None
    assert verdict.run is not None
    say(verdict.headline, style="green" if verdict.passed else "bold red")
    if baseline is None:
        note(f"baseline {find_baseline(verdict.run)}")
    _print_brief(verdict)
    if not verdict.passed or verdict.rows_with(Outcome.SUSPECT):
        first, *commands = how_to_compare(verdict.baseline, verdict.run, folder=folder)
        say(first)
        for command in commands:
            say(f"  {command}")
    _print_rest(verdict, whole=whole)
    hand_over(verdict)
    if verdict.why_none:
        say(f"error: {verdict.why_none}", to_errors=True)
        raise typer.Exit(NO_VERDICT)
    if not verdict.passed:
        raise typer.Exit(FAILED)


def _update(run: Path, *, baseline: Path | None, allow_dirty: bool, whole: bool) -> None:
    """Store a run as the baseline, and print what differs from the one that it replaces."""
    made = update_baseline(run, baseline, allow_dirty=allow_dirty)
    if made.difference is None:
        say(made.replaced, style="bold red" if made.replaces_blindly else "")
    else:
        _print_brief(made.difference)
        _print_rest(made.difference, whole=whole)
    say(f"{made.folder}: {_origin(made.run)}")
    say(f"{made.judgeable}{made.why_few}", style="bold red" if made.why_few else "")


def _refuse_with_update(**options: object) -> None:
    """Refuse options of a verdict where none is made, so that no script takes an update for a pass."""
    for name, value in options.items():
        if value:
            raise UsageError(f"--{name}: expected only with a verdict, got with --update, which makes none")


def _print_brief(verdict: Verdict) -> None:
    """Print what changed, the overall rows, and where most was lost."""
    from bench.gate.brief import overall_rows, worst_line
    from bench.reporting.verdict import head_lines, row_table

    print_blocks(head_lines(verdict))
    if rows := overall_rows(verdict):
        print_blocks([row_table(rows)])
    if worst := worst_line(verdict):
        say(worst)


def _print_rest(verdict: Verdict, *, whole: bool) -> None:
    """The other rows: those that do not overlap, or all."""
    from bench.gate.brief import folded_lines, main_rows
    from bench.reporting.verdict import CAPTION, full_lines, full_rows, row_table

    if whole:
        print_blocks([row_table(full_rows(verdict), caption=CAPTION), *full_lines(verdict)])
        return
    if rows := main_rows(verdict):
        print_blocks([row_table(rows, caption=CAPTION)])
    folded = folded_lines(verdict)
    for line in folded:
        say(line, style="dim")
    if folded:
        say("--all lists these rows too", style="dim")


def _hand_over(verdict: Verdict, *, junit: Path | None, json: Path | None, github: bool) -> None:
    """To the CI server, whatever the exit status: files, annotations, the step's summary."""
    from bench.reporting.verdict import append_summary, to_annotations, write_verdict

    write_verdict(verdict, junit=junit, json=json)
    if github:
        annotate(to_annotations(verdict))
    if summary := os.environ.get("GITHUB_STEP_SUMMARY"):
        append_summary(Path(summary), verdict)


def _origin(run: Manifest) -> str:
    from bench.harness.digests import short_digest

    commit, own = run.code.commit, run.method.commit
    made = f"commit {short_digest(commit)}" if commit else "an unknown commit"
    of_method = f", the method of commit {short_digest(own)}" if own else ""
    return f"{run.title}, version {run.code.version}, {made}{of_method}"
