"""The two tasks of a run: list a recording's units, and score a unit. Both travel to other processes and back."""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import bench
from bench.errors import BenchError, DataError
from bench.evaluation import Protocol
from bench.harness.cache import CacheFolder, StepCache
from bench.harness.keys import MethodIdentity, RecordingInputs, code_digest, digest_of
from bench.harness.keys.digests import UNIT_CODE
from bench.harness.provenance import largest_resident_mb, recording_fingerprint
from bench.harness.stages import StageClock
from bench.harness.unit import Unit, plan_units, run_unit
from bench.harness.unit_files import encode_unit
from bench.methods import Scorable
from bench.recordings import Recording, RecordingHandle

UNIT_FORMAT = 3  # raise it when the files of a unit change


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSpec:
    """What is the same for all tasks of a run.

    Attributes:
        method: to be scored.
        identity: of the method, in the process that started the run.
        protocols: the rules, each of a run of its own.
        cache: where cached steps are stored; None to compute everything.
        code: digest of this package's code that decides a unit's result, in the process that started the run.
        run_id: of this run; a process opens a recording once for each.
    """

    method: Scorable
    identity: MethodIdentity
    protocols: tuple[Protocol, ...]
    cache: CacheFolder | None = None
    code: str = field(default_factory=lambda: code_digest(UNIT_CODE))
    run_id: str = field(default_factory=lambda: uuid.uuid4().hex)

    def refuse_other_code(self) -> None:
        """Refuse to compute with other code than the run began with.

        Raises:
            DataError: this process has other code of this package or of the method, or a file of it changed on disk.
        """
        if code_digest(UNIT_CODE) != self.code:
            place, do = Path(bench.__file__).parent, "start the run, and its workers, again"
            raise DataError(place, expected="the code that the run began with", got="another state of it", do=do)
        self.identity.refuse_change()


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedRecording:
    """A recording as a run sees it.

    Attributes:
        units: its units; none where it cannot be used.
        fingerprint: of its data; None where it does not open.
        content: digest of its calibration, ego-motion and annotations as they were read, and of names and sizes of its
            images and sweeps; None where it does not open.
        vehicle_outline_m: the ego vehicle from above, vehicle frame.
        failure: why it cannot be used; None where it can.
        seconds: that opening took.
    """

    units: tuple[Unit, ...]
    fingerprint: str | None
    content: str | None
    vehicle_outline_m: tuple[tuple[float, float], ...]
    failure: str | None
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitTask:
    """A unit to be scored.

    Attributes:
        handle: its recording.
        unit: which images.
        stored_keys: keys of the results that are stored already, by protocol; None for none.
    """

    handle: RecordingHandle
    unit: Unit
    stored_keys: tuple[str | None, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredUnit:
    """What became of a unit by one protocol; what it cost is stated in the first of a unit.

    Attributes:
        key: digest of all that the result depends on.
        content: of the file to store; None where the stored ones have this key, or the unit failed.
        failure: why there is no result; None where there is one.
        seconds: by stage, of the pass that the protocols share.
        found: steps found in the cache, by name.
        computed: steps computed and stored, by name.
        peak_memory_mb: of the process so far.
    """

    key: str
    content: bytes | None
    failure: str | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    found: Mapping[str, int] = field(default_factory=dict)
    computed: Mapping[str, int] = field(default_factory=dict)
    peak_memory_mb: float = 0.0


def plan_recording(spec: RunSpec, handle: RecordingHandle) -> PlannedRecording:
    """Open a recording and list its units; what is wrong with it is returned as `failure`, not raised."""
    clock = StageClock()
    try:
        with clock.stage("open"):
            opened = _open(spec, handle)
            units = tuple(plan_units(opened.recording, spec.method))
    except BenchError as error:
        return PlannedRecording(
            units=(),
            fingerprint=None,
            content=None,
            vehicle_outline_m=(),
            failure=f"recording {handle.name!r}: {error}",
            seconds=clock.seconds["open"],
        )
    fingerprint = recording_fingerprint(opened.recording)
    return PlannedRecording(
        units=units,
        fingerprint=fingerprint,
        content=digest_of(fingerprint, opened.inputs.digest),
        vehicle_outline_m=tuple((float(x), float(y)) for x, y in opened.recording.vehicle_outline_m),
        failure=None,
        seconds=clock.seconds["open"],
    )


def score_unit(spec: RunSpec, task: UnitTask) -> tuple[ScoredUnit, ...]:
    """Score a unit by each protocol, unless what is stored has its key; a fault is returned as `failure`, not raised.

    Protocols whose result is not stored share one pass over the images.
    """
    clock, unit = StageClock(), task.unit
    found, missed = (Counter(spec.cache.found), Counter(spec.cache.missed)) if spec.cache else (Counter(), Counter())
    keys, contents, failure = [""] * len(spec.protocols), dict[int, bytes](), None
    due = list(range(len(keys)))
    try:
        with clock.stage("open"):
            opened = _open(spec, task.handle)
        with clock.stage("key"):
            spec.refuse_other_code()
            inputs = opened.inputs.afresh()
            keys = unit_keys(spec, opened.recording, unit, inputs)
        due = [i for i, key in enumerate(keys) if key != task.stored_keys[i]]
        if due:
            steps = None
            if spec.cache is not None:
                steps = StepCache(folder=spec.cache, recording=opened.recording, inputs=inputs, identity=spec.identity)
            protocols = [spec.protocols[i] for i in due]
            tables = run_unit(opened.recording, unit, method=spec.method, protocols=protocols, clock=clock, steps=steps)
            with clock.stage("key"):
                spec.refuse_other_code()
                _refuse_change(spec, opened, unit, keys)
            with clock.stage("store"):
                contents = {i: encode_unit(unit, part, key=keys[i]) for i, part in zip(due, tables, strict=True)}
    except BenchError as error:
        failure = f"recording {unit.recording!r}, camera {unit.camera!r}: {error}"
    except MemoryError:
        where = f"recording {unit.recording!r}, camera {unit.camera!r}, images {unit.start} to {unit.stop - 1}"
        failure = f"{where}: the memory that the process may use was not enough"
    scored = [
        ScoredUnit(key=key, content=contents.get(i), failure=failure if i in due else None, seconds=dict(clock.seconds))
        for i, key in enumerate(keys)
    ]
    scored[0] = replace(
        scored[0],
        found=dict(spec.cache.found - found) if spec.cache else {},
        computed=dict(spec.cache.missed - missed) if spec.cache else {},
        peak_memory_mb=largest_resident_mb(),
    )
    return tuple(scored)


def unit_keys(spec: RunSpec, recording: Recording, unit: Unit, inputs: RecordingInputs) -> list[str]:
    """Digests of all that the results of a unit depend on, by protocol."""
    method, images = spec.method, recording.images[unit.camera]
    first = max(unit.start - method.most_history - 1, 0)
    read = images[first : unit.stop]
    shared = digest_of(
        UNIT_FORMAT,
        spec.code,
        method.name,
        method.settings(),
        spec.identity.digest,
        unit,
        recording.frame_interval_ns,
        inputs.camera(unit.camera),
        inputs.ego_motion,
        inputs.lidar_mounting,
        inputs.annotations,
        inputs.input_errors,
        inputs.images(read),
        inputs.truths(images[unit.start : unit.stop]),
    )
    first_ns, last_ns = read[0].timestamp_ns, read[-1].timestamp_ns
    gaps_ns = [protocol.reference_settings().max_sweep_gap_ns for protocol in spec.protocols]
    return [
        digest_of(shared, protocol, inputs.sweeps(first_ns, last_ns, reach_ns=gap_ns))
        for protocol, gap_ns in zip(spec.protocols, gaps_ns, strict=True)
    ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Opened:
    """A recording that this process has open."""

    spec_id: str
    handle_name: str
    recording: Recording
    inputs: RecordingInputs


_held: list[_Opened] = []  # the last one; tasks of a recording mostly follow each other


def _open(spec: RunSpec, handle: RecordingHandle) -> _Opened:
    if not (_held and (_held[0].spec_id, _held[0].handle_name) == (spec.run_id, handle.name)):
        _held[:] = []
        recording = handle.open()
        inputs = RecordingInputs(recording)
        _held.append(_Opened(spec_id=spec.run_id, handle_name=handle.name, recording=recording, inputs=inputs))
    return _held[0]


def _refuse_change(spec: RunSpec, opened: _Opened, unit: Unit, keys: list[str]) -> None:
    """Refuse a result of files that changed while they were read: nobody knows which of them it is of."""
    if unit_keys(spec, opened.recording, unit, opened.inputs.afresh()) != keys:
        raise DataError(
            opened.recording.root,
            expected="files that stay the same while they are scored",
            got="other content at the end than at the beginning",
            do="run again when nobody writes there",
        )
