"""A whole run: data set, method and protocol in, tables and a summary out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from bench.evaluation import Protocol
from bench.evaluation.summary import ProtocolStamp
from bench.execution import FailedTask, SerialExecutor, TaskExecutor
from bench.harness import provenance
from bench.harness.cache import CacheFolder
from bench.harness.code_state import unrepeatable_code
from bench.harness.keys import MethodIdentity, code_digest, digest_of
from bench.harness.keys.digests import UNIT_CODE
from bench.harness.manifest import CodeOfRun, DatasetOfRun, Manifest
from bench.harness.merge import Finish, combine_parts
from bench.harness.method_stamp import MethodStamp
from bench.harness.run_folder import begin_run, held_run_folder, new_results
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
from bench.methods import Scorable
from bench.recordings import NO_INPUT_ERRORS, DatasetCard, InputErrors, RecordingHandle, open_dataset

SERIAL = SerialExecutor()
LARGEST_BATCH = 16  # recordings a worker


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunRequest:
    """A run that is asked for: what is scored, where the results go, how they are computed.

    Attributes:
        card: the data set.
        method: to be scored.
        protocol: the rules.
        out: folder of the run.
        settings: of the method, as they were asked for.
        split: of the data set; None for all of it.
        input_errors: injected into the method's input; the reference keeps the true calibration and ego-motion.
        overwrite: replace another run in `out`.
        executor: computes the units; the result does not depend on it.
        cache: where flow, likelihood and reference are stored for other runs; None to store nothing.
        progress: called with the images done and their number, which is 0 while none is known and estimated while
            recordings are not open yet.
    """

    card: DatasetCard
    method: Scorable
    protocol: Protocol
    out: Path
    settings: Mapping[str, object] = field(default_factory=dict)
    split: str | None = None
    input_errors: InputErrors = NO_INPUT_ERRORS
    overwrite: bool = False
    executor: TaskExecutor = SERIAL
    cache: CacheFolder | None = None
    progress: Progress | None = None

    def recordings(self) -> list[RecordingHandle]:
        """The recordings to be scored, with the input errors."""
        return [replace(handle, input_errors=self.input_errors) for handle in open_dataset(self.card, self.split)]

    def begin(self, held: ExitStack, *, shard: Shard) -> None:
        """Hold the folder of the run, and note what is going on there."""
        held.enter_context(held_run_folder(self.out, shared=shard != WHOLE))
        begin_run(self.out, self.manifest(), self.protocol, overwrite=self.overwrite)

    def manifest(self) -> Manifest:
        """What the run is, as far as it is known before it begins."""
        return Manifest(
            dataset=DatasetOfRun(
                name=self.card.name,
                card=str(self.card.file),
                split=self.split,
                input_errors=dict(self.input_errors.named),
            ),
            method=MethodStamp.of(self.method, MethodIdentity.of(self.method), asked=self.settings),
            protocol=ProtocolStamp(name=self.protocol.name, version=self.protocol.version, digest=self.protocol.digest),
            code=CodeOfRun.here(),
        ).as_read()


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
        DataError: the data set is not there, nothing of it could be used, `out` holds another run or something
            that is no run or is in use by another one, or there is no space for the results.
    """
    return run_protocols([request], finish=finish)[0]


def run_protocols(requests: Sequence[RunRequest], *, finish: Finish | None = None) -> list[RunSummary]:
    """Score a method by several protocols in one pass over the images; each is a run of its own.

    Args:
        requests: at least one; they differ in protocol and folder alone.
        finish: see `run_benchmark`; called for each run.

    Raises:
        DataError: as `run_benchmark`.
    """
    handles = requests[0].recordings()
    works = [_Work(request=request, handles=handles, shard=WHOLE) for request in requests]
    with ExitStack() as held:
        for request in requests:
            request.begin(held, shard=WHOLE)
        with ExitStack() as replaced:
            folders = [replaced.enter_context(new_results(request.out)) for request in requests]
            for request in requests:
                remove_shards(request.out)
            _score_in_one_pass(works)
            summaries = []
            for request, results in zip(requests, folders, strict=True):
                summary = combine_parts(results, [request.out], run=request.out, protocol=request.protocol)
                if finish is not None:
                    finish(results, summary)
                summaries.append(summary)
        return summaries


