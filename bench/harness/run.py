"""A whole run: data set, method and protocol in, tables and a summary out."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

from bench.errors import BenchError, DataError
from bench.evaluation import Protocol, summarise
from bench.harness import provenance as origin
from bench.harness.progress import Progress, recording_reporter
from bench.harness.stages import StageClock
from bench.harness.stored import (
    IMAGE_MAPS,
    PREDICTIONS,
    SCHEMA_VERSION,
    MethodStamp,
    RunSummary,
    join_units,
    read_tables,
    read_threshold_free,
    reference_fingerprint,
    write_protocol,
    write_summary,
    write_unit,
)
from bench.harness.unit import run_unit
from bench.harness.units import Unit, plan_units
from bench.methods import Method
from bench.recordings import DatasetCard, Recording, RecordingHandle, open_dataset
from bench.threads import single_threaded

MARK = "units"


def run_benchmark(
    card: DatasetCard,
    *,
    method: Method,
    protocol: Protocol,
    out: Path,
    split: str | None = None,
    progress: Progress | None = None,
) -> RunSummary:
    """Score a method on a data set and store the run.

    Args:
        card: the data set.
        method: to be scored.
        protocol: the rules.
        out: folder of the run; an older run in it is replaced.
        split: of the data set; None for all of it.
        progress: called with the recordings done (with a fraction for the one at work) and their number.

    Returns:
        The summary, also stored as `summary.json`. Recordings, units and images that could not be used are listed
        in `failures`; the figures are of the rest.

    Raises:
        DataError: the data set is not there, nothing of it could be used, or `out` holds something that is no run.
    """
    start = origin.Start.now()
    _clear(out)
    handles = open_dataset(card, split)
    work = _Work(method=method, protocol=protocol, out=out)
    with single_threaded():
        for number, handle in enumerate(handles):
            work.run_recording(handle, recording_reporter(progress, number, len(handles)))
    if not work.finished:
        raise DataError(card.file, wanted="a recording that can be used", came="; ".join(work.failures) or "none")
    join_units(out, work.finished)
    objects, frames = read_tables(out, histograms=False)
    figures = summarise(objects, frames, protocol=protocol)
    write_protocol(out, protocol)
    summary = RunSummary(
        **{name: getattr(figures, name) for name in type(figures).model_fields},
        schema_version=SCHEMA_VERSION,
        dataset=card.name,
        card=str(card.file),
        reference_fingerprint=reference_fingerprint(objects, frames),
        split=split,
        method=MethodStamp.of(method),
        provenance=origin.provenance_since(
            start, fingerprints=work.fingerprints, stage_seconds=work.clock.seconds, images=figures.images.evaluated
        ),
        vehicle_outline_m=work.vehicle_outline_m,
        failures=tuple(work.failures),
        caveats=card.content.caveats,
        threshold_free=read_threshold_free(out, protocol),
    )
    write_summary(out, summary)
    return summary


@dataclass(kw_only=True)
class _Work:
    """What piles up while a run goes on."""

    method: Method
    protocol: Protocol
    out: Path
    clock: StageClock = field(default_factory=StageClock)
    fingerprints: list[str] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    finished: list[Unit] = field(default_factory=list)
    vehicle_outline_m: tuple[tuple[float, float], ...] = ()

    def run_recording(self, handle: RecordingHandle, report: Callable[[float], None]) -> None:
        """Score one recording; what fails is listed and the rest goes on."""
        try:
            with self.clock.stage("open"):
                recording = handle.open()
                self.fingerprints.append(origin.recording_fingerprint(recording))
            self.vehicle_outline_m = tuple((float(x), float(y)) for x, y in recording.vehicle_outline_m)
            units = list(plan_units(recording, self.method))
        except BenchError as error:
            self.failures.append(f"recording {handle.name!r}: {error}")
            units = []
        total, done = sum(unit.stop - unit.start for unit in units), count(1)
        for unit in units:
            self._run_unit(recording, unit, lambda: report(next(done) / total))
        report(1.0)

    def _run_unit(self, recording: Recording, unit: Unit, advance: Callable[[], None]) -> None:
        try:
            tables = run_unit(
                recording, unit, method=self.method, protocol=self.protocol, clock=self.clock, progress=advance
            )
        except BenchError as error:
            self.failures.append(f"recording {unit.recording!r}, camera {unit.camera!r}: {error}")
            return
        self.failures += tables.problems
        with self.clock.stage("store"):
            write_unit(self.out, unit, tables)
        self.finished.append(unit)


def _clear(out: Path) -> None:
    """Make room for the run; never remove a folder that is not a run."""
    if out.exists() and any(out.iterdir()) and not (out / MARK).is_dir():
        raise DataError(out, wanted="an empty folder or an older run", came="a folder with other files")
    for file in ("summary.json", "objects.parquet", "frames.parquet", IMAGE_MAPS, "protocol.json", PREDICTIONS):
        (out / file).unlink(missing_ok=True)
    shutil.rmtree(out / MARK, ignore_errors=True)
    (out / MARK).mkdir(parents=True)
