"""`reference`: what a protocol counts in each image, as files for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands import options
from bench.commands.command import PATH, add_command, group
from bench.commands.console import FAILURES, Report, note, progress_bar, say

if TYPE_CHECKING:
    from bench.harness.reference_export import ReferenceExport

app = group("Export the reference as label images and JSON, to train and score with other tools.")


def export_reference(
    dataset: options.Dataset,
    out: Annotated[str | Path, typer.Option(), PATH],
    *,
    protocol: options.Protocol = "surface-v1",
    split: options.Split = None,
    workers: options.Workers = 1,
    progress: Report | None = None,
) -> ReferenceExport:
    """Write the reference of each image: pixels of objects, unknown bands and ignored areas, and a list of the objects.

    Args:
        dataset: card, by path or by name.
        out: folder, new or empty, written whole or not at all; docs/your-data.md lists its files.
        protocol: by name or file.
        split: of the data set, or recordings with commas in between.
        workers: processes, or an executor, that compute the recordings.
        progress: called with the recordings done and their number.

    Returns:
        The export, with one line for each image that has no reference.

    Raises:
        UnknownNameError: no data set, protocol or split of this name.
        DataError: the folder holds something, or a recording cannot be opened.

    Examples:
        fisheye-bench reference export demo --out my-references
    """
    from bench.atomic import refuse_filled
    from bench.evaluation.protocol import load_protocol
    from bench.harness.reference_export import export_references

    executor, rules = options.as_executor(workers), load_protocol(protocol)
    refuse_filled(Path(out))
    card = options.rendered_card(dataset, split, executor=executor)
    with progress_bar(f"exporting the reference of {card.name}", "recordings", progress) as report:
        return export_references(card, protocol=rules, out=Path(out), split=split, executor=executor, progress=report)


def show(export: ReferenceExport) -> int:
    """Print the folder, and which images have no reference."""
    say(str(export.folder))
    for problem in export.problems:
        note(f"no reference: {problem}")
    return FAILURES if export.problems else 0


add_command(app, "export", export_reference, show)