def run_shard(requests: Sequence[RunRequest], shard: Shard) -> list[ShardReport]:
    """Score a part of a data set's units and store them; `merge_shards` makes a run of all parts.

    Parts may work at the same time, in one folder or in many.

    Args:
        requests: at least one; they differ in protocol and folder alone.
        shard: which part.

    Raises:
        DataError: as `run_benchmark`, but for a part of which nothing could be used.
    """
    handles = requests[0].recordings()
    works = [_Work(request=request, handles=handles, shard=shard) for request in requests]
    with ExitStack() as held:
        for request in requests:
            request.begin(held, shard=shard)
            remove_shards(request.out, but_of=shard.count)
        return _score_in_one_pass(works)


@dataclass(kw_only=True)
class _Work:
    """A part of a run while it goes on: what it has computed so far."""

    request: RunRequest
    handles: Sequence[RecordingHandle]
    shard: Shard
    start: provenance.Start = field(default_factory=provenance.Start.now)
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

    @property
    def stored(self) -> UnitFolder:
        """The units that are there."""
        return UnitFolder(self.request.out)

    def begin(self, units: Sequence[Unit]) -> None:
        """Leave no unit that is none of the run's."""
        if self.shard.count == 1:
            self.stored.keep_only(units)

    def stored_key(self, unit: Unit) -> str | None:
        """Key of the stored result of a unit."""
        status = self.stored.status(unit)
        return None if status is None else status.key

    def take(self, unit: Unit, scored: ScoredUnit | FailedTask) -> None:
        """Store the result of a unit, or note why there is none."""
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
            return
        self.images_computed += unit.stop - unit.start
        with self.clock.stage("store"):
            self.stored.store(unit, scored.content)

    def report(
        self,
        planned: Sequence[PlannedRecording],
        units: Sequence[Unit],
        part: Sequence[Unit],
    ) -> ShardReport:
        """What this part has computed."""
        asked = self.request
        fingerprints = {
            handle.name: recording.fingerprint
            for handle, recording in zip(self.handles, planned, strict=True)
            if recording.fingerprint is not None
        }
        outlines = [recording.vehicle_outline_m for recording in planned if recording.vehicle_outline_m]
        work = provenance.Work(
            workers=asked.executor.workers,
            units_computed=len(self.keys) - self.reused,
            units_reused=self.reused,
            images_computed=self.images_computed,
            steps_found=dict(sorted(self.found.items())),
            steps_computed=dict(sorted(self.computed.items())),
        )
        return ShardReport(
            schema_version=SCHEMA_VERSION,
            manifest=asked.manifest().with_data(fingerprints),
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
            provenance=provenance.provenance_since(
                self.start,
                stage_seconds=self.clock.seconds,
                images=0,
                work=work,
                peak_memory_mb=max(self.peak_memory_mb, provenance.largest_resident_mb()),
                unrepeatable=unrepeatable_code(self.identity),
            ),
        )


def _score_in_one_pass(works: Sequence[_Work]) -> list[ShardReport]:
    """Plan, score and store; the works differ in protocol and folder alone."""
    first = works[0]
    asked, shard = first.request, first.shard
    if asked.cache is not None:
        asked.cache.prepare()
    for work in works:
        (work.request.out / "shards" / shard.file).unlink(missing_ok=True)
    protocols = tuple(work.request.protocol for work in works)
    spec = RunSpec(method=asked.method, identity=first.identity, protocols=protocols, cache=asked.cache)
    tally = _Tally(asked.progress, recordings=len(first.handles))
    planned: list[PlannedRecording] = []
    lazy = shard == WHOLE
    with asked.executor:
        for handles in _batches(first.handles, asked.executor.workers) if lazy else [first.handles]:
            planned += _plan(spec, works, handles, tally)
            opened = planned[-len(handles) :]
            units = shard.part([unit for recording in opened for unit in recording.units])
            if not lazy:
                _begin(works, planned)
            tally.count(len(opened), sum(unit.stop - unit.start for unit in units))
            _score(spec, works, units, tally)
    units = [unit for recording in planned for unit in recording.units]
    part = shard.part(units)
    if lazy:
        _begin(works, planned)
    if asked.cache is not None:
        asked.cache.evict()
    reports = []
    for work in works:
        reports.append(work.report(planned, units, part))
        write_shard(work.request.out, shard, reports[-1])
    return reports


