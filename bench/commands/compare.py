"""`compare`: paired differences between runs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands.command import TEXT, Words
from bench.commands.console import note_files, print_blocks, say
from bench.commands.progress import Report, progress_bar

if TYPE_CHECKING:
    from bench.commands.runs import Run
    from bench.reporting.compare import RunComparison

USUAL = Path("reports/runs/compare-<run>-<run>")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """Runs against the first of them.

    Attributes:
        pairs: the first run with each of the others: `changes`, the metrics of both with difference, interval, p-value
            and verdict, and `detections` and `frames`, what was gained and lost, are tables of pandas.
        files: that were written.
    """

    pairs: tuple[RunComparison, ...]
    files: tuple[Path, ...] = ()


def compare(
    *runs: Annotated[
        str | Path | Run, typer.Argument(help="Folders of stored runs; each is compared with the first."), TEXT
    ],
    out: Annotated[
        str | Path | None,
        typer.Option(help="Folder; default: reports/runs/compare-<run>-<run>.", show_default=False),
        Words(Path, default=USUAL),
    ] = None,
    pictures: Annotated[bool, typer.Option(help="Draw the images that changed most; needs the data set.")] = True,
    progress: Report | None = None,
) -> Comparison:
    """Compare runs in pairs: differences with intervals, object-frames gained and lost, pictures of the largest.

    Args:
        runs: two or more, stored or by their folders.
        out: folder of the report; None writes none.
        pictures: into the report.
        progress: called with the pictures done and their number, for each pair anew.

    Raises:
        DataError: a run is missing or damaged.
        UsageError: fewer than two runs, or runs that do not compare, as of other data or by another protocol.
    """
    from bench.commands.runs import run_folder
    from bench.harness.stored import results_folder, run_name
    from bench.reporting.compare import compare_runs, read_comparable, write_comparison

    folders = [run_folder(run) for run in runs]
    if out is None:
        return Comparison(pairs=tuple(compare_runs(read_comparable(folders))))
    if out == USUAL:
        out = USUAL.with_name(f"compare-{'-'.join(run_name(results_folder(folder)) for folder in folders)}")
    with progress_bar("drawing what changed", "pictures", progress) as drawn:
        pairs, files = write_comparison(folders, Path(out), pictures=pictures, progress=drawn)
    return Comparison(pairs=tuple(pairs), files=files)


def show(compared: Comparison) -> None:
    """Print differences, verdict and what was gained and lost of each pair, then the files."""
    from bench.reporting.compare import terminal_report, verdict_line
    from bench.reporting.formats import found_by

    for comparison in compared.pairs:
        print_blocks(terminal_report(comparison))
        counts = comparison.detections.iloc[-1]
        found = f"detected by {found_by(comparison.before.protocol)}"
        say(f"{counts.object_frames} object-frames, {found}: {counts.before} before, {counts.after} after; "
             f"{counts.gained} newly detected, {counts.lost} newly missed")  # fmt: skip
        for told in comparison.notes:
            say(told)
        say(verdict_line(comparison), style="bold")
    for comparison in compared.pairs:
        for remark in comparison.remarks:
            say(remark, style="red")
    note_files(compared.files)
