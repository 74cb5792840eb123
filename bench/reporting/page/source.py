"""What a page is made of: the stored results of a run, or those of one kind of motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from bench.evaluation import Protocol, Summary, summarise
from bench.harness import RunSummary, read_run, read_tables
from bench.reference import Category
from bench.reporting.write import read_rules


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageSource:
    """Everything that is stored.

    Attributes:
        folder: of the run.
        run: its summary.
        protocol: its rules.
        category: the page's slice; None for all.
        figures: of the slice; the run's own without one.
        objects: rows of the slice.
        frames: every image.
    """

    folder: Path
    run: RunSummary
    protocol: Protocol
    category: Category | None
    figures: Summary
    objects: pa.Table
    frames: pa.Table


def read_source(folder: Path, *, category: Category | None = None) -> PageSource:
    """Read a run.

    Raises:
        DataError: a stored result is missing or damaged, or the files are not of one run.
    """
    run = read_run(folder)
    protocol = read_rules(folder, run)
    objects, frames = read_tables(folder)
    figures: Summary = run
    if category is not None:
        objects = objects.filter(pc.equal(objects["category"], category.value))
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
