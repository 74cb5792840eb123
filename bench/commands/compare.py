"""`compare`: paired differences between runs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands.command import TEXT, Flag, Words
from bench.commands.console import Report, note_files, print_blocks, progress_bar, say
from bench.commands.run import Run, run_folder
from bench.plain_text import counted

if TYPE_CHECKING:
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
        str | Path | Run,
        typer.Argument(
            help="Folders of two or more runs; each is compared with the first. A run's folder stands for its results "
            "by surface-v1."
        ),
        TEXT,
    ],
    out: Annotated[str | Path | None, typer.Option(show_default=False), Words(Path, default=USUAL)] = None,
    pictures: Flag = True,
    progress: Report | None = None,
) -> Comparison:
    """Compare runs in pairs: differences with intervals, object-frames gained and lost, pictures of the largest.

    Args:
        runs: stored runs or their folders, two or more.
        out: folder of the report; default: reports/runs/compare-<run>-<run>; from Python no report is written.
        pictures: draw the images that changed most; needs the data set.
        progress: called with the pictures done and their number, for each pair anew.

    Raises:
        DataError: a run is missing or damaged.
        UsageError: fewer than two runs, or runs that do not compare, as of other data or by another protocol.

    Examples:
        fisheye-bench compare reports/runs/demo-spherical reports/runs/demo-frame-difference
    """
    from bench.harness.stored import run_name
    from bench.reporting.compare import compare_runs, write_comparison

    folders = [run_folder(run) for run in runs]
    if out is None:
        return Comparison(pairs=tuple(compare_runs(folders)))
    if out == USUAL:
        out = USUAL.with_name(f"compare-{'-'.join(map(run_name, folders))}")
    with progress_bar("drawing what changed", "pictures", progress) as drawn:
        pairs, files = write_comparison(folders, Path(out), pictures=pictures, progress=drawn)
    return Comparison(pairs=tuple(pairs), files=files)


def show(compared: Comparison) -> None:
    """Print the verdict on each pair, its differences and what was gained and lost, then the files."""
    from bench.reporting.compare import terminal_report, verdict_line
    from bench.reporting.formats import found_by

    for comparison in compared.pairs:
        say(verdict_line(comparison), style="bold")
        print_blocks(terminal_report(comparison))
        counts = comparison.detections.iloc[-1]
        found = f"detected by {found_by(comparison.before.protocol)}"
        say(f"{counted(counts.object_frames, 'object-frame')}, {found}: {counts.before} before, {counts.after} after; "
             f"{counts.gained} newly detected, {counts.lost} newly missed")  # fmt: skip
        for told in comparison.notes:
            say(told)
    for comparison in compared.pairs:
        for remark in comparison.remarks:
            say(remark, style="red")
    note_files(compared.files)
