"""Runs: what options ask for, how they are scored, and what is printed of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from bench.api.runs import run_requests
from bench.cli.console import note, note_files, print_failures, progress_bar, say, show, stage_times
from bench.cli.interrupts import resumable
from bench.cli.request import Computing, parse_settings, render_if_synthetic
from bench.cli.view import draw_example_frames
from bench.evaluation import Protocol
from bench.harness import (
    Part,
    Provenance,
    RunRequest,
    RunSummary,
    run_protocols,
    score_part,
)
from bench.recordings import DatasetCard
from bench.reference import IgnoreReason
from bench.reporting.leaderboard.texts import best_line
from bench.reporting.table_files import write_report_files
from bench.reporting.tables import TableRow, terminal_report, threshold_free_line

LEADERBOARD = Path("reports/leaderboard/leaderboard.json")  # of this checkout, as `make leaderboard` wrote it
READ_FIRST = ("summary.json", "table.md", "range_map.png")


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoringOptions:
    """Options of the command line: what is scored, and how.

    Attributes:
        dataset: card, or its name.
        method: name, or "module:Class".
        settings: of the method, "name=value".
        protocol: names or files, with commas in between; the method is asked once for all of them.
        split: of the data set; None for all of it.
        out: folder of the run; None for the usual one.
        overwrite: replace another run.
        computing: where and how.
        input_errors: injected into what the method is given, "name=value".
    """

    dataset: str
    method: str
    settings: Sequence[str]
    protocol: str
    split: str | None
    out: str | None
    overwrite: bool
    computing: Computing
    input_errors: Sequence[str] = ()


def run(asked: ScoringOptions, *, pictures: bool) -> int:
    """Score a method, write the reports, print the tables and the paths; return the number of failures."""
    requests = requested_runs(asked)
    card = requests[0].card
    reports = {r.protocol.name: RunReport(card=card, protocol=r.protocol, pictures=pictures) for r in requests}
    with resumable(requests[0].out):
        with progress_bar(f"scoring {asked.method} on {card.name}", "images") as progress:
            summaries = run_protocols(
                [replace(request, progress=progress) for request in requests],
                finish=lambda results, summary: reports[summary.protocol.name].write(results, summary),
            )
        for summary, request in zip(summaries, requests, strict=True):
            reports[summary.protocol.name].print(summary, request.out)
        if card.scenario is None:
            note(f"a run does not validate its data; check them with: fisheye-bench validate {asked.dataset}")
        best = best_line(LEADERBOARD, dataset=requests[0].card.name)
        if best is not None:
            say(best)
    return max(len(summary.failures) for summary in summaries)


def run_part(asked: ScoringOptions, *, part: str) -> int:
    """Score a part I/N of the units and say what comes next; return the number of failures."""
    chosen = Part.parse(part)
    requests = requested_runs(asked)
    first = requests[0]
    with resumable(first.out), progress_bar(f"scoring part {chosen} of {first.card.name}", "images") as progress:
        scored = score_part([replace(request, progress=progress) for request in requests], chosen)
    for request in requests:
        done = f"{len(scored.digests(request.out))} of its {len(scored.units)} units are in {request.out}"
        say(f"part {chosen}: {done}, of {scored.units_of_run} in all; the same command without --shard ends the run")
    failures = scored.failures(first.out)
    _print_cost(scored.provenance(first.out, images=0))
    print_failures(failures, all_in="the summary.json of the finished run")
    return len(failures)


def requested_runs(asked: ScoringOptions, *, render: bool = True) -> list[RunRequest]:
    """Assemble what the command line says: a run for each protocol.

    Args:
        asked: what the command line says.
        render: the data set where it is not there.
    """
    requests = run_requests(
        asked.dataset,
        asked.method,
        settings=parse_settings(asked.settings),
        protocols=[name.strip() for name in asked.protocol.split(",")],
        split=asked.split,
        input_errors=parse_settings(asked.input_errors, option="--input-error"),
        out=asked.out,
        overwrite=asked.overwrite,
    )
    card, method = requests[0].card, requests[0].method
    if render:
        render_if_synthetic(card)
    executor, cache = asked.computing.executor(card, method), asked.computing.cache_folder
    return [replace(request, executor=executor, cache=cache) for request in requests]


@dataclass(kw_only=True)
class RunReport:
    """Report of a run: the files written beside its tables of counts, and what is printed of them.

    Attributes:
        card: the data set.
        protocol: the rules.
        pictures: also draw an example frame of every category.
    """

    card: DatasetCard
    protocol: Protocol
    pictures: bool
    _rows: tuple[TableRow, ...] = ()
    _files: list[str] = field(default_factory=list)
    _remarks: list[str] = field(default_factory=list)

    def write(self, results: Path, summary: RunSummary) -> None:
        """Write the report of new results and draw their pictures."""
        rows, files = write_report_files(results)
        drawn: list[Path] = []
        if self.pictures:
            with progress_bar("drawing", "pictures") as progress:
                drawn, self._remarks = draw_example_frames(
                    results,
                    summary,
                    card=self.card,
                    protocol=self.protocol,
                    progress=progress,
                )
        self._rows = tuple(rows)
        every = (results / "summary.json", *files, *drawn)
        names = [file.relative_to(results).as_posix() for file in every]
        self._files = sorted(names, key=lambda name: name not in READ_FIRST)  # of these the first few are printed

    def print(self, summary: RunSummary, folder: Path) -> None:
        """Print the table, what became of the images, the cost, and where everything is."""
        show(terminal_report(self._rows))
        _print_totals(summary, [str(folder / file) for file in self._files], self.protocol)
        for remark in self._remarks:
            say(f"no picture: {remark}", style="yellow")


def _print_totals(summary: RunSummary, files: Sequence[str], protocol: Protocol) -> None:
    ledger, images = summary.objects, summary.images
    limits: dict[str, str] = {IgnoreReason.RANGE: f" (beyond {protocol.reference.range_limit_m:g} m)"}
    reasons = [f"{count} {reason}{limits.get(reason, '')}" for reason, count in ledger.ignored.items() if count]
    ignored = ", ".join(reasons) or "none"
    note(
        f"{ledger.annotated} annotated object-frames: {ledger.evaluated} evaluated, {ledger.static} static, "
        f"ignored: {ignored}"
    )
    if summary.threshold_free is not None:
        note(threshold_free_line(summary.threshold_free))
    note(f"{images.images} images: {images.evaluated} scored, {images.skipped} skipped, {images.failed} failed")
    _print_cost(summary.provenance)
    print_failures(summary.failures, all_in="summary.json")
    note_files(files)


def _print_cost(made: Provenance) -> None:
    """Print what a run had to compute, and the time and memory that it took."""
    stages = stage_times(made.stage_seconds)
    work = made.work
    images = made.images if work is None else work.images_computed
    rate = f", {images / made.seconds:.1f} images per second" if images and made.seconds else ""
    note(
        f"{made.seconds:.1f} s{rate}, peak memory of a process {made.peak_memory_mb:.0f} MB; "
        f"seconds by stage, over all processes: {stages}"
    )
    if work is not None:
        steps = sorted({*work.steps_found, *work.steps_computed})
        cached = "; ".join(
            f"{step} found {work.steps_found.get(step, 0)}, computed {work.steps_computed.get(step, 0)}"
            for step in steps
        )
        changed = ", ".join(f"{name} ({count})" for name, count in work.changed.items())
        note(
            f"{work.workers} processes; units computed {work.units_computed}, found done {work.units_reused}"
            + (f"; computed again since these changed: {changed}" if changed else "")
            + (f"; cache: {cached}" if cached else "")
        )
