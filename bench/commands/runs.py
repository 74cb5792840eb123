"""Runs as commands make, read and print them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from bench.commands.console import FAILURES, note, note_files, print_blocks, print_failures, say
from bench.commands.progress import Report, progress_bar, resumable
from bench.errors import BenchError, UsageError
from bench.plain_text import counted

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

    from bench.evaluation import ObjectMetrics
    from bench.execution import TaskExecutor
    from bench.harness import Provenance, RunRequest, RunSummary, ScoredPart, StoredRun
    from bench.harness.manifest import Manifest
    from bench.harness.run import Finish
    from bench.methods import Scorable
    from bench.recordings import DatasetCard

RUNS = Path("reports/runs")
PROTOCOLS = "paper-v1,surface-v1"  # that a run is scored by where none is named
PURPOSES = {"paper-v1": "the paper's rules", "surface-v1": "the rules of the leaderboard"}
READ_FIRST = ("summary.json", "table.md")


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A stored run by one protocol, as tables of pandas; its files are read when they are asked for.

    Attributes:
        folder: of the results, tables and maps in it; of a part of a run the run's own, without results.
        others: the results by the other protocols that were asked for.
        files: that were written beside the results, those that are read first in front; none of a run that was read.
        remarks: on the data, and why pictures are missing, one line each.
        part: what a part of a run scored; None for a whole run.
    """

    folder: Path
    others: tuple[Run, ...] = ()
    files: tuple[Path, ...] = ()
    remarks: tuple[str, ...] = ()
    part: ScoredPart | None = None

    @cached_property
    def stored(self) -> StoredRun:
        """The run as it lies on disk, with its protocol and its table of sums.

        Raises:
            DataError: missing, damaged, or of a part alone.
        """
        from bench.harness import read_run

        return read_run(self.folder)

    @property
    def last(self) -> Run:
        """The results by the last protocol that was asked for; by default those by which methods are compared."""
        return (self, *self.others)[-1]

    @property
    def manifest(self) -> Manifest:
        """Data, method, protocol and code of the run."""
        return self.stored.manifest

    @property
    def summary(self) -> RunSummary:
        """All metrics with intervals, failures, provenance."""
        return self.stored.summary

    @cached_property
    def metrics(self) -> pd.DataFrame:
        """The table of the run: one row per kind of motion and "all_moving", shares in [0, 1], NaN without cases."""
        import pandas as pd  # 0.3 s, and a command that scores needs none of it

        rows = {**self.summary.categories, "all_moving": self.summary.all_moving}
        return pd.DataFrame.from_dict({name: _row(row) for name, row in rows.items()}, orient="index")

    @cached_property
    def objects(self) -> pd.DataFrame:
        """One row per annotated object and image, whatever its status; columns as in `objects.parquet`."""
        objects: pd.DataFrame = self._tables[0].to_pandas()
        return objects

    @cached_property
    def frames(self) -> pd.DataFrame:
        """One row per image; columns as in `frames.parquet`, without histograms."""
        frames: pd.DataFrame = self._tables[1].to_pandas()
        return frames.dropna(axis="columns", how="all")

    @cached_property
    def _tables(self) -> tuple[pa.Table, pa.Table]:
        from bench.harness import read_tables

        return read_tables(self.folder, histograms=False)

    def flat(self) -> dict[str, float | str]:
        """Metrics, as "crossing.iou", and settings, as "settings.threshold", for a tracker of experiments."""
        from bench.methods.settings import flat_settings

        method = flat_settings(self.manifest.method.settings)
        settings = {f"settings.{name}": str(value) for name, value in method.items()}
        rows = {
            f"{row}.{name}": float(value)
            for row, values in self.metrics.to_dict(orient="index").items()
            for name, value in values.items()
        }
        return {**settings, **rows, "false_positives": self.false_positives}

    @property
    def false_positives(self) -> float:
        """Mean share of the image that is marked wrongly."""
        return self.summary.false_positives.coverage.value


