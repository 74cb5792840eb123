"""What a page is made of: the stored results of a run, or those of one kind of motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bench.evaluation import Protocol, RowSource, Summary, summarise
from bench.evaluation.row_source import ChosenRows
from bench.harness import RunSummary, open_tables, read_protocol, read_run
from bench.reference import Category


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageSource:
    """Everything that is stored.

    Attributes:
        folder: of the run.
        run: its summary.
        protocol: its rules.
        category: the page's slice; None for all.
        figures: of the slice; the run's own without one.
        objects: rows of the slice, on disk.
        frames: every image, on disk.
    """

    folder: Path
    run: RunSummary
    protocol: Protocol
    category: Category | None
    figures: Summary
    objects: RowSource
    frames: RowSource


def read_source(folder: Path, *, category: Category | None = None) -> PageSource:
    """Read a run.

    Raises:
        DataError: a stored result is missing or damaged, or the files are not of one run.
    """
    run = read_run(folder)
    protocol = read_protocol(folder, run)
    stored, frames = open_tables(folder)
    objects: RowSource = stored
    figures: Summary = run
    if category is not None:
        objects = ChosenRows(stored, column="category", word=category.value)
        figures = summarise(objects, frames, protocol=protocol)
    return PageSource(
        folder=folder,
        run=run,
        protocol=protocol,
        category=category,
        figures=figures,
        objects=objects,
        frames=frames,
    )
