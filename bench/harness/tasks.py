"""The two tasks of a run: list a recording's units, and score a unit. Both travel to other processes and back."""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Collection, Mapping, Set
from dataclasses import dataclass, field
from pathlib import Path

import bench
from bench.errors import BenchError, DataError, OutputError
from bench.evaluation import Protocol
from bench.harness.cache import CacheFolder, StepCache
from bench.harness.digests import MethodCode, RecordingInputs, code_digest, digest_of
from bench.harness.digests.content import UNIT_CODE, code_parts
from bench.harness.method_of_run import flat_settings
from bench.harness.provenance import NOT_STORED, largest_resident_mb, recording_digest
from bench.harness.reference_files import RecordingReference, ReferenceFolder
from bench.harness.stages import StageClock
from bench.harness.unit import Unit, plan_units, run_unit
from bench.harness.unit_files import UnitStore, encode_unit
from bench.methods import Scorable
from bench.recordings import Recording, RecordingHandle

UNIT_FORMAT = 4  # raise it when the files of a unit change


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSpec:
    """Settings that are the same for all tasks of a run.

    Attributes:
        method: to be scored.
        method_code: of the method, in the process that started the run.
        settings: of the method, as it reports them and as they were asked for, by dotted name.
        protocols: the rules, each by the folder of its run.
        cache: where cached steps are stored; None to compute everything.
        exported: where references are read from; None to build them.
        code: digest of this package's code that decides a unit's result, in the process that started the run.
        run_id: of this run; a process opens a recording once for each.
    """

    method: Scorable
    method_code: MethodCode
    settings: Mapping[str, object]
    protocols: Mapping[Path, Protocol]
    cache: CacheFolder | None = None
    exported: ReferenceFolder | None = None
    code: str = field(default_factory=lambda: code_digest(UNIT_CODE))
    run_id: str = field(default_factory=lambda: uuid.uuid4().hex)

    @property
    def parts(self) -> dict[str, dict[str, str]]:
        """Parts of the code and of the method: digests and versions by name, see `deciding_digests`."""
        return {"code": code_parts(UNIT_CODE), "method": self.method_parts}

    @property
    def method_parts(self) -> dict[str, str]:
        """Name of the method, and its code by name."""
        return {"name": self.method.name, **self.method_code.parts}

    @property
    def unreported_settings(self) -> dict[str, object]:
        """Settings that were asked for and that the method does not report."""
        reported = flat_settings(self.method.settings())
        return {name: value for name, value in self.settings.items() if name not in reported}

    def refuse_other_code(self) -> None:
        """Refuse to compute with other code than the run began with.

        Raises:
            DataError: this process has other code of this package or of the method, or a file of it changed on disk.
        """
        if code_digest(UNIT_CODE) != self.code:
            place, hint = Path(bench.__file__).parent, "start the run, and its workers, again"
            raise DataError(place, expected="the code that the run began with", got="another state of it", hint=hint)
        self.method_code.refuse_change()


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedRecording:
    """A recording as a run sees it.

    Attributes:
        name: of the recording.
        units: its units; none where it cannot be used.
        digest: of its data; None where it does not open.
        vehicle_outline_m: the ego vehicle from above, vehicle frame.
        reviewed: False where objects were proposed and nobody has looked at them.
        failure: why it cannot be used; None where it can.
        seconds: that opening took.
    """

    name: str
    units: tuple[Unit, ...] = ()
    digest: str | None = None
    vehicle_outline_m: tuple[tuple[float, float], ...] = ()
    failure: str | None = None
    seconds: float = 0.0
    reviewed: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitTask:
    """A unit to be scored.

    Attributes:
        handle: its recording.
        unit: which images.
        stored: results that are stored, by folder of the run, see `UnitStore.stored`; None where the worker sees the
            folders: then it looks itself, and stores what it computes.
    """

    handle: RecordingHandle
    unit: Unit
    stored: Mapping[Path, Mapping[str, Mapping[str, str]]] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredUnit:
    """Outcome of a unit.

    Attributes:
        digests: names of its results by folder of the run; none where it failed.
        computed: folders for which it was computed, not found done.
        changed: what made it be computed again where another result was stored, by name as in `deciding_digests`, with
            the digest that it had; `NOT_STORED` where there was none.
        contents: of the files to store, by folder; empty where the worker has stored them.
        failure: why there is no result; None where there is one.
        seconds: by stage, of the pass that the protocols share.
        steps_found: steps found in the cache, by name.
        steps_computed: steps computed and stored, by name.
        peak_memory_mb: of the process so far.
    """

    digests: Mapping[Path, str] = field(default_factory=dict)
    computed: Set[Path] = frozenset()
    changed: Mapping[str, str] = field(default_factory=dict)
    contents: Mapping[Path, bytes] = field(default_factory=dict)
    failure: str | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    steps_found: Mapping[str, int] = field(default_factory=dict)
    steps_computed: Mapping[str, int] = field(default_factory=dict)
    peak_memory_mb: float = 0.0


def plan_recording(spec: RunSpec, handle: RecordingHandle) -> PlannedRecording:
    """Open a recording and list its units; what is wrong with it is returned as `failure`, not raised."""
    clock = StageClock()
    try:
        with clock.stage("open"):
            opened = _open(spec, handle)
            units = tuple(plan_units(opened.recording, spec.method))
    except BenchError as error:
        failure = f"recording {handle.name!r}: {error}"
        return PlannedRecording(name=handle.name, failure=failure, seconds=clock.seconds["open"])
    return PlannedRecording(
        name=handle.name,
        units=units,
        digest=recording_digest(opened.recording),
        vehicle_outline_m=tuple((float(x), float(y)) for x, y in opened.recording.vehicle_outline_m),
        seconds=clock.seconds["open"],
        reviewed=all(track.reviewed for track in opened.recording.tracks),
    )


