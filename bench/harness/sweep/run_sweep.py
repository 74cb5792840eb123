"""Run a sweep: images outside, values inside, so that memory stays flat and what values share is computed once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from itertools import count
from pathlib import Path
from typing import Literal

import pyarrow as pa

from bench.errors import BenchError, DataError
from bench.evaluation import Protocol, SequenceScorer, summarise
from bench.harness import provenance as origin
from bench.harness.cache import CacheFolder, StepCache
from bench.harness.frames import FramePipeline, UnscorableFrame
from bench.harness.keys import MethodIdentity, RecordingInputs
from bench.harness.method_stamp import MethodStamp
from bench.harness.stages import Progress, StageClock, recording_reporter
from bench.harness.sweep.definition import Value
from bench.harness.sweep.perturb import NONE
from bench.harness.sweep.plan import SweepPlan
from bench.harness.sweep.results import SCHEMA_VERSION, FlowCalls, SweepResult, SweepRow, write_sweep
from bench.harness.sweep.segmenter import TrialSegmenter, numbered
from bench.harness.sweep.trial import Trial
from bench.harness.units import Unit, plan_units
from bench.methods import Segmentation, UnansweredImage
from bench.recordings import DatasetCard, ImageRef, Recording, RecordingHandle, open_dataset
from bench.reference import ReferenceBuilder, ReferenceFrame
from bench.threads import single_threaded


def run_sweep(
    card: DatasetCard,
    *,
    plan: SweepPlan,
    out: Path,
    cache: CacheFolder | None,
    split: str | None = None,
    progress: Progress | None = None,
) -> SweepResult:
    """Score every value of a sweep on a data set and store the figures.

    An image is scored for all values or for none, so the values compare on the same images. Injected errors reach the
    method only; the reference keeps the true calibration and ego-motion.

    Args:
        card: the data set.
        plan: what to run.
        out: folder of the sweep; an older `sweep.json` in it is replaced.
        cache: for flow and references; None to keep nothing.
        split: of the data set; None for all of it.
        progress: called with the recordings done (with a fraction for the one at work) and their number.

    Returns:
        The figures, also stored as `sweep.json`.

    Raises:
        DataError: the data set is not there, or nothing of it could be used, or `cache` is a folder of other files.
    """
    start = origin.Start.now()
    handles = open_dataset(card, split)
    if cache is not None:
        cache.prepare()
    work = _Work(plan=plan, cache=cache, identity=MethodIdentity.of(plan.base.method))
    with single_threaded():
        for number, handle in enumerate(handles):
            work.run_recording(handle, recording_reporter(progress, number, len(handles)))
    if cache is not None:
        cache.make_room()
    if not work.units:
        raise DataError(card.file, expected="a recording that can be used", got="; ".join(work.failures) or "none")
    rows = work.rows()
    method = plan.base.method
    result = SweepResult(
        schema_version=SCHEMA_VERSION,
        what=plan.what,
        title=plan.sweep.title,
        about=plan.sweep.about,
        part=plan.sweep.part,
        scale=plan.sweep.scale,
        dataset=card.name,
        card=str(card.file),
        split=split,
        method=MethodStamp.of(method, MethodIdentity.of(method)),
        protocol=plan.base.protocol.name,
        rows=rows,
        flow=work.flow_calls(),
        provenance=origin.provenance_since(
            start,
            fingerprints=work.fingerprints,
            stage_seconds=work.clock.seconds,
            images=rows[0].false_positives.frames,
        ),
        failures=tuple(work.failures),
    )
    write_sweep(out, result)
    return result


@dataclass(kw_only=True)
class _Work:
    """What piles up while a sweep goes on: the rows of the two tables, per value."""

    plan: SweepPlan
    cache: CacheFolder | None
    identity: MethodIdentity
    clock: StageClock = field(default_factory=StageClock)
    fingerprints: list[str] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    tables: list[list[tuple[pa.Table, pa.Table]]] = field(default_factory=list)
    units: int = 0
    _opened: Recording | None = None
    _inputs: RecordingInputs | None = None

    def __post_init__(self) -> None:
        self.tables = [[] for _ in self.plan.trials]

    def run_recording(self, handle: RecordingHandle, report: Callable[[float], None]) -> None:
        """Score one recording; what fails is listed and the rest goes on."""
        try:
            with self.clock.stage("open"):
                recording = handle.open()
                self.fingerprints.append(origin.recording_fingerprint(recording))
            units = list(plan_units(recording, self.plan.base.method))
        except BenchError as error:
            self.failures.append(f"recording {handle.name!r}: {error}")
            units = []
        total, done = sum(unit.stop - unit.start for unit in units), count(1)
        for unit in units:
            try:
                self._run_unit(recording, unit, lambda: report(next(done) / total))
            except BenchError as error:
                self.failures.append(f"recording {unit.recording!r}, camera {unit.camera!r}: {error}")
        report(1.0)

    def steps(self, recording: Recording) -> StepCache | None:
        """Where steps on a recording are kept; its files are read afresh for each unit."""
        if self.cache is None:
            return None
        if self._inputs is None or self._opened is not recording:
            self._opened, self._inputs = recording, RecordingInputs(recording)
        return StepCache(folder=self.cache, recording=recording, inputs=self._inputs.afresh(), identity=self.identity)

    def rows(self) -> tuple[SweepRow, ...]:
        """The figures of every value."""
        with self.clock.stage("summary"):
            return tuple(
                _row(value, trial, tables, operating=value == self.plan.operating)
                for value, trial, tables in zip(self.plan.values, self.plan.trials, self.tables, strict=True)
            )

    def flow_calls(self) -> FlowCalls:
        """Where the flow came from; without a cache nobody counts."""
        computed, read = (0, 0) if self.cache is None else (self.cache.missed["flow"], self.cache.found["flow"])
        return FlowCalls(computed=computed, read=read)

    def _run_unit(self, recording: Recording, unit: Unit, advance: Callable[[], None]) -> None:
        run = _UnitSweep(recording, unit, self)
        for index in range(unit.start, unit.stop):
            run.score(index)
            advance()
        self.failures += run.problems
        for collected, tables in zip(self.tables, run.finish(), strict=True):
            collected.append(tables)
        self.units += 1


class _UnitSweep:
    """The images of a unit, scored for every value."""

    def __init__(self, recording: Recording, unit: Unit, work: _Work) -> None:
        base, trials = work.plan.base, work.plan.trials
        self._unit, self._clock = unit, work.clock
        self._steps = work.steps(recording)
        self._pipeline = FramePipeline(
            recording, unit.camera, method=base.method, protocol=base.protocol, clock=work.clock, steps=self._steps
        )
        settings = [trial.protocol.reference_settings() for trial in trials]
        self._reference_of = numbered(settings)
        self._builders = {
            number: ReferenceBuilder(recording, unit.camera, setting)
            for number, setting in dict(zip(self._reference_of, settings, strict=True)).items()
        }
        self._scorers = [SequenceScorer(trial.protocol) for trial in trials]
        self._segmenter = TrialSegmenter(trials, recording=recording, unit=unit, clock=work.clock)
        self.problems: list[str] = []

    def score(self, index: int) -> None:
        """Score an image for all values, or leave it out for all."""
        try:
            given = self._pipeline.method_input(index)
            segmentations = self._segmenter.segment(given)
            self._pipeline.refuse_damaged(given)
            with self._clock.stage("reference"):
                image = self._pipeline.images[index]
                references = {number: self._reference(builder, image) for number, builder in self._builders.items()}
        except (UnscorableFrame, UnansweredImage) as reason:
            self._leave_out(index, "skipped", str(reason))
        except BenchError as error:
            self.problems.append(str(error))
            self._leave_out(index, "failed", str(error))
        else:
            with self._clock.stage("counts"):
                self._count(references, segmentations)

    def finish(self) -> list[tuple[pa.Table, pa.Table]]:
        """The two tables of every value."""
        with self._clock.stage("counts"):
            return [scorer.finish() for scorer in self._scorers]

    def _reference(self, builder: ReferenceBuilder, image: ImageRef) -> ReferenceFrame:
        return builder.build(image) if self._steps is None else self._steps.reference(builder, image)

    def _count(self, references: dict[int, ReferenceFrame], segmentations: list[Segmentation]) -> None:
        for scorer, number, segmentation in zip(self._scorers, self._reference_of, segmentations, strict=True):
            scorer.add(references[number], segmentation)

    def _leave_out(self, index: int, status: Literal["failed", "skipped"], problem: str) -> None:
        for scorer in self._scorers:
            scorer.leave_out(
                recording=self._unit.recording,
                camera=self._unit.camera,
                timestamp_ns=self._pipeline.images[index].timestamp_ns,
                status=status,
                problem=problem,
            )


def _row(value: Value, trial: Trial, tables: list[tuple[pa.Table, pa.Table]], *, operating: bool) -> SweepRow:
    objects, frames = (pa.concat_tables(parts) for parts in zip(*tables, strict=True))
    protocol: Protocol = trial.protocol
    figures = summarise(objects, frames, protocol=protocol)
    return SweepRow(
        value=value,
        operating=operating,
        settings=trial.method.settings(),
        protocol_digest=protocol.digest,
        injected={name: error for name, error in asdict(trial.injection).items() if error != getattr(NONE, name)},
        categories=figures.categories,
        all_moving=figures.all_moving,
        false_positives=figures.false_positives,
    )
