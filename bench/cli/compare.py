"""`compare`: paired differences between runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli.console import note_files, say, show
from bench.cli.progress import progress_bar


def compare(
    runs: Annotated[list[str], typer.Argument(help="Folders of stored runs; the first is compared against.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder of the comparison; default: reports/runs/compare-<run>-<run>.")
    ] = None,
    pictures: Annotated[bool, typer.Option(help="Draw the frames that changed most, from the data set.")] = True,
) -> None:
    """Compare runs in pairs: differences with intervals, object-frames gained and lost, pictures of the biggest."""
    from bench.api.compare import compare
    from bench.api.runs import RUNS, run_folder
    from bench.reporting.compare.changes import verdict_line
    from bench.reporting.compare.writing import terminal_report

    folder = out or RUNS / f"compare-{'-'.join(run_folder(run).resolve().name for run in runs)}"
    with progress_bar("drawing what changed", "pictures") as progress:
        found = compare(*runs, out=folder, pictures=pictures, progress=progress)
    for comparison in found.pairs:
        show(terminal_report(comparison))
        counts = comparison.detections.iloc[-1]
        say(f"{counts.object_frames} object-frames, detected: {counts.before} before, {counts.after} after; "
             f"{counts.gained} newly detected, {counts.lost} newly missed")  # fmt: skip
        for told in comparison.notes:
            say(told)
        say(verdict_line(comparison), style="bold")
    for comparison in found.pairs:
        for remark in comparison.remarks:
            say(remark, style="red")
    note_files(found.files)