def score_unit(spec: RunSpec, task: UnitTask) -> ScoredUnit:
    """Score a unit by each protocol, unless its result is stored; a fault is returned as `failure`, not raised.

    Protocols whose result is not stored share one pass over the images.

    Raises:
        OutputError: a result cannot be stored.
    """
    clock, unit = StageClock(), task.unit
    found, missed = (Counter(spec.cache.found), Counter(spec.cache.missed)) if spec.cache else (Counter(), Counter())
    digests: dict[Path, str] = {}
    contents: dict[Path, bytes] = {}
    computed: list[Path] = []
    changed: dict[str, str] = {}
    failure = None
    try:
        with clock.stage("open"):
            opened = _open(spec, task.handle)
        with clock.stage("digest"):
            spec.refuse_other_code()
            inputs = opened.inputs.reread()
            decided_by = deciding_digests(spec, opened, unit, inputs)
            names = {run: digest_of(parts) for run, parts in decided_by.items()}
            stored = task.stored
            if stored is None:
                stored = {run: UnitStore(run=run).stored(unit) for run in names}
            digests = {run: digest for run, digest in names.items() if digest in stored[run]}
        due = [run for run in names if run not in digests]
        if due:
            for run in due:
                changed |= _changed(decided_by[run], stored[run].values())
            steps = None
            if spec.cache is not None:
                steps = StepCache(
                    folder=spec.cache,
                    recording=opened.recording,
                    inputs=inputs,
                    method_code=spec.method_code,
                    unreported=spec.unreported_settings,
                )
            protocols = [spec.protocols[run] for run in due]
            tables = run_unit(
                opened.recording,
                unit,
                method=spec.method,
                protocols=protocols,
                clock=clock,
                steps=steps,
                exported=opened.exported,
            )
            with clock.stage("digest"):
                spec.refuse_other_code()
                _refuse_change(spec, opened, unit, decided_by)
            with clock.stage("store"):
                for run, counted in zip(due, tables, strict=True):
                    contents[run] = encode_unit(counted, decided_by=decided_by[run])
                    if task.stored is None:
                        UnitStore(run=run).write(unit, names[run], contents.pop(run))
            digests, computed = names, due
    except OutputError:
        raise
    except BenchError as error:
        failure = f"recording {unit.recording!r}, camera {unit.camera!r}: {error}"
    except MemoryError:
        failure = f"{unit}: the memory that the process may use was not enough"
    return ScoredUnit(
        digests=digests,
        computed=frozenset(computed),
        changed=changed,
        contents=contents,
        failure=failure,
        seconds=dict(clock.seconds),
        steps_found=dict(spec.cache.found - found) if spec.cache else {},
        steps_computed=dict(spec.cache.missed - missed) if spec.cache else {},
        peak_memory_mb=largest_resident_mb(),
    )


def deciding_digests(
    spec: RunSpec, opened: OpenedRecording, unit: Unit, inputs: RecordingInputs
) -> dict[Path, dict[str, str]]:
    """Digests of all that decides the results of a unit, by folder of the run and name."""
    recording = opened.recording
    images = recording.images[unit.camera]
    first = max(unit.start - spec.method.most_history - 1, 0)
    read = images[first : unit.stop]
    shared = {
        "format": digest_of(UNIT_FORMAT),
        "code": spec.code,
        "method": digest_of(spec.method_parts),
        "settings": digest_of(spec.settings),
        "unit": digest_of(unit, recording.frame_interval_ns),
        "input errors": digest_of(inputs.input_errors),
        "images": inputs.images(read),
        "exact masks": inputs.truths(images[unit.start : unit.stop]),
    }
    if opened.exported is not None:
        shared["exported reference"] = opened.exported.digest(images[unit.start : unit.stop])
    found = {}
    for run, protocol in spec.protocols.items():
        reach_ns = protocol.reference_settings().max_sweep_gap_ns
        of_reference = inputs.of_reference(unit.camera, read[0].timestamp_ns, read[-1].timestamp_ns, reach_ns=reach_ns)
        found[run] = shared | of_reference | {"protocol": digest_of(protocol)}
    return found


def _changed(decided_by: Mapping[str, str], stored: Collection[Mapping[str, str]]) -> dict[str, str]:
    """Names that were others when the most similar stored result came about, with digests; `NOT_STORED` without any."""
    changed = [
        {name: other.get(name, "") for name in decided_by if other.get(name) != decided_by[name]} for other in stored
    ]
    return min(changed, key=len, default={NOT_STORED: ""})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OpenedRecording:
    """A recording that this process has open, with its exported reference where one is scored by."""

    recording: Recording
    inputs: RecordingInputs
    exported: RecordingReference | None


_held: dict[tuple[str, str], OpenedRecording] = {}  # the last one; tasks of a recording mostly follow each other


def _open(spec: RunSpec, handle: RecordingHandle) -> OpenedRecording:
    key = spec.run_id, handle.name
    if key not in _held:
        _held.clear()
        recording = handle.open()
        exported = None if spec.exported is None else spec.exported.recording(recording.name)
        _held[key] = OpenedRecording(recording=recording, inputs=RecordingInputs(recording), exported=exported)
    return _held[key]


def _refuse_change(
    spec: RunSpec, opened: OpenedRecording, unit: Unit, before: Mapping[Path, Mapping[str, str]]
) -> None:
    """Refuse a result of files that changed while they were read: nobody knows which of them it is of."""
    if deciding_digests(spec, opened, unit, opened.inputs.reread()) != before:
        raise DataError(
            opened.recording.root,
            expected="files that stay the same while they are scored",
            got="other content at the end than at the beginning",
            hint="run again",
        )
