"""`run`: the main job, data set in, table out; and runs as other commands make, read and print them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands import console, options
from bench.commands.command import TEXT, Flag
from bench.commands.console import Report
from bench.errors import UsageError
from bench.plain_text import counted

if TYPE_CHECKING:
    import pandas as pd

    from bench.evaluation.summary import ObjectMetrics
    from bench.execution import TaskExecutor
    from bench.harness.manifest import Manifest
    from bench.harness.run import RunRequest, ScoredPart
    from bench.harness.stored import RunSummary, StoredRun
    from bench.methods import Scorable
    from bench.recordings import DatasetCard

RUNS = Path("reports/runs")
PROTOCOLS = "surface-v1,paper-v1"  # that a run is scored by where none is named
PURPOSES = {"paper-v1": "the paper's rules", "surface-v1": "the rules of the leaderboard"}
RunFolder = Annotated[str | Path | None, typer.Option(metavar="FOLDER"), TEXT]


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A stored run by one protocol, as tables of pandas; its files are read when they are asked for.

    Attributes:
        folder: of the results; of a part of a run the run's own, without results.
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
        from bench.harness.stored import read_run

        return read_run(self.folder)

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
        return self.stored.objects()

    @cached_property
    def frames(self) -> pd.DataFrame:
        """One row per image; columns as in `frames.parquet`, without histograms."""
        return self.stored.frames().dropna(axis="columns", how="all")

    @property
    def false_positives(self) -> float:
        """Mean share of the image that is marked wrongly."""
        return self.summary.false_positives.coverage.value


NamedRun = Annotated[
    str | Path | Run,
    typer.Argument(help="Folder of a run (its results by surface-v1), or of one protocol in it."),
    TEXT,
]


def _row(row: ObjectMetrics) -> dict[str, float]:
    counts = {"object_frames": row.object_frames, "tracks": row.tracks, "recordings": row.recordings}
    return {**counts, **{name: row.metric(name).value for name in row.metric_names()}}


def load_run(folder: str | Path) -> Run:
    """Read a stored run; its folder stands for the results by surface-v1, or for the only ones.

    Raises:
        DataError: missing, damaged, or of an unknown version.
    """
    from bench.harness.stored import results_folder

    run = Run(folder=results_folder(Path(folder)))
    _ = run.stored  # damage is told now
    return run


def run_folder(place: str | Path | Run) -> Path:
    """The folder of results that a user names.

    Raises:
        DataError: there are none, or none by surface-v1 and several others.
    """
    from bench.harness.stored import results_folder

    return place.folder if isinstance(place, Run) else results_folder(Path(place))


def run(
    dataset: options.Dataset,
    method: options.MethodName = "spherical",
    *,
    settings: options.Settings = None,
    input_errors: options.InputErrors = None,
    protocol: options.Protocols = PROTOCOLS,
    split: options.Split = None,
    out: RunFolder = None,
    overwrite: Flag = False,
    pictures: Flag = True,
    workers: options.Workers = 1,
    shard: Annotated[str | None, typer.Option(metavar="I/N")] = None,
    progress: Report | None = None,
) -> Run:
    """Score a method on a data set; write tables and pictures.

    An interrupted run continues with the same command. The method is asked once, whatever the
    number of protocols.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        method: by name, as "module:Class", or an object of a class that derives from `bench.methods.Method`.
        settings: parameters of a method that is given by name.
        input_errors: injected into what the method is given, by the names of `bench.records.recording.InputErrors`, for
            example `{"pitch_deg": 0.5}`; the reference does not change.
        protocol: names or files with commas in between.
        split: of the data set; None for all of it.
        out: folder of the run; default: reports/runs/<data set>-<method>, with the settings that are given.
        overwrite: replace a different run in the folder.
        pictures: draw an example image of every category.
        workers: processes, or an executor, of `bench.execution` or any of `concurrent.futures`. More than one need a
            method that can be imported, not one of a notebook's cell, and in a program `if __name__ == "__main__":`
            around the call.
        shard: score only part I of N; the same command without it finishes the run.
        progress: called with the images done and their number.

    Returns:
        The results by the first protocol; `others` are those by the others.

    Raises:
        UnknownNameError: no data set, method, protocol, split or input error of this name.
        UsageError: settings that the method does not take, or beside an object; an input error that is no number.
        DataError: nothing of the data set could be used, or `out` holds another run.

    Examples:
        fisheye-bench run demo
        fisheye-bench run tiny --method my_method:MyMethod --set threshold=0.5 --protocol surface-v1
    """
    from bench.harness.run import parse_part, run_benchmark

    request = run_request(
        dataset,
        method,
        settings=settings,
        input_errors=input_errors,
        protocol=protocol,
        split=split,
        out=out,
        overwrite=overwrite,
    )
    part, executor = None if shard is None else parse_part(shard), options.as_executor(workers)
    options.rendered_card(request.card, request.split, executor=executor)
    if part is None:
        hint = f"a run does not validate its data; check them with: fisheye-bench validate {request.card.address}"
        remarks = [hint] if request.card.scenario is None else []
        return score(request, executor=executor, pictures=pictures, remarks=remarks, progress=progress)
    title = f"scoring part {shard} of {request.card.name}"
    with console.resumable(request.folder), console.progress_bar(title, "images", progress) as report:
        return Run(folder=request.folder, part=run_benchmark(request, part=part, executor=executor, progress=report))


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
    """The run that is asked for, by names, as of `run`; nothing is rendered or computed yet.

    Raises:
        UnknownNameError, UsageError, DataError: as `run`; a protocol twice, or a folder of something else.
    """
    from bench.evaluation.protocol import load_protocol
    from bench.harness.exact import build_scorable, require_scorable
    from bench.harness.run import RunRequest, refuse_foreign
    from bench.methods.settings import flat_settings
    from bench.recordings.input_errors import named_input_errors

    card, given = options.as_card(dataset), settings or {}
    names = [protocol] if isinstance(protocol, Path) else [name.strip() for name in protocol.split(",")]
    rules = [load_protocol(name) for name in names]
    if len({protocol.name for protocol in rules}) < len(rules):
        raise UsageError(f"expected each protocol once, got {protocol}")
    if given and not isinstance(method, str):
        raise UsageError("settings: expected none beside a method that is built already")
    chosen = build_scorable(method, settings) if isinstance(method, str) else require_scorable(method)
    errors = named_input_errors(input_errors or {})
    if out is None:
        out = default_folder(card, chosen.name, [*flat_settings(given).items(), *errors.named.items()], split)
    refuse_foreign(Path(out))
    return RunRequest(
        card=card,
        method=chosen,
        folder=Path(out),
        protocols=rules,
        settings=given,
        split=split,
        input_errors=errors,
        overwrite=overwrite,
    )


def default_folder(card: DatasetCard, method: str, given: Iterable[tuple[str, object]], split: str | None) -> Path:
    """The folder of a run for which none is named: whatever else is given is part of its name.

    Args:
        card: the data set.
        method: name of the method.
        given: settings and input errors, by name.
        split: of the data set; None for all.
    """
    words = [card.name, method, *(f"{name}-{value}" for name, value in given)]
    words += [split] if split is not None else []
    return RUNS / re.sub(r"[^A-Za-z0-9_.-]+", "_", "-".join(words))


def score(
    request: RunRequest,
    *,
    executor: TaskExecutor,
    pictures: bool,
    remarks: Sequence[str] = (),
    progress: Report | None = None,
) -> Run:
    """Score a method and write the report of each protocol beside its results.

    Args:
        request: the run.
        executor: computes.
        pictures: also draw an example frame of every category.
        remarks: on the data.
        progress: as of `run`.

    Returns:
        The results by the first protocol.

    Raises:
        DataError: nothing of the data set could be used, or the folder holds another run.
    """
    from bench.harness.run import run_benchmark
    from bench.harness.stored import SUMMARY
    from bench.reporting.run_tables import write_report_files

    title = f"scoring {request.method.name} on {request.card.name}"
    runs: list[Run] = []
    with console.resumable(request.folder):
        with console.progress_bar(title, "images", progress) as report:
            results = run_benchmark(request, executor=executor, progress=report).results
        for stored in results:
            files, missing = [stored.folder / SUMMARY, *write_report_files(stored)], list[str]()
            if pictures:
                from bench.reporting.frame_pictures import write_example_pictures  # matplotlib, which no table needs

                with console.progress_bar("drawing", "pictures") as drawing:
                    drawn, missing = write_example_pictures(stored, card=request.card, progress=drawing)
                files += drawn
            told = (*remarks, *(f"no picture: {reason}" for reason in missing))
            runs.append(Run(folder=stored.folder, files=tuple(files), remarks=told))
    return replace(runs[0], others=tuple(runs[1:]))


def show(scored: Run) -> int:
    """Print the run, or what was done of a part of one."""
    from bench.reporting.run_tables import cost_lines

    part = scored.part
    if part is None:
        return print_runs(scored)
    of_part = f"{part.done} of {counted(part.tasks, 'task')} of this part done in {scored.folder}"
    console.say(f"{of_part}, of {part.tasks_of_run} in all")
    console.say("next, when all parts are done: the same command without --shard")
    for line in cost_lines(part.provenance):
        console.note(line)
    console.print_failures(part.failures, all_in="the summary.json of the finished run")
    return console.FAILURES if part.failures else 0


def print_runs(first: Run) -> int:
    """Print for each protocol the table and what became of the images, then cost, failures, files and what comes next.

    Of a method that failed on every image one line says so.

    Returns:
        The exit status.
    """
    from bench.reporting import run_tables
    from bench.reporting.document import Paragraph

    runs, images, manifest = (first, *first.others), first.summary.images, first.manifest
    all_rows: list[run_tables.TableRow] = []
    if images.failed and images.failed == images.images - images.skipped:
        console.say(f"{manifest.method.name} failed on all {counted(images.failed, 'image')}", style="bold red")
        _print_failures(first, first.summary.failures[:1])
        return console.FAILURES
    for run in runs:
        summary, manifest = run.summary, run.manifest
        for warning in filter(None, (run_tables.nothing_scored(summary), run_tables.odd_masks(run.stored))):
            console.say(warning, style="bold red")
        purpose = PURPOSES.get(manifest.protocol.name)
        told = manifest.title if purpose is None else f"{manifest.title}, {purpose}"
        rows = run_tables.table_rows(summary, beside_paper=run_tables.is_beside_paper(manifest))
        all_rows += rows
        beside = "; beside the paper" if any(row.paper for row in rows) else ""
        console.print_blocks([run_tables.results_table(rows, title=f"{told}{beside}, in percent", short=True)])
        for line in run_tables.total_lines(summary, run.stored.protocol):
            console.note(line)
    console.print_blocks([Paragraph(run_tables.legend(all_rows, short=True), "dim")])
    for line in run_tables.cost_lines(first.summary.provenance):
        console.note(line)
    failures = [*dict.fromkeys(failure for run in runs for failure in run.summary.failures)]
    _print_failures(first, failures)
    for run in runs:
        console.note_files(run.files)
    for remark in dict.fromkeys(remark for run in runs for remark in run.remarks):
        console.say(remark, style="yellow")
    console.note(f"next, a page to read: {shlex.join(['fisheye-bench', 'report', str(first.folder)])}")
    return console.FAILURES if failures else 0


def _print_failures(run: Run, failures: Sequence[str]) -> None:
    """Print failures, and the command that shows the traceback of the first that a method raised."""
    console.print_failures(failures, all_in="summary.json")
    if not any(failure.startswith("method ") for failure in failures):
        return
    for row in run.frames[run.frames["status"] == "failed"][:1].to_dict("records"):
        place = ["--recording", row["recording"], "--camera", row["camera"], "--time-ns", str(row["timestamp_ns"])]
        words = ["fisheye-bench", "-v", "view", run.manifest.dataset.card, *run.manifest.method.options(), *place]
        console.say(f"the traceback of the first: {shlex.join(words)}")
