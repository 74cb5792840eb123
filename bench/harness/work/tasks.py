"""The two tasks of a run: list a recording's units, and score a unit. Both travel to other processes and back."""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from bench.errors import BenchError, DataError
from bench.evaluation import Protocol
from bench.harness.cache import CacheFolder, StepCache
from bench.harness.keys import RecordingInputs, code_digest, digest_of, method_digest
from bench.harness.keys.code import UNIT_CODE
from bench.harness.provenance import largest_resident_mb, recording_fingerprint
from bench.harness.stages import StageClock
from bench.harness.unit import run_unit
from bench.harness.unit_files import encode_unit
from bench.harness.units import Unit, plan_units
from bench.methods import Method
from bench.recordings import Recording, RecordingHandle

UNIT_FORMAT = 2  # raise it when the files of a unit change


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSpec:
    """What is the same for all tasks of a run.

    Attributes:
        method: to be scored.
        protocol: the rules.
        cache: where steps are kept; None to compute everything.
        run_id: of this run; a process opens a recording once for each.
    """

    method: Method
    protocol: Protocol
    cache: CacheFolder | None = None
    run_id: str = field(default_factory=lambda: uuid.uuid4().hex)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedRecording:
    """A recording as a run sees it.

    Attributes:
        units: its units; none where it cannot be used.
        fingerprint: of its data; None where it does not open.
        vehicle_outline_m: the host from above, vehicle frame.
        failure: why it cannot be used; None where it can.
        seconds: that opening took.
    """

    units: tuple[Unit, ...]
    fingerprint: str | None
    vehicle_outline_m: tuple[tuple[float, float], ...]
    failure: str | None
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitTask:
    """A unit to be scored.

    Attributes:
        handle: its recording.
        unit: which images.
        stored_key: key of the result that is stored already; None for none.
    """

    handle: RecordingHandle
    unit: Unit
    stored_key: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredUnit:
    """What became of a unit.

    Attributes:
        key: digest of all that the result depends on.
        files: the files to store, by suffix; None where the stored ones have this key, or the unit failed.
        failure: why there is no result; None where there is one.
        seconds: by stage.
        found: steps found in the cache, by name.
        computed: steps computed and kept, by name.
        peak_memory_mb: of the process so far.
    """

    key: str
    files: Mapping[str, bytes] | None
    failure: str | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    found: Mapping[str, int] = field(default_factory=dict)
    computed: Mapping[str, int] = field(default_factory=dict)
    peak_memory_mb: float = 0.0


def plan_recording(spec: RunSpec, handle: RecordingHandle) -> PlannedRecording:
    """Open a recording and list its units; what is wrong with it is told, not raised."""
    clock = StageClock()
    try:
        with clock.stage("open"):
            opened = _open(spec, handle)
            units = tuple(plan_units(opened.recording, spec.method))
    except BenchError as error:
        return PlannedRecording(
            units=(),
            fingerprint=None,
            vehicle_outline_m=(),
            failure=f"recording {handle.name!r}: {error}",
            seconds=clock.seconds["open"],
        )
    return PlannedRecording(
        units=units,
        fingerprint=recording_fingerprint(opened.recording),
        vehicle_outline_m=tuple((float(x), float(y)) for x, y in opened.recording.vehicle_outline_m),
        failure=None,
        seconds=clock.seconds["open"],
    )


def score_unit(spec: RunSpec, task: UnitTask) -> ScoredUnit:
    """Score a unit, unless what is stored has its key; what is wrong with it is told, not raised."""
    clock, unit = StageClock(), task.unit
    found, missed = (Counter(spec.cache.found), Counter(spec.cache.missed)) if spec.cache else (Counter(), Counter())
    key, files, failure = "", None, None
    try:
        with clock.stage("open"):
            opened = _open(spec, task.handle)
        with clock.stage("key"):
            inputs = opened.inputs.afresh()
            key = unit_key(spec, opened.recording, unit, inputs)
        if key != task.stored_key:
            steps = StepCache(folder=spec.cache, recording=opened.recording, inputs=inputs) if spec.cache else None
            tables = run_unit(
                opened.recording, unit, method=spec.method, protocol=spec.protocol, clock=clock, steps=steps
            )
            with clock.stage("key"):
                _refuse_change(spec, opened, unit, key)
            with clock.stage("store"):
                files = encode_unit(unit, tables, key=key)
    except BenchError as error:
        failure = f"recording {unit.recording!r}, camera {unit.camera!r}: {error}"
    except MemoryError:
        where = f"recording {unit.recording!r}, camera {unit.camera!r}, images {unit.start} to {unit.stop - 1}"
        failure = f"{where}: the memory that the process may use was not enough"
    return ScoredUnit(
        key=key,
        files=files,
        failure=failure,
        seconds=dict(clock.seconds),
        found=dict(spec.cache.found - found) if spec.cache else {},
        computed=dict(spec.cache.missed - missed) if spec.cache else {},
        peak_memory_mb=largest_resident_mb(),
    )


def unit_key(spec: RunSpec, recording: Recording, unit: Unit, inputs: RecordingInputs) -> str:
    """Digest of all that the result of a unit depends on."""
    method, images = spec.method, recording.images[unit.camera]
    reach_ns = spec.protocol.reference_settings().max_sweep_gap_ns
    first = max(unit.start - getattr(method, "longest_history", method.history) - 1, 0)
    read = images[first : unit.stop]
    return digest_of(
        UNIT_FORMAT,
        code_digest(UNIT_CODE),
        spec.protocol,
        method.name,
        method.settings(),
        method_digest(method),
        unit,
        recording.frame_interval_ns,
        inputs.camera(unit.camera),
        inputs.ego_motion,
        inputs.lidar_mounting,
        inputs.annotations,
        inputs.images(read),
        inputs.sweeps(read[0].timestamp_ns, read[-1].timestamp_ns, reach_ns=reach_ns),
    )


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


def _refuse_change(spec: RunSpec, opened: _Opened, unit: Unit, key: str) -> None:
    """Refuse a result of files that changed while they were read: nobody knows which of them it is of."""
    if unit_key(spec, opened.recording, unit, opened.inputs.afresh()) != key:
        raise DataError(
            opened.recording.root,
            wanted="files that stay the same while they are scored",
            came="other content at the end than at the beginning",
            do="run again when nobody writes there",
        )
