"""`validate`: what looks wrong in a data set, or in what an adapter gives."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands.console import print_blocks, say
from bench.commands.options import Split
from bench.commands.progress import Report, progress_bar
from bench.errors import UsageError
from bench.plain_text import counted

if TYPE_CHECKING:
    from bench.recordings import DatasetCard
    from bench.recordings.catalogue import Adapter
    from bench.validation import ValidationReport


def validate(
    dataset: str | Path | DatasetCard,
    *,
    split: str | None = None,
    recording: str | None = None,
    deep: bool = False,
    progress: Report | None = None,
) -> ValidationReport:
    """Validate a data set, as `fisheye-bench validate` does; what a scenario has rendered is validated as it is.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        split: of the data set; None for all of it.
        recording: only the one of this name; None for all.
        deep: read every image and sweep, not a sample.
        progress: called with the recordings done, fractions allowed, and their number.

    Returns:
        What looks wrong: `findings`, their numbers `errors` and `warnings`, and `recordings`, which say what was read.

    Raises:
        UnknownNameError: no data set, split or recording of this name.
        DataError: the card cannot be used; what is wrong with a recording is a finding.
    """
    from bench.commands.data import rendered_card
    from bench.errors import UnknownNameError
    from bench.recordings import open_dataset
    from bench.validation import Depth, validate_dataset

    card = rendered_card(dataset, split, as_it_is=True)
    handles = open_dataset(card, split)
    if recording is not None:
        names = [handle.name for handle in handles]
        if recording not in names:
            raise UnknownNameError("recording", recording, names)
        handles = (handles[names.index(recording)],)
    depth = Depth.DEEP if deep else Depth.SAMPLED
    with progress_bar(f"validating {card.name}", "recordings", progress) as report:
        return validate_dataset(card.name, handles, depth=depth, progress=report)


def command(
    dataset: Annotated[str, typer.Argument(help="Data-set card; with --adapter a folder of data.")],
    split: Split = None,
    recording: Annotated[str | None, typer.Option(help="Name of a recording; default: all.")] = None,
    deep: Annotated[bool, typer.Option("--deep", help="Read every image and sweep instead of a sample.")] = False,
    errors_only: Annotated[bool, typer.Option("--errors-only", help="Exit with 0 if there are only warnings.")] = False,
    json: Annotated[Path | None, typer.Option(help="Write all findings as JSON to this file.")] = None,
    adapter: Annotated[
        str | None, typer.Option(help="Check your adapter, MODULE:FUNCTION, against the contract.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="With --adapter: an option of the adapter.")
    ] = None,
) -> int:
    """List what looks wrong in a data set; exit status 0 nothing, 1 something, 2 usage or data error."""
    if adapter is not None:
        passed = _keeps_contract(adapter, Path(dataset), settings=set_)
    else:
        passed = _looks_right(dataset, split=split, recording=recording, deep=deep, errors_only=errors_only, json=json)
    return 0 if passed else 1


def _looks_right(
    dataset: str, *, split: str | None, recording: str | None, deep: bool, errors_only: bool, json: Path | None
) -> bool:
    from bench.atomic import write_output
    from bench.validation import Severity

    report = validate(dataset, split=split, recording=recording, deep=deep)
    print_findings(report)
    if json is not None:
        write_output(json, report.as_json())
        say(str(json))
    return not (report.count(Severity.ERROR) if errors_only else report.findings)


def print_findings(report: ValidationReport) -> None:
    """Print what looks wrong in a data set."""
    from bench.reporting.findings import findings_report

    print_blocks(findings_report(report))


def _keeps_contract(name: str, root: Path, *, settings: list[str] | None) -> bool:
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
    outcome = f"breaks {counted(len(faults), 'promise')} of" if faults else "keeps"
    say(f"{name} {outcome} the contract of adapters")
    return not faults
