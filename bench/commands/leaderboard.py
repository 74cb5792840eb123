"""`leaderboard`: the runs of a folder on one page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands.command import PATH, Place
from bench.commands.console import FAILURES, note_files, print_blocks, say
from bench.commands.run import RUNS

if TYPE_CHECKING:
    from bench.reporting.leaderboard import Leaderboard


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LeaderboardReport:
    """All runs of a folder, ranked.

    Attributes:
        found: `groups` of runs that compare, each with its `entries`, best first; the other runs are `not_ranked`.
        files: that were written, the page first.
    """

    found: Leaderboard
    files: tuple[Path, ...] = ()


def leaderboard(
    folder: Annotated[str | Path, typer.Argument(), PATH] = RUNS, *, out: Place = None
) -> LeaderboardReport:
    """Rank the runs of a folder, one table for each group of comparable runs.

    Rows that ship with the package are added where they can be compared.

    Args:
        folder: folder with runs at any depth.
        out: also write a page and tables into this folder.

    Raises:
        DataError: there is no folder, or no run in it.

    Examples:
        fisheye-bench leaderboard reports/runs --out my-page
    """
    from bench.recordings.cards import shipped_folder
    from bench.reporting.leaderboard import read_leaderboard, with_shipped, write_leaderboard

    found, shipped = read_leaderboard(Path(folder)), shipped_folder("leaderboard")
    if out is None or Path(out).resolve() != shipped.resolve():  # what is written there is what ships
        found = with_shipped(found, shipped / "leaderboard.json")
    return LeaderboardReport(found=found, files=() if out is None else write_leaderboard(found, Path(out)))


def show(ranked: LeaderboardReport) -> int:
    """Print the tables, which runs are in none and why, and the files."""
    from bench.reporting.leaderboard import leaderboard_tables

    print_blocks(leaderboard_tables(ranked.found))
    for run, reason in ranked.found.not_ranked:
        say(f"not ranked: {run}: {reason}", style="red")
    note_files(ranked.files)
    return FAILURES if ranked.found.not_ranked else 0
