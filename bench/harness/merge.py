"""From the stored units of a run to its tables and its summary: a pure reduction, wherever they were computed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from bench.errors import DataError
from bench.evaluation import Protocol, load_protocol, summarise
from bench.harness.provenance import Provenance, Work
from bench.harness.run_folder import PROTOCOL, begin_run, held_run_folder, new_results
from bench.harness.shards import ShardReport, read_shards
from bench.harness.stored import (
    IMAGE_MAPS,
    SCHEMA_VERSION,
    RunSummary,
    file_digests,
    open_tables,
    read_threshold_free,
    reference_fingerprint,
    write_protocol,
    write_summary,
)
from bench.harness.unit import Unit
from bench.harness.unit_files import FOLDER as UNITS
from bench.harness.unit_files import UnitFolder
from bench.recordings.atomic import folder_lock

Finish = Callable[[Path, RunSummary], None]


def merge_shards(
    out: Path, parts: Sequence[Path], *, overwrite: bool = False, finish: Finish | None = None
) -> RunSummary:
    """Make one run of parts that nobody works at any more.

    Args:
        out: folder of the run.
        parts: folders that hold the parts; `out` may be one of them, or the only one.
        overwrite: replace another run in `out`.
        finish: see `run_benchmark`.

    Raises:
        DataError: parts are missing, damaged or of different runs, nothing could be used, a folder is in use, or `out`
            holds something that is no run, or another run.
    """
    others = {folder.resolve(): folder for folder in parts if folder.resolve() != out.resolve() and folder.is_dir()}
    with ExitStack() as held:
        held.enter_context(held_run_folder(out))
        for folder in others.values():
            held.enter_context(folder_lock(folder, wait=False))
        folder, report = read_shards(parts)[0]
        protocol = load_protocol(folder / UNITS / PROTOCOL)
        begin_run(out, report.manifest, protocol, overwrite=overwrite)
        with new_results(out) as results:
            summary = combine_parts(results, parts, run=out, protocol=protocol)
            if finish is not None:
                finish(results, summary)
        return summary


def combine_parts(results: Path, parts: Sequence[Path], *, run: Path, protocol: Protocol) -> RunSummary:
    """Reduce the parts of a run to its tables and its summary; the caller holds the folders.

    Args:
        results: folder that they are written into.
        parts: folders that hold the parts; `run` may be one of them, or the only one.
        run: folder of the run, in whose units those of all parts are brought together.
        protocol: the rules by which they were scored.

    Raises:
        DataError: parts are missing, of different runs or damaged, or nothing could be used.
    """
    found = read_shards(parts)
    reports = [report for _, report in found]
    first = reports[0]
    if first.stamp.protocol_digest != protocol.digest:
        expected, do = first.stamp.protocol_digest[:12], "score all parts again, by one protocol"
        raise DataError(run, field="protocol", expected=expected, got=protocol.digest[:12], do=do)
    units = _collected(found, run)
    failures = list(first.recording_failures) + [failure for report in reports for failure in report.unit_failures]
    if not units:
        raise DataError(
            first.stamp.card, expected="a recording that can be used", got="; ".join(failures) or "no image to score"
        )
    stored = UnitFolder(run)
    stored.join(units, results, maps_name=IMAGE_MAPS)
    objects, frames = open_tables(results)
    metrics = summarise(objects, frames, protocol=protocol)
    write_protocol(results, protocol)
    summary = RunSummary(
        **{name: getattr(metrics, name) for name in type(metrics).model_fields},
        schema_version=SCHEMA_VERSION,
        manifest=first.manifest.model_copy(update={"reference": reference_fingerprint(objects, frames)}),
        provenance=combined_provenance([report.provenance for report in reports], images=metrics.images.evaluated),
        vehicle_outline_m=first.vehicle_outline_m,
        failures=(*failures, *stored.problems(units)),
        caveats=first.stamp.caveats,
        threshold_free=read_threshold_free(results),
        files=file_digests(results),
    )
    write_summary(results, summary)
    return summary


def _collected(found: Sequence[tuple[Path, ShardReport]], out: Path) -> list[Unit]:
    """The units that have a result, in the run's folder, each with the key that its part tells."""
    units: list[Unit] = []
    for folder, report in found:
        stored = UnitFolder(folder)
        for entry in report.units:
            if entry.key is None:
                continue
            status = stored.checked(entry.unit)
            if status.key != entry.key:
                do = "score the part again; a later run has written into its folder"
                raise DataError(folder, field=f"unit {entry.unit}", expected=entry.key[:12], got=status.key[:12], do=do)
            if folder.resolve() != out.resolve():
                UnitFolder(out).store(entry.unit, stored.file(entry.unit).read_bytes())
            units.append(entry.unit)
    counted = sum(len(report.units) for _, report in found)
    if counted != found[0][1].units_of_run:
        expected, do = f"{found[0][1].units_of_run} units in all parts", "score all parts again, on the same recordings"
        raise DataError(out, expected=expected, got=str(counted), do=do)
    return sorted(units, key=lambda unit: (unit.recording, unit.camera, unit.start))


def combined_provenance(parts: Sequence[Provenance], *, images: int) -> Provenance:
    """Provenance of what was computed in parts: times are added up, memory is that of the largest process.

    Args:
        parts: at least one; what they have in common is taken from the first.
        images: that were scored.
    """
    works = [part.work for part in parts if part.work is not None]
    stages: Counter[str] = Counter()
    found: Counter[str] = Counter()
    computed: Counter[str] = Counter()
    for part in parts:
        stages.update(part.stage_seconds)
    for work in works:
        found.update(work.steps_found)
        computed.update(work.steps_computed)
    return parts[0].model_copy(
        update={
            "started_utc": min(part.started_utc for part in parts),
            "seconds": round(sum(part.seconds for part in parts), 3),
            "stage_seconds": {name: round(seconds, 3) for name, seconds in sorted(stages.items())},
            "images": images,
            "peak_memory_mb": max(part.peak_memory_mb for part in parts),
            "unrepeatable": tuple(dict.fromkeys(line for part in parts for line in part.unrepeatable)),
            "work": Work(
                workers=sum(work.workers for work in works),
                units_computed=sum(work.units_computed for work in works),
                units_reused=sum(work.units_reused for work in works),
                images_computed=sum(work.images_computed for work in works),
                steps_found=dict(sorted(found.items())),
                steps_computed=dict(sorted(computed.items())),
            ),
        }
    )