def _row(row: ObjectMetrics) -> dict[str, float]:
    counts = {"object_frames": row.object_frames, "tracks": row.tracks, "recordings": row.recordings}
    return {**counts, **{name: row.metric(name).value for name in row.metric_names()}}


def load_run(folder: str | Path) -> Run:
    """Read a stored run.

    Raises:
        DataError: missing, damaged, or of an unknown version.
    """
    from bench.harness.stored import results_folder

    run = Run(folder=results_folder(Path(folder)))
    _ = run.stored  # damage is told now
    return run


def run_folder(place: str | Path | Run) -> Path:
    """The folder of a run that a user names."""
    return place.folder if isinstance(place, Run) else Path(place)


def run_request(
    dataset: str | Path | DatasetCard,
    method: str | Scorable,
    *,
    settings: Mapping[str, object] | None = None,
    protocol: str | Path = PROTOCOLS,
    split: str | None = None,
    input_errors: Mapping[str, object] | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
) -> RunRequest:
    """The run that is asked for, by names; nothing is rendered or computed yet.

    Args:
        dataset: as of `run`.
        method: as of `run`.
        settings: as of `run`.
        protocol: as of `run`.
        split: as of `run`.
        input_errors: as of `run`.
        out: folder of the run; None for the usual one.
        overwrite: as of `run`.

    Raises:
        UnknownNameError, UsageError, DataError: as `run`; a protocol twice, or a folder of something else.
    """
    from bench.commands.data import as_card
    from bench.evaluation import load_protocol
    from bench.harness import RunRequest, build_scorable
    from bench.harness.exact import require_scorable
    from bench.harness.run import refuse_foreign
    from bench.recordings.input_errors import named_input_errors

    card = as_card(dataset)
    rules = [load_protocol(name) for name in split_protocols(protocol)]
    if len({protocol.name for protocol in rules}) < len(rules):
        raise UsageError(f"expected each protocol once, got {protocol}")
    if isinstance(method, str):
        chosen, named = build_scorable(method, settings), method
    elif settings:
        raise UsageError("settings: expected none beside a method that is built already")
    else:
        chosen = require_scorable(method)
        named = chosen.name
    errors = named_input_errors(input_errors or {})
    changed = [*_non_default_settings(chosen, named), *errors.named.items()]
    folder = default_folder(card, chosen.name, changed, split) if out is None else run_folder(out)
    refuse_foreign(folder)
    return RunRequest(
        card=card,
        method=chosen,
        folder=folder,
        protocols=rules,
        settings=settings or {},
        split=split,
        input_errors=errors,
        overwrite=overwrite,
    )


def split_protocols(protocol: str | Path) -> list[str | Path]:
    """The names and files of protocols with commas in between."""
    return [protocol] if isinstance(protocol, Path) else [name.strip() for name in protocol.split(",")]


def default_folder(card: DatasetCard, method: str, settings: Iterable[tuple[str, object]], split: str | None) -> Path:
    """The folder of a run for which none is given: whatever is not the default is part of its name.

    Args:
        card: the data set.
        method: name of the method.
        settings: those that are not the default, input errors included.
        split: of the data set; None for all.
    """
    words = [card.name, method, *(f"{name}-{value}" for name, value in settings)]
    words += [split] if split is not None else []
    return RUNS / re.sub(r"[^A-Za-z0-9_.-]+", "_", "-".join(words))


def _non_default_settings(method: Scorable, named: str) -> list[tuple[str, object]]:
    """Settings that are not the default; all of a method that cannot be built without any."""
    from bench.harness import build_scorable

    try:
        usual = build_scorable(named).settings()
    except BenchError:
        usual = {}
    return [(name, value) for name, value in method.settings().items() if name not in usual or usual[name] != value]