class _Tally:
    """Tells how many images are done, and of how many.

    Args:
        progress: takes it.
        recordings: of the run.
    """

    def __init__(self, progress: Progress | None, *, recordings: int) -> None:
        self._progress, self._recordings = progress, recordings
        self._opened = self._known = self.done = 0
        self.tell()

    def count(self, recordings: int, images: int) -> None:
        """Recordings were opened, with images to be scored."""
        self._opened, self._known = self._opened + recordings, self._known + images
        self.tell()

    def tell(self) -> None:
        """Tell it; recordings that are not open yet count as large as those that are."""
        if self._progress is not None:
            self._progress(self.done, round(self._known * self._recordings / max(self._opened, 1)))


def _begin(works: Sequence[_Work], planned: Sequence[PlannedRecording]) -> None:
    units = [unit for recording in planned for unit in recording.units]
    for work in works:
        work.begin(units)


def _batches(handles: Sequence[RecordingHandle], workers: int) -> Iterator[Sequence[RecordingHandle]]:
    """Recordings that are opened before the next images are scored.

    One at a time is opened once. Of several workers each opens the recordings of its images, so that larger batches
    let them wait for each other less; the first ones are small, so that there are results soon.
    """
    start, size = 0, workers
    while start < len(handles):
        yield handles[start : start + size]
        start, size = start + size, min(2 * size, LARGEST_BATCH * workers) if workers > 1 else 1


def _plan(
    spec: RunSpec, works: Sequence[_Work], handles: Sequence[RecordingHandle], tally: _Tally
) -> list[PlannedRecording]:
    """The recordings in the order of the data set."""
    found: dict[str, PlannedRecording] = {}
    with closing(works[0].request.executor.compute(partial(plan_recording, spec), handles)) as results:
        for handle, planned in results:
            recording = _failed_to_open(handle, planned) if isinstance(planned, FailedTask) else planned
            found[handle.name] = recording
            for work in works:
                work.clock.seconds["open"] += recording.seconds
            tally.tell()
    return [found[handle.name] for handle in handles]


def _score(spec: RunSpec, works: Sequence[_Work], units: Sequence[Unit], tally: _Tally) -> None:
    asked = works[0].request
    by_name = {handle.name: handle for handle in works[0].handles}
    tasks = [
        UnitTask(handle=by_name[unit.recording], unit=unit, stored_keys=tuple(work.stored_key(unit) for work in works))
        for unit in units
    ]
    tasks.sort(key=lambda task: task.unit.start - task.unit.stop)  # the longest first, so that all end together
    with closing(asked.executor.compute(partial(score_unit, spec), tasks)) as results:
        for task, scored in results:
            for number, work in enumerate(works):
                work.take(task.unit, scored if isinstance(scored, FailedTask) else scored[number])
            tally.done += task.unit.stop - task.unit.start
            tally.tell()


def _caveats(card: DatasetCard, handles: Sequence[RecordingHandle]) -> str:
    """What a reader has to know of the data, errors of what the method was told included."""
    told = {f"{name} {error:g}": None for handle in handles for name, error in handle.input_errors.named.items()}
    errors = f"The method was told errors of its input: {', '.join(told)}." if told else ""
    return "\n".join(part for part in (card.content.caveats, errors) if part)


def _failed_to_open(handle: RecordingHandle, failed: FailedTask) -> PlannedRecording:
    failure = f"recording {handle.name!r}: it could not be opened: {failed.reason}"
    return PlannedRecording(
        units=(), fingerprint=None, content=None, vehicle_outline_m=(), failure=failure, seconds=0.0
    )
