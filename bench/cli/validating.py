"""Validation of data sets and adapters."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from rich.table import Table
from rich.text import Text

from bench.cli.computing import parse_settings, render_if_synthetic
from bench.cli.console import progress_bar, say, show
from bench.errors import UsageError
from bench.plug_ins import imported
from bench.recordings import load_card, open_dataset, write_text
from bench.recordings.catalogue import Adapter
from bench.recordings.contract import adapter_faults
from bench.validation import Depth, Finding, Severity, ValidationReport, validate_dataset

SHOWN = 8  # findings of one check in one recording that the table shows; the file has all
COLOURS = {Severity.ERROR: "red", Severity.WARNING: "yellow"}


def validate(dataset: str, *, split: str | None, deep: bool, errors_only: bool, json: Path | None) -> bool:
    """Validate a data set, print what is wrong with it; whether it passed."""
    card = load_card(dataset)
    if card.scenario is not None and card.remote_root is None and not card.root.is_dir():
        render_if_synthetic(card)  # what is there is validated as it is
    handles = open_dataset(card, split)
    with progress_bar(f"validating {card.name}", "recordings") as progress:
        report = validate_dataset(card.name, handles, depth=Depth.DEEP if deep else Depth.SAMPLED, progress=progress)
    if json is not None:
        write_text(json, report.as_json())
    if report.findings:
        show(_table(report))
    for line in _closing(report, json):
        say(line)
    return not (report.count(Severity.ERROR) if errors_only else report.findings)


def validate_adapter(name: str, root: Path, *, settings: Sequence[str]) -> bool:
    """Run the contract test on an adapter, print the promises that it breaks; whether it keeps them all."""
    adapter = _imported(name)
    if not root.is_dir():
        raise UsageError(f"expected the folder of a data set, got {root}, which is missing")
    with progress_bar(f"trying {name}", "recordings") as progress:
        faults = adapter_faults(adapter, root, options=parse_settings(settings), progress=progress)
    for fault in faults:
        say(fault, style="red")
    told = f"breaks {len(faults)} promises of" if faults else "keeps"
    say(f"{name} {told} the contract of adapters")
    return not faults


def _table(report: ValidationReport) -> Table:
    table = Table("recording", "check", "where", "expected", "got", "times", box=None, pad_edge=False)
    for recording in report.recordings:
        shown: Counter[str] = Counter()
        for finding in recording.findings:
            shown[finding.check] += 1
            if shown[finding.check] <= SHOWN:
                _row(table, finding, name=recording.name)
        for check, count in shown.items():
            if count > SHOWN:
                table.add_row(recording.name, check, f"... and {count - SHOWN} more", "", "", "")
    table.columns[0].overflow = "fold"
    return table


def _row(table: Table, finding: Finding, *, name: str) -> None:
    where = Path(finding.file).name + (f": {finding.field}" if finding.field else "")
    at = "" if finding.timestamp_ns is None else f" (first at {finding.timestamp_ns})"
    table.add_row(
        name,
        Text(finding.severity.value, style=COLOURS[finding.severity]).append(
            f" {finding.check}", style="not bold default"
        ),
        where,
        finding.expected,
        finding.got + at + (f"; {finding.do}" if finding.do else ""),
        str(finding.times),
    )


def _closing(report: ValidationReport, json: Path | None) -> list[str]:
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


def _imported(name: str) -> Adapter:
    module, _, function = name.partition(":")
    if not module or not function:
        raise UsageError(f"--adapter: expected module:function, got {name!r}")
    adapter: Adapter = imported(name, expected=f"--adapter {name}: expected a function")
    return adapter
