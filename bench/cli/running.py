"""The main job: data set in, table out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.cli.computing import Computing
from bench.cli.console import console, print_failures, progress_bar
from bench.cli.interrupts import interruptible, resumable
from bench.cli.places import Destination, destination, parts_of_run
from bench.cli.rendering import render_if_synthetic
from bench.cli.settings import parse_settings
from bench.cli.viewing import draw_telling_frames
from bench.evaluation import Protocol, load_protocol
from bench.harness import (
    Provenance,
    RunSummary,
    build_scorable,
    merge_shards,
    merged_units,
    read_protocol,
    run_benchmark,
    run_shard,
)
from bench.harness.shards import Shard
from bench.methods import Method
from bench.recordings import DatasetCard, load_card
from bench.reporting.terminal_table import to_rich
from bench.reporting.threshold_free_line import threshold_free_line
from bench.reporting.write import write_report_files

RUNS = Path("reports/runs")


def run(
    dataset: str,
    *,
    method: str,
    settings: Sequence[str],
    protocol: str,
    split: str | None,
    out: str | None,
    pictures: bool,
    computing: Computing,
) -> int:
    """Score a method, write the report, print the table and the paths; return the number of failures."""
    card, rules = load_card(dataset), load_protocol(protocol)
    chosen = build_scorable(method, parse_settings(settings))
    where = destination(out, RUNS / f"{card.name}-{chosen.name}")
    render_if_synthetic(card)
    with resumable(where):
        with progress_bar(f"scoring {method} on {card.name}", "images") as report:
            workforce = computing.workforce(card, chosen)
            summary = run_benchmark(
                card,
                method=chosen,
                protocol=rules,
                out=where.folder,
                split=split,
                place=workforce.place,
                workers=workforce.workers,
                cache=computing.cache_folder,
                progress=report,
                mirror=where.mirror,
            )
        finish_run(card, summary, where, method=chosen, protocol=rules, split=split, pictures=pictures)
    return len(summary.failures)


def run_part(
    dataset: str,
    *,
    method: str,
    settings: Sequence[str],
    protocol: str,
    split: str | None,
    out: str | None,
    shard: str,
    computing: Computing,
) -> int:
    """Score a part of the units and say what comes next; return the number of failures."""
    card, rules, part = load_card(dataset), load_protocol(protocol), Shard.parse(shard)
    chosen = build_scorable(method, parse_settings(settings))
    where = destination(out, RUNS / f"{card.name}-{chosen.name}")
    render_if_synthetic(card)
    with resumable(where), progress_bar(f"scoring part {part} of {card.name}", "images") as report:
        workforce = computing.workforce(card, chosen)
        done = run_shard(
            card,
            method=chosen,
            protocol=rules,
            out=where.folder,
            shard=part,
            split=split,
            place=workforce.place,
            workers=workforce.workers,
            cache=computing.cache_folder,
            progress=report,
            mirror=where.mirror,
        )
    failures = (*done.recording_failures, *done.unit_failures)
    _say(f"part {part}: {len(done.units)} of {done.units_of_run} units; when all parts are there: merge {where}")
    _print_cost(done.provenance)
    print_failures(failures, all_in=f"{where}/shards/{part.file}")
    return len(failures)


def merge(run: str, parts: Sequence[str], *, pictures: bool) -> int:
    """Make one run of parts, write the report; return the number of failures.

    Raises:
        DataError: parts are missing, damaged or of different runs.
    """
    where = destination(run, Path(run))
    folders = parts_of_run(where, parts)
    rules = read_protocol(folders[0])
    with interruptible("the parts are as they were, and the same command merges them"):
        summary = merge_shards(where.folder, folders, protocol=rules)
        for unit in merged_units(folders):
            where.mirror.keep(unit, anew=False)
        finish_run(
            load_card(summary.card),
            summary,
            where,
            method=summary.method.build(),
            protocol=rules,
            split=summary.split,
            pictures=pictures,
        )
    return len(summary.failures)


def finish_run(
    card: DatasetCard,
    summary: RunSummary,
    where: Destination,
    *,
    method: Method,
    protocol: Protocol,
    split: str | None,
    pictures: bool,
) -> None:
    """Write the report of a stored run, draw its pictures, print the table and the paths."""
    folder, written = where.folder, write_report_files(where.folder)
    drawn: list[Path] = []
    if pictures:
        with progress_bar("drawing", "pictures") as report:
            drawn = draw_telling_frames(card, folder, method=method, protocol=protocol, split=split, progress=report)
    screen = console()
    screen.print(to_rich(written.rows))
    where.mirror.keep_rest()
    _print_ends(summary, [where.told(file) for file in (folder / "summary.json", *written.files, *drawn)])


def _print_ends(summary: RunSummary, files: Sequence[str]) -> None:
    ledger, images = summary.objects, summary.images
    ignored = ", ".join(f"{count} {reason}" for reason, count in ledger.ignored.items() if count) or "none"
    _say(
        f"{ledger.annotated} annotated object-frames: {ledger.evaluated} evaluated, {ledger.static} static, "
        f"ignored: {ignored}"
    )
    if summary.threshold_free is not None:
        _say(threshold_free_line(summary.threshold_free))
    _say(f"{images.images} images: {images.evaluated} scored, {images.skipped} skipped, {images.failed} failed")
    _print_cost(summary.provenance)
    print_failures(summary.failures, all_in="summary.json")
    for file in files:
        _say(file)


def _print_cost(made: Provenance) -> None:
    """What a run had to compute, and what that took."""
    stages = ", ".join(f"{name} {seconds:.1f}" for name, seconds in made.stage_seconds.items())
    work = made.work
    images = made.images if work is None else work.images_computed
    rate = images / made.seconds if made.seconds else 0.0
    _say(
        f"{made.seconds:.1f} s, {rate:.1f} images per second, peak memory of a process {made.peak_memory_mb:.0f} MB; "
        f"seconds by stage, over all processes: {stages}"
    )
    if work is not None:
        steps = sorted({*work.steps_found, *work.steps_computed})
        kept = "; ".join(
            f"{step} found {work.steps_found.get(step, 0)}, computed {work.steps_computed.get(step, 0)}"
            for step in steps
        )
        _say(
            f"{work.workers} processes; units computed {work.units_computed}, found done {work.units_reused}"
            + (f"; cache: {kept}" if kept else "")
        )


def _say(text: str) -> None:
    console().print(text, highlight=False, soft_wrap=True, markup=False)
