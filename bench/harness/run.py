"""A whole run: data set, method and protocol in, tables and a summary out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from bench.evaluation import Protocol
from bench.execution import FailedTask, SerialExecutor, TaskExecutor
from bench.harness import provenance as origin
from bench.harness.cache import CacheFolder
from bench.harness.code_state import unrepeatable_code
from bench.harness.keys import MethodIdentity, code_digest, digest_of
from bench.harness.keys.digests import UNIT_CODE
from bench.harness.merge import Finish, combine_parts
from bench.harness.method_stamp import MethodStamp
from bench.harness.remote_runs import NOWHERE, RunMirror
from bench.harness.run_folder import Experiment, claim, held_run_folder, new_results
from bench.harness.shards import (
    SCHEMA_VERSION,
    WHOLE,
    RunStamp,
    Shard,
    ShardedUnit,
    ShardReport,
    remove_shards,
    write_shard,
)
from bench.harness.stages import Progress, StageClock
from bench.harness.stored import RunSummary
from bench.harness.tasks import PlannedRecording, RunSpec, ScoredUnit, UnitTask, plan_recording, score_unit
from bench.harness.unit import Unit
from bench.harness.unit_files import UnitFolder
from bench.methods import Method
from bench.recordings import NO_INPUT_ERRORS, DatasetCard, InputErrors, RecordingHandle, open_dataset

SERIAL = SerialExecutor()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunRequest:
    """A run that is asked for: what is scored, where the results go, how they are computed.

    Attributes:
        card: the data set.
        method: to be scored.
        protocol: the rules.
        out: folder of the run.
        split: of the data set; None for all of it.
        input_errors: of what the method is told; the reference keeps the true calibration and ego-motion.
        overwrite: replace the run of another experiment in `out`.
        executor: computes the units; the result does not depend on it.
        cache: where flow, likelihood and reference are stored for other runs; None to store nothing.
        progress: called with the images done and their number.
        mirror: where else the run is stored.
    """

    card: DatasetCard
    method: Method
    protocol: Protocol
    out: Path
    split: str | None = None
    input_errors: InputErrors = NO_INPUT_ERRORS
    overwrite: bool = False
    executor: TaskExecutor = SERIAL
    cache: CacheFolder | None = None
    progress: Progress | None = None
    mirror: RunMirror = NOWHERE

    def recordings(self) -> list[RecordingHandle]:
        """The recordings to be scored, with the input errors."""
        return [replace(handle, input_errors=self.input_errors) for handle in open_dataset(self.card, self.split)]

    @property
    def experiment(self) -> Experiment:
        """What all files in `out` are of."""
        return Experiment.of(dataset=self.card.name, split=self.split, method=self.method, protocol=self.protocol)


def run_benchmark(request: RunRequest, *, finish: Finish | None = None) -> RunSummary:
    """Score a method on a data set and store the run.

    Units that are stored in `out`, by this or an interrupted run, are not computed again if all that they depend on is
    the same: protocol, method, settings, code, and the content of the files that they read. The results of an older
    run in `out` stay as they are until all of the new ones take their place at once.

    Args:
        request: what to score, where and how.
        finish: called with the folder of the new results, before they take their place, and the summary; writes what
            else belongs to them, for example tables and pictures.

    Returns:
        The summary, also stored as `summary.json`. Recordings, units and images that could not be used are listed
        in `failures`; the metrics are of the rest.

    Raises:
        DataError: the data set is not there, nothing of it could be used, `out` holds another experiment or something
            that is no run or is in use by another one, or there is no room for the results.
    """
    work = _Work(request=request, handles=request.recordings(), shard=WHOLE)
    out, mirror = request.out, request.mirror
    with held_run_folder(out):
        mirror.begin(parts=WHOLE.count)
        claim(out, request.experiment, request.protocol, overwrite=request.overwrite)
        with new_results(out) as results:
            remove_shards(out)
            work.run()
            summary = combine_parts(results, [out], run=out, protocol=request.protocol)
            if finish is not None:
                finish(results, summary)
        mirror.upload_results()
        return summary


def run_shard(request: RunRequest, shard: Shard) -> ShardReport:
    """Score a part of a data set's units and store them; `merge_shards` makes a run of all parts.

    Parts may work at the same time, in one folder or in many.

    Raises:
        DataError: as `run_benchmark`, but for a part of which nothing could be used.
    """
    work = _Work(request=request, handles=request.recordings(), shard=shard)
    out, mirror = request.out, request.mirror
    with held_run_folder(out, shared=True):
        mirror.begin(parts=shard.count)
        claim(out, request.experiment, request.protocol, overwrite=request.overwrite)
        remove_shards(out, but_of=shard.count)
        report = work.run()
        mirror.upload_results()
        return report


@dataclass(kw_only=True)
class _Work:
    """A part of a run while it goes on: what it has computed so far."""

    request: RunRequest
    handles: Sequence[RecordingHandle]
    shard: Shard
    start: origin.Start = field(default_factory=origin.Start.now)
    clock: StageClock = field(default_factory=StageClock)
    keys: dict[Unit, str] = field(default_factory=dict)
    failures: dict[Unit, str] = field(default_factory=dict)
    identity: MethodIdentity = field(init=False)
    reused: int = 0
    images_computed: int = 0
    found: Counter[str] = field(default_factory=Counter)
    computed: Counter[str] = field(default_factory=Counter)
    peak_memory_mb: float = 0.0

    def __post_init__(self) -> None:
        self.identity = MethodIdentity.of(self.request.method)

    def run(self) -> ShardReport:
        """Plan, score, store."""
        asked = self.request
        if asked.cache is not None:
            asked.cache.prepare()
        (asked.out / "shards" / self.shard.file).unlink(missing_ok=True)
        spec = RunSpec(method=asked.method, identity=self.identity, protocol=asked.protocol, cache=asked.cache)
        with asked.executor:
            planned = self._plan(spec)
            units = [unit for recording in planned for unit in recording.units]
            part = self.shard.part(units)
            stored = UnitFolder(asked.out)
            if self.shard.count == 1:
                stored.keep_only(units)
                asked.mirror.keep_only(units)
            asked.mirror.download_units(part)
            self._score(spec, part, stored)
        if asked.cache is not None:
            asked.cache.evict()
        report = self._report(planned, units, part)
        write_shard(asked.out, self.shard, report)
        return report

    def _plan(self, spec: RunSpec) -> list[PlannedRecording]:
        """The recordings in the order of the data set."""
        found: dict[str, PlannedRecording] = {}
        with closing(self.request.executor.compute(partial(plan_recording, spec), self.handles)) as results:
            for handle, planned in results:
                recording = _never_opened(handle, planned) if isinstance(planned, FailedTask) else planned
                found[handle.name] = recording
                self.clock.seconds["open"] += recording.seconds
        return [found[handle.name] for handle in self.handles]

    def _score(self, spec: RunSpec, units: Sequence[Unit], stored: UnitFolder) -> None:
        by_name = {handle.name: handle for handle in self.handles}
        tasks = []
        for unit in units:
            status = stored.status(unit)
            key = None if status is None else status.key
            tasks.append(UnitTask(handle=by_name[unit.recording], unit=unit, stored_key=key))
        tasks.sort(key=lambda task: task.unit.start - task.unit.stop)  # the longest first, so that all end together
        total, done = sum(unit.stop - unit.start for unit in units), 0
        with closing(self.request.executor.compute(partial(score_unit, spec), tasks)) as results:
            for task, scored in results:
                self._take(task, scored, stored)
                done += task.unit.stop - task.unit.start
                if self.request.progress is not None:
                    self.request.progress(done, total)

    def _take(self, task: UnitTask, scored: ScoredUnit | FailedTask, stored: UnitFolder) -> None:
        unit = task.unit
        if isinstance(scored, FailedTask):
            where = f"recording {unit.recording!r}, camera {unit.camera!r}, images {unit.start} to {unit.stop - 1}"
            self.failures[unit] = f"{where}: {scored.reason}"
            return
        for name, seconds in scored.seconds.items():
            self.clock.seconds[name] += seconds
        self.found += Counter(scored.found)
        self.computed += Counter(scored.computed)
        self.peak_memory_mb = max(self.peak_memory_mb, scored.peak_memory_mb)
        if scored.failure is not None:
            self.failures[unit] = scored.failure
            return
        self.keys[unit] = scored.key
        if scored.content is None:
            self.reused += 1
            self.request.mirror.upload_unit(unit)
            return
        self.images_computed += unit.stop - unit.start
        with self.clock.stage("store"):
            stored.store(unit, scored.content)
            self.request.mirror.upload_unit(unit)

    def _report(
        self,
        planned: Sequence[PlannedRecording],
        units: Sequence[Unit],
        part: Sequence[Unit],
    ) -> ShardReport:
        asked = self.request
        outlines = [recording.vehicle_outline_m for recording in planned if recording.vehicle_outline_m]
        work = origin.Work(
            workers=asked.executor.workers,
            units_computed=len(self.keys) - self.reused,
            units_reused=self.reused,
            images_computed=self.images_computed,
            steps_found=dict(sorted(self.found.items())),
            steps_computed=dict(sorted(self.computed.items())),
        )
        return ShardReport(
            schema_version=SCHEMA_VERSION,
            stamp=RunStamp(
                dataset=asked.card.name,
                card=str(asked.card.file),
                data=digest_of(sorted(recording.content for recording in planned if recording.content is not None)),
                split=asked.split,
                method=MethodStamp.of(asked.method, self.identity),
                code=code_digest(UNIT_CODE),
                protocol_digest=asked.protocol.digest,
                caveats=_caveats(asked.card, self.handles),
            ),
            units_of_run=len(units),
            units=tuple(
                ShardedUnit(
                    recording=unit.recording,
                    camera=unit.camera,
                    start=unit.start,
                    stop=unit.stop,
                    key=self.keys.get(unit),
                )
                for unit in part
            ),
            vehicle_outline_m=outlines[-1] if outlines else (),
            recording_failures=tuple(recording.failure for recording in planned if recording.failure is not None),
            unit_failures=tuple(self.failures[unit] for unit in part if unit in self.failures),
            provenance=origin.provenance_since(
                self.start,
                fingerprints=[recording.fingerprint for recording in planned if recording.fingerprint is not None],
                stage_seconds=self.clock.seconds,
                images=0,
                work=work,
                peak_memory_mb=max(self.peak_memory_mb, origin.largest_resident_mb()),
                unrepeatable=unrepeatable_code(self.identity),
            ),
        )


def _caveats(card: DatasetCard, handles: Sequence[RecordingHandle]) -> str:
    """What a reader has to know of the data, errors of what the method was told included."""
    told = {f"{name} {error:g}": None for handle in handles for name, error in handle.input_errors.named.items()}
    errors = f"The method was told errors of its input: {', '.join(told)}." if told else ""
    return "\n".join(part for part in (card.content.caveats, errors) if part)


def _never_opened(handle: RecordingHandle, failed: FailedTask) -> PlannedRecording:
    failure = f"recording {handle.name!r}: it could not be opened: {failed.reason}"
    return PlannedRecording(
        units=(), fingerprint=None, content=None, vehicle_outline_m=(), failure=failure, seconds=0.0
    )