def score(
    request: RunRequest,
    *,
    executor: TaskExecutor,
    pictures: bool,
    finish: Finish | None = None,
    remarks: Sequence[str] = (),
    progress: Report | None = None,
) -> Run:
    """Score a method and write the report of each protocol beside its results.

    Args:
        request: the run.
        executor: computes.
        pictures: also draw an example frame of every category.
        finish: as of `run_benchmark`, before the report.
        remarks: on the data.
        progress: as of `run`.

    Returns:
        The results by the first protocol.

    Raises:
        DataError: nothing of the data set could be used, or the folder holds another run.
    """
    from bench.harness import run_benchmark
    from bench.reporting.run_tables import write_report_files

    runs: list[Run] = []

    def write(stored: StoredRun) -> None:
        if finish is not None:
            finish(stored)
        files, missing = [stored.folder / READ_FIRST[0], *write_report_files(stored)], list[str]()
        if pictures:
            from bench.reporting.frame_pictures import write_example_pictures  # matplotlib, which no table needs

            with progress_bar("drawing", "pictures") as drawing:
                drawn, missing = write_example_pictures(stored, card=request.card, progress=drawing)
            files += drawn
        files.sort(key=lambda file: file.name not in READ_FIRST)
        missing = [f"no picture: {reason}" for reason in missing]
        runs.append(Run(folder=stored.folder, files=tuple(files), remarks=(*remarks, *missing)))

    title = f"scoring {request.method.name} on {request.card.name}"
    with resumable(request.folder), progress_bar(title, "images", progress) as report:
        run_benchmark(request, executor=executor, progress=report, finish=write)
    return replace(runs[0], others=tuple(runs[1:]))


def print_runs(first: Run) -> int:
    """Print for each protocol the table and what became of the images, then cost, failures, files and what comes next.

    Of a method that failed on every image one line says so.

    Returns:
        The exit status.
    """
    from bench.reporting.document import Paragraph
    from bench.reporting.run_tables import (
        is_rendered,
        legend,
        nothing_scored,
        odd_masks,
        results_table,
        table_rows,
        total_lines,
    )

    runs, images, manifest = (first, *first.others), first.summary.images, first.manifest
    if images.failed and images.failed == images.images - images.skipped:
        say(f"{manifest.method.name} failed on all {counted(images.failed, 'image')}", style="bold red")
        _print_failures(first, first.summary.failures[:1])
        return FAILURES
    for run in runs:
        summary, manifest = run.summary, run.manifest
        for warning in filter(None, (nothing_scored(summary), odd_masks(run.stored), *manifest.dataset.same_data)):
            say(warning, style="bold red")
        purpose = PURPOSES.get(manifest.protocol.name)
        told = manifest.title if purpose is None else f"{manifest.title}, {purpose}"
        rows = table_rows(summary, beside_paper=is_rendered(manifest.dataset.card))
        beside = "; beside the paper" if any(row.paper for row in rows) else ""
        print_blocks([results_table(rows, title=f"{told}{beside}, in percent", short=True)])
        for line in total_lines(summary, run.stored.protocol):
            note(line)
    print_blocks([Paragraph(legend(rows), "dim")])
    print_cost(first.summary.provenance)
    failures = [*dict.fromkeys(failure for run in runs for failure in run.summary.failures)]
    _print_failures(first, failures)
    for run in runs:
        note_files(run.files)
    for remark in dict.fromkeys(remark for run in runs for remark in run.remarks):
        say(remark, style="yellow")
    say(f"next, a page to read: {shlex.join(['fisheye-bench', 'report', str(first.last.folder)])}")
    return FAILURES if failures else 0


def _print_failures(run: Run, failures: Sequence[str]) -> None:
    """Print failures, and the command that shows the traceback of the first that a method raised."""
    print_failures(failures, all_in="summary.json")
    if not any(failure.startswith("method ") for failure in failures):
        return
    for row in run.frames[run.frames["status"] == "failed"][:1].to_dict("records"):
        place = ["--recording", row["recording"], "--camera", row["camera"], "--time-ns", str(row["timestamp_ns"])]
        words = ["fisheye-bench", "-v", "view", run.manifest.dataset.card, *run.manifest.method.options(), *place]
        say(f"the traceback of the first: {shlex.join(words)}")


def print_cost(made: Provenance) -> None:
    """Print what a run had to compute, and the time and memory that it took."""
    from bench.reporting.run_tables import cost_lines

    for line in cost_lines(made):
        note(line)
