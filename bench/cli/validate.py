"""`validate`: what looks wrong in a data set, or in what an adapter gives."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli.console import say
from bench.cli.options import Split
from bench.cli.progress import progress_bar
from bench.errors import UsageError
from bench.plain_text import listed

if TYPE_CHECKING:
    from bench.recordings.catalogue import Adapter
    from bench.validation import Finding, RecordingReport, ValidationReport

SHOWN = 5  # findings of one check in one recording that are printed; the file has all
SHOWN_PLACES = 3  # of findings that read alike
COLOURS = {"error": "red", "warning": "yellow"}


def validate(
    dataset: Annotated[str, typer.Argument(help="A data-set card; with --adapter a folder of data.")],
    split: Split = None,
    deep: Annotated[bool, typer.Option("--deep", help="Read every image and sweep, not a sample.")] = False,
    errors_only: Annotated[
        bool, typer.Option("--errors-only", help="Exit with 0 where there are warnings alone.")
    ] = False,
    json: Annotated[Path | None, typer.Option(help="Write all findings as JSON to this file.")] = None,
    adapter: Annotated[
        str | None, typer.Option(help="MODULE:FUNCTION; tries whether your adapter keeps the contract.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="With --adapter: an option of it.")
    ] = None,
) -> None:
    """List what looks wrong in a data set: 0 nothing, 1 something, 2 usage or data error."""
    if adapter is not None:
        passed = validate_adapter(adapter, Path(dataset), settings=set_ or [])
    else:
        passed = validate_recordings(dataset, split=split, deep=deep, errors_only=errors_only, json=json)
    if not passed:
        raise typer.Exit(1)


def validate_recordings(dataset: str, *, split: str | None, deep: bool, errors_only: bool, json: Path | None) -> bool:
    """Validate a data set, print what is wrong with it; whether it passed."""
    from bench.atomic import write_text
    from bench.cli.request import render_if_synthetic
    from bench.recordings import load_card, open_dataset
    from bench.validation import Depth, Severity, validate_dataset

    card = load_card(dataset)
    if card.scenario is not None and card.remote_root is None and not card.root.is_dir():
        render_if_synthetic(card)  # what is there is validated as it is
    handles = open_dataset(card, split)
    with progress_bar(f"validating {card.name}", "recordings") as progress:
        report = validate_dataset(card.name, handles, depth=Depth.DEEP if deep else Depth.SAMPLED, progress=progress)
    if json is not None:
        write_text(json, report.as_json())
    for recording in report.recordings:
        _print_findings(recording)
    for line in _closing(report, json):
        say(line)
    return not (report.count(Severity.ERROR) if errors_only else report.findings)


def validate_adapter(name: str, root: Path, *, settings: Sequence[str]) -> bool:
    """Run the contract test on an adapter, print the promises that it breaks; whether it keeps them all."""
    from bench.cli.request import parse_settings
    from bench.plug_ins import imported
    from bench.recordings.contract import adapter_faults

    if not all(name.partition(":")):
        raise UsageError(f"--adapter: expected module:function, got {name!r}")
    adapter: Adapter = imported(name, expected=f"--adapter {name}: expected a function")
    if not root.is_dir():
        raise UsageError(f"expected the folder of a data set, got {root}, which is missing")
    with progress_bar(f"trying {name}", "recordings") as progress:
        faults = adapter_faults(adapter, root, options=parse_settings(settings), progress=progress)
    for fault in faults:
        say(fault, style="red")
    told = f"breaks {len(faults)} promises of" if faults else "keeps"
    say(f"{name} {told} the contract of adapters")
    return not faults


def _print_findings(recording: RecordingReport) -> None:
    """A few lines a finding, those that read alike in one, those of one check together as the first of them comes."""
    checks: dict[str, dict[tuple[str, ...], list[Finding]]] = {}
    for finding in recording.findings:
        text = (finding.severity.value, finding.expected, finding.got, finding.hint)
        checks.setdefault(finding.check, {}).setdefault(text, []).append(finding)
    if checks:
        say(recording.name, style="bold")
    for check, groups in checks.items():
        for (severity, expected, got, hint), findings in list(groups.items())[:SHOWN]:
            places = listed([_where(finding) for finding in findings], SHOWN_PLACES)
            say(f"  {severity:7}  {check}: {places}{_occurrence(findings)}", style=COLOURS[severity])
            say(f"           expected {expected}; got {got}")
            if hint:
                say(f"           {hint}")
        if rest := sum(map(len, list(groups.values())[SHOWN:])):
            say(f"           ... and {rest} more of {check}; --json FILE has all")


def _where(finding: Finding) -> str:
    """File below the recording's folder, and the field in it."""
    parts = Path(finding.file).parts
    if finding.recording in parts:
        parts = parts[len(parts) - parts[::-1].index(finding.recording) :] or parts[-1:]
    return ": ".join(filter(None, (str(Path(*parts)), finding.field)))


def _occurrence(findings: Sequence[Finding]) -> str:
    """Describe how often findings occurred, if more than once, and when, if at a known time; "" for neither."""
    count, time_ns = sum(finding.times for finding in findings), findings[0].timestamp_ns
    times = f"{count} times" if count > 1 else ""
    at = "" if time_ns is None else f"{'first ' if times else ''}at {time_ns}"
    told = ", ".join(filter(None, (times, at)))
    return f" ({told})" if told else ""


def _closing(report: ValidationReport, json: Path | None) -> list[str]:
    from bench.validation import Depth, Severity

    errors, warnings = report.count(Severity.ERROR), report.count(Severity.WARNING)
    images = [sum(recording.images[i] for recording in report.recordings) for i in (0, 1)]
    sweeps = [sum(recording.sweeps[i] for recording in report.recordings) for i in (0, 1)]
    lines = [
        f"{errors} errors and {warnings} warnings in {len(report.recordings)} recordings; "
        f"read {images[0]} of {images[1]} images and {sweeps[0]} of {sweeps[1]} sweeps"
    ]
    if report.depth is Depth.SAMPLED and (images[0] < images[1] or sweeps[0] < sweeps[1]):
        lines[0] += "; --deep reads all"
    return [*lines, *([str(json)] if json is not None else [])]
