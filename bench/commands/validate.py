"""`validate`: what looks wrong in a data set."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.commands.command import Flag, Place
from bench.commands.console import Report, print_blocks, progress_bar, say
from bench.commands.options import Dataset, Split, rendered_card

if TYPE_CHECKING:
    from bench.validation.report import ValidationReport


def validate(
    dataset: Dataset, *, split: Split = None, deep: Flag = False, progress: Report | None = None
) -> ValidationReport:
    """List what looks wrong in a data set; exit status 0 nothing, 1 something, 2 usage or data error.

    Rendered drives are validated as they are, not rendered again.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        split: of the data set, or recordings with commas in between; None for all of it.
        deep: read every image and sweep instead of a sample.
        progress: called with the recordings done, fractions allowed, and their number.

    Returns:
        What looks wrong: `findings`, their numbers `errors` and `warnings`, and `recordings`, which say what was read.

    Raises:
        UnknownNameError: no data set, split or recording of this name.
        DataError: the card cannot be used; what is wrong with a recording is a finding.

    Examples:
        fisheye-bench validate my-data --deep --json findings.json
    """
    from bench.recordings import open_dataset
    from bench.validation.report import validate_dataset

    card = rendered_card(dataset, split, as_it_is=True)
    with progress_bar(f"validating {card.name}", "recordings", progress) as report:
        return validate_dataset(card.name, open_dataset(card, split), deep=deep, progress=report)


def show(report: ValidationReport, *, errors_only: Flag = False, json: Place = None) -> int:
    """Print the findings; 1 where there are some.

    Args:
        report: the findings.
        errors_only: exit with 0 if there are only warnings.
        json: write all findings as JSON to this file.
    """
    from pathlib import Path

    from bench.atomic import write_output
    from bench.reporting.findings import findings_report

    print_blocks(findings_report(report))
    if json is not None:
        write_output(Path(json), report.as_json())
        say(str(json))
    return 1 if (report.errors if errors_only else report.findings) else 0
