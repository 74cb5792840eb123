"""A run as it is stored, which every report is made of."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pandas as pd

from bench.evaluation import Protocol, Summary, headlines, read_sums, sum_run, summary_of
from bench.evaluation.rows import ChosenRows, RowSource
from bench.evaluation.sums import ALL_MOVING, FRAMES
from bench.harness import RunSummary, open_tables, read_protocol, read_run, run_name
from bench.harness.stored import SUMS
from bench.reference import Category


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredRun:
    """A run on disk, or its object-frames of one kind of motion.

    Attributes:
        folder: of the run.
        label: what tables call it: the folder's name, with a number where two are the same.
        summary: `summary.json`, of all categories.
        protocol: of the run.
        category: of the object-frames; None for all.
        all_rows: whether the rows are all of the run's, and its metrics those of `summary`.
        objects: of `OBJECTS_SCHEMA`, on disk, of this category, on all images or those that are compared.
        frames: of `FRAMES_SCHEMA`, on all images or those that are compared.
        sums: table of sums of these rows; `sums.csv` for all of them.
    """

    folder: Path
    label: str
    summary: RunSummary
    protocol: Protocol
    category: Category | None
    all_rows: bool
    objects: RowSource
    frames: RowSource
    sums: pd.DataFrame

    @cached_property
    def metrics(self) -> Summary:
        """All metrics of these rows, taken from their sums when they are asked for."""
        return self.summary if self.all_rows else summary_of(self.sums, protocol=self.protocol)


def read_stored_run(folder: Path, *, label: str | None = None, category: Category | None = None) -> StoredRun:
    """Read a run.

    Raises:
        DataError: a file of it is missing or damaged, or the files are not of one run.
    """
    summary = read_run(folder)
    protocol = read_protocol(folder, summary)
    objects, frames = open_tables(folder)
    chosen: RowSource = (
        objects if category is None else ChosenRows(source=objects, column="category", word=category.value)
    )
    sums = read_sums(folder / SUMS) if category is None else sum_run(chosen, frames, protocol=protocol)
    return StoredRun(
        folder=folder,
        label=label or run_name(folder),
        summary=summary,
        protocol=protocol,
        category=category,
        all_rows=category is None,
        objects=chosen,
        frames=frames,
        sums=sums,
    )


def recording_values(sums: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The headline metrics of each recording, over all its moving objects and its whole images.

    Args:
        sums: of a run.

    Returns:
        values: a row for each recording and a column for each metric, ratios; NaN without cases.
        cases: the same of their numbers, 0 without.
    """
    names = [metric.name for metric in headlines()]
    rows = sums[sums["breakdown"].isin([ALL_MOVING, FRAMES]) & sums["metric"].isin(names)]
    terms = [
        rows.pivot_table(term, index="recording", columns="metric", dropna=False, observed=True)
        for term in ("numerator", "denominator")
    ]
    values, cases = terms[0] / terms[1], terms[1]
    return values.reindex(columns=names), cases.reindex(columns=names).fillna(0)


def pick(parts: Iterable[pd.DataFrame], choose: Callable[[pd.DataFrame], pd.DataFrame]) -> pd.DataFrame:
    """Return the few rows that are chosen of all parts, with one part in memory at a time.

    Args:
        parts: at least one, in the order of their key, so that a stable sort leaves equals in it.
        choose: of the rows that were chosen before and those of the next part.
    """
    found: pd.DataFrame | None = None
    for part in parts:
        found = choose(part if found is None else pd.concat([found, part], ignore_index=True))
    assert found is not None, "there is at least one part"
    return found
