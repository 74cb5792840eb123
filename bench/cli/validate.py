"""`validate`: what looks wrong in a data set, or in what an adapter gives."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli.console import say, show
from bench.cli.options import Split
from bench.cli.progress import progress_bar
from bench.errors import UsageError

if TYPE_CHECKING:
    from bench.recordings import DatasetCard, RecordingHandle
    from bench.recordings.catalogue import Adapter
    from bench.validation import Depth, ValidationReport


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
        passed = validate_adapter(adapter, Path(dataset), settings=set_)
    else:
        passed = validate_recordings(dataset, split=split, deep=deep, errors_only=errors_only, json=json)
    if not passed:
        raise typer.Exit(1)


def validate_recordings(dataset: str, *, split: str | None, deep: bool, errors_only: bool, json: Path | None) -> bool:
    """Validate a data set, print what is wrong with it; whether it passed."""
    from bench.atomic import write_text
    from bench.cli.request import render_if_synthetic
    from bench.recordings import load_card, open_dataset
    from bench.validation import Depth, Severity

    card = load_card(dataset)
    if card.scenario is not None and card.remote_root is None and not card.root.is_dir():
        render_if_synthetic(card, split)  # what is there is validated as it is
    report = show_findings(card, open_dataset(card, split), Depth.DEEP if deep else Depth.SAMPLED)
    if json is not None:
        write_text(json, report.as_json())
        say(str(json))
    return not (report.count(Severity.ERROR) if errors_only else report.findings)


def show_findings(card: DatasetCard, handles: Sequence[RecordingHandle], depth: Depth) -> ValidationReport:
    """Validate recordings of a data set and print what is wrong with them."""
    from bench.reporting.findings import findings_report
    from bench.validation import validate_dataset

    with progress_bar(f"validating {card.name}", "recordings") as progress:
        report = validate_dataset(card.name, handles, depth=depth, progress=progress)
    show(findings_report(report))
    return report


def validate_adapter(name: str, root: Path, *, settings: list[str] | None) -> bool:
    """Run the contract test on an adapter, print the promises that it breaks; whether it keeps them all."""
    from bench.methods.settings import parse_settings
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
    outcome = f"breaks {len(faults)} promises of" if faults else "keeps"
    say(f"{name} {outcome} the contract of adapters")
    return not faults
