"""The page of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bench.api.runs import Run, run_folder
from bench.errors import UnknownNameError
from bench.harness.stages import Progress
from bench.reference import Category
from bench.reporting.page.build import write_page
from bench.reporting.page.charts import write_figures


@dataclass(frozen=True, slots=True, kw_only=True)
class RunPage:
    """The page of a run.

    Attributes:
        files: the page first, then its charts as files of their own.
        problems: why pictures are missing, one line each.
    """

    files: tuple[Path, ...]
    problems: tuple[str, ...]


def report(
    run: str | Path | Run,
    *,
    category: str | None = None,
    beside: str | Path | Run | None = None,
    out: str | Path | None = None,
    pictures: bool = True,
    progress: Progress | None = None,
) -> RunPage:
    """Write one page to read, from disk and without a network, as `fisheye-bench report` does.

    Args:
        run: stored, or its folder.
        category: only this kind of motion, for example "preceding"; None for all.
        beside: another run of the same data and protocol, to show both on the same images; None for none.
        out: the file; None for `index.html`, or `index-<category>.html`, beside its results.
        pictures: draw the worst frames, from the data set.
        progress: called with the pictures done and their number.

    Raises:
        UnknownNameError: no such kind of motion.
        DataError: a run is missing or damaged.
        UsageError: `beside` does not compare.
    """
    if category is not None and category not in set(Category):
        raise UnknownNameError("category", category, (known.value for known in Category))
    folder, kind = run_folder(run), None if category is None else Category(category)
    page = write_page(
        folder,
        category=kind,
        out=None if out is None else Path(out),
        other=None if beside is None else run_folder(beside),
        pictures=pictures,
        progress=progress,
    )
    files = (page.file, *write_figures(folder, category=kind))
    return RunPage(files=files, problems=page.problems)
