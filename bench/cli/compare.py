"""`compare`: paired differences between runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli.console import note_files, say, show
from bench.cli.progress import progress_bar

RUNS = Path("reports/runs")


def compare(
    runs: Annotated[list[str], typer.Argument(help="Folders of stored runs; the first is compared against.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder of the comparison; default: reports/runs/compare-<run>-<run>.")
    ] = None,
    pictures: Annotated[bool, typer.Option(help="Draw the frames that changed most, from the data set.")] = True,
) -> None:
    """Compare runs in pairs: differences with intervals, object-frames gained and lost, pictures of the biggest."""
    from bench.api.runs import run_folder
    from bench.reporting.compare.changes import verdict_line
    from bench.reporting.compare.writing import terminal_report, write_comparison

    places = [run_folder(run) for run in runs]
    folder = out or RUNS / f"compare-{'-'.join(run.resolve().name for run in places)}"
    with progress_bar("drawing what changed", "pictures") as report:
        comparisons, files = write_comparison(places, folder, pictures=pictures, progress=report)
    for comparison in comparisons:
        show(terminal_report(comparison))
        counts = comparison.detections.iloc[-1]
        say(f"{counts.object_frames} object-frames, detected: {counts.before} before, {counts.after} after; "
             f"{counts.gained} newly detected, {counts.lost} newly missed")  # fmt: skip
        for told in comparison.notes:
            say(told)
        say(verdict_line(comparison), style="bold")
    for comparison in comparisons:
        for remark in comparison.remarks:
            say(remark, style="red")
    note_files(files)
