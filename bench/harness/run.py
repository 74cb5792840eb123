"""A whole run: data set, method and protocol in, tables and a summary out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter

from bench.errors import DataError, UsageError
from bench.evaluation import Protocol, sum_run, summary_of, write_sums
from bench.evaluation.summary import ProtocolOfRun, Summary, not_annotated
from bench.execution import FailedTask, SerialExecutor, TaskExecutor
from bench.harness.cache import CacheFolder
from bench.harness.code_state import unrepeatable_code
from bench.harness.digests import MethodCode
from bench.harness.manifest import CodeOfRun, DatasetOfRun, Manifest, all_settings
from bench.harness.method_of_run import MethodOfRun
from bench.harness.provenance import Provenance, Work, largest_resident_mb, provenance_since
from bench.harness.reference_files import ReferenceFolder
from bench.harness.run_folder import begin_run, held_run_folder, new_results
from bench.harness.stages import Progress, add_up
from bench.harness.stored import IMAGE_MAPS, SUMS, StoredRun, open_tables, write_run
from bench.harness.tasks import PlannedRecording, RunSpec, ScoredUnit, UnitTask, plan_recording, score_unit
from bench.harness.unit import Part, Unit
from bench.harness.unit_files import UnitStore
from bench.methods import Scorable
from bench.methods.contract import own_copy
from bench.plain_text import listed
from bench.recordings import NO_INPUT_ERRORS, DatasetCard, InputErrors, RecordingHandle, open_dataset
from bench.recordings.openlabel import NOT_REVIEWED

SERIAL = SerialExecutor()
LARGEST_BATCH = 16  # recordings a worker
LISTED = 3  # modules that are named

Finish = Callable[[StoredRun], object]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunRequest:
    """Runs of a method that are asked for: what is scored, where the results go, how they are computed.

    Attributes:
        card: the data set.
        method: to be scored.
        runs: the folder of each run, and the protocol that it is scored by; at least one.
        settings: of the method, as they were asked for.
        split: of the data set; None for all of it.
        input_errors: injected into the method's input; the reference keeps the true calibration and ego-motion.
        exported: where the reference is read from; None to build it from the data.
        overwrite: replace other runs in the folders.
        executor: computes the units; the result does not depend on it.
        cache: where flow, likelihood and reference are stored for other runs; None to store nothing.
        progress: called with the images done and their number, which is 0 while none is known and estimated while
            recordings are not open yet.
    """

    card: DatasetCard
    method: Scorable
    runs: Mapping[Path, Protocol]
    settings: Mapping[str, object] = field(default_factory=dict)
    split: str | None = None
    input_errors: InputErrors = NO_INPUT_ERRORS
    exported: ReferenceFolder | None = None
    overwrite: bool = False
    executor: TaskExecutor = SERIAL
    cache: CacheFolder | None = None
    progress: Progress | None = None

    def recordings(self) -> list[RecordingHandle]:
        """The recordings to be scored, with the input errors."""
        return [replace(handle, input_errors=self.input_errors) for handle in open_dataset(self.card, self.split)]

    def manifest(self, rules: Protocol, method_code: MethodCode) -> Manifest:
        """The manifest of the run by one protocol, as far as it is known before it begins.

        Args:
            rules: of `runs`.
            method_code: of the method.
        """
        errors = dict(self.input_errors.named)
        return Manifest(
            dataset=DatasetOfRun(name=self.card.name, card=self.card.address, split=self.split, input_errors=errors),
            method=MethodOfRun.of(self.method, method_code, asked=self.settings),
            protocol=ProtocolOfRun(name=rules.name, version=rules.version, digest=rules.digest),
            code=CodeOfRun.here(),
        ).as_read()


def run_benchmark(request: RunRequest, *, finish: Finish | None = None) -> dict[Path, StoredRun]:
    """Score a method on a data set by one or several protocols, in one pass over the images, and store each run.

    Units that are stored in the folder of a run are done: what an interrupted run, or parts of this one, computed is
    not computed again while all that it depends on is the same: protocol, method, settings, code, and the content of
    the files that they read. The results of an older run stay as they are until all of the new ones take their place
    at once.

    Args:
        request: the runs.
        finish: called for each run before its new results take their place, while they lie in a folder of their own;
            writes what else belongs to them, for example tables and pictures.

    Returns:
        The runs by folder. Recordings, units and images that could not be used are listed in `summary.failures`; the
        metrics are of the rest.

    Raises:
        DataError: the data set is not there, nothing of it could be used, a folder holds another run or something that
            is no run or is in use by another one, or there is no space for the results.
        UsageError: the method cannot be copied for each unit, or other processes cannot import it.
    """
    handles = request.recordings()  # before anything is written
    stored = {}
    with _begun(request, shared=False) as (spec, manifests):
        with ExitStack() as replaced:
            folders = {run: replaced.enter_context(new_results(run)) for run in request.runs}
            scored = _score(request, spec, handles, Part())
            unrepeatable = unrepeatable_code(spec.method_code)
            for run, results in folders.items():
                found = _write_results(results, request, run, scored, manifests[run], unrepeatable)
                if finish is not None:
                    finish(found)
                stored[run] = replace(found, folder=run)
        for run in request.runs:
            UnitStore(run=run).keep_only(scored.digests(run), spec.parts.values())
    return stored


def score_part(request: RunRequest, part: Part) -> ScoredPart:
    """Score a part of the units of runs and store them; `run_benchmark` finds them done.

    Parts may work at the same time, in one folder; from others, the folders `units/` are copied together.

    Args:
        request: the runs.
        part: which units.

    Raises:
        DataError, UsageError: as `run_benchmark`, but for a part of which nothing could be used.
    """
    handles = request.recordings()
    with _begun(request, shared=True) as (spec, _):
        return _score(request, spec, handles, part)


@dataclass(kw_only=True)
class ScoredPart:
    """The units of a part of a run, as far as they are scored.

    Attributes:
        recordings: of the data set.
        units_of_run: how many units all parts have together.
        units: of this part, in the order of the run.
        results: of these units.
        images: of these units.
        images_done: of those that have a result, or failed.
        workers: processes.
        parts: what the code and the method are made of; see `RunSpec.parts`.
        start_s: when it began, by `time.perf_counter`.
    """

    workers: int
    parts: Mapping[str, Mapping[str, str]]
    recordings: list[PlannedRecording] = field(default_factory=list)
    units_of_run: int = 0
    units: list[Unit] = field(default_factory=list)
    results: dict[Unit, ScoredUnit] = field(default_factory=dict)
    images: int = 0
    images_done: int = 0
    start_s: float = field(default_factory=perf_counter)

    def digests(self, run: Path) -> dict[Unit, str]:
        """The units that have a result in the folder of a run, in the order of the run, with its digest."""
        found = ((unit, self.results[unit].digests.get(run)) for unit in self.units)
        return {unit: digest for unit, digest in found if digest is not None}

    def failures(self, run: Path) -> list[str]:
        """One line for each recording and unit that could not be used."""
        done = self.digests(run)
        failed = [str(self.results[unit].failure) for unit in self.units if unit not in done]
        return [recording.failure for recording in self.recordings if recording.failure is not None] + failed

    def provenance(self, run: Path, *, images: int) -> Provenance:
        """Provenance of the results in the folder of a run, so far."""
        results, opening_s = list(self.results.values()), sum(recording.seconds for recording in self.recordings)
        computed = [unit for unit, result in self.results.items() if run in result.computed]
        return provenance_since(
            self.start_s,
            stage_seconds=add_up([{"open": opening_s}, *(result.seconds for result in results)]),
            images=images,
            work=Work(
                workers=self.workers,
                units_computed=len(computed),
                units_reused=len(self.digests(run)) - len(computed),
                images_computed=sum(unit.images for unit in computed),
                changed=self._changed(run),
                steps_found=add_up(result.steps_found for result in results),
                steps_computed=add_up(result.steps_computed for result in results),
            ),
            peak_memory_mb=max([largest_resident_mb(), *(result.peak_memory_mb for result in results)]),
        )

    def _changed(self, run: Path) -> dict[str, int]:
        """Count the units that were computed again, by what changed; of code with the names of modules."""
        count: Counter[str] = Counter()
        for result in self.results.values():
            for name, digest in result.changed.items():
                changed = UnitStore(run=run).changed_parts(digest, self.parts[name]) if name in self.parts else []
                count[f"{name}: {listed(changed, LISTED)}" if changed else name] += 1
        return dict(sorted(count.items()))


@contextmanager
def _begun(request: RunRequest, *, shared: bool) -> Iterator[tuple[RunSpec, dict[Path, Manifest]]]:
    """Hold the folders of runs, and note of what run each is: what their tasks have in common, and the manifests.

    Raises:
        UsageError: the method cannot be copied for each unit, or other processes cannot import it.
    """
    own_copy(request.method)
    method_code = MethodCode.of(request.method)
    if method_code.unidentified and not isinstance(request.executor, SerialExecutor):
        raise UsageError(
            f"method {request.method.name!r}: expected code that other processes can import, got "
            f"{method_code.unidentified}, which this process defined or changed; put it into a file, or score with one "
            f"worker"
        )
    manifests = {run: request.manifest(rules, method_code) for run, rules in request.runs.items()}
    spec = RunSpec(
        method=request.method,
        method_code=method_code,
        settings=all_settings(next(iter(manifests.values())).method),
        protocols=request.runs,
        cache=request.cache,
        exported=request.exported,
    )
    with ExitStack() as held:
        for run, manifest in manifests.items():
            held.enter_context(held_run_folder(run, shared=shared))
            begin_run(run, manifest, overwrite=request.overwrite)
            for parts in spec.parts.values():
                UnitStore(run=run).write_parts(parts)
        yield spec, manifests


def _score(request: RunRequest, spec: RunSpec, handles: Sequence[RecordingHandle], part: Part) -> ScoredPart:
    """Open recordings, score the units of a part and store them."""
    if request.cache is not None:
        request.cache.prepare()
    scored = ScoredPart(workers=request.executor.workers, parts=spec.parts)

    def tell() -> None:
        """Recordings that are not open yet count as large as those that are."""
        if request.progress is not None:
            expected = scored.images * len(handles) / max(len(scored.recordings), 1)
            request.progress(scored.images_done, round(expected))

    tell()
    with request.executor:
        for batch in _batches(handles, request.executor.workers):
            opened = _plan(spec, request.executor, batch)
            planned = [unit for recording in opened for unit in recording.units]
            units = part.of(planned, before=scored.units_of_run)
            scored.recordings += opened
            scored.units_of_run += len(planned)
            scored.units += units
            scored.images += sum(unit.images for unit in units)
            tell()
            for unit, result in _score_units(spec, request.executor, batch, units):
                scored.results[unit] = result
                scored.images_done += unit.images
                tell()
    if request.cache is not None:
        request.cache.evict()
    return scored


def _batches(handles: Sequence[RecordingHandle], workers: int) -> Iterator[Sequence[RecordingHandle]]:
    """Recordings that are opened before the next images are scored.

    One at a time is opened once. Of several workers each opens the recordings of its images, so that larger batches
    let them wait for each other less; the first ones are small, so that there are results soon.
    """
    start, size = 0, workers
    while start < len(handles):
        yield handles[start : start + size]
        start, size = start + size, min(2 * size, LARGEST_BATCH * workers) if workers > 1 else 1


def _plan(spec: RunSpec, executor: TaskExecutor, handles: Sequence[RecordingHandle]) -> list[PlannedRecording]:
    """The recordings in the order of the data set."""
    found: dict[str, PlannedRecording] = {}
    with closing(executor.compute(partial(plan_recording, spec), handles)) as results:
        for handle, planned in results:
            if isinstance(planned, FailedTask):
                failure = f"recording {handle.name!r}: it could not be opened: {planned.reason}"
                planned = PlannedRecording(name=handle.name, failure=failure)
            found[handle.name] = planned
    return [found[handle.name] for handle in handles]


def _score_units(
    spec: RunSpec, executor: TaskExecutor, handles: Sequence[RecordingHandle], units: Sequence[Unit]
) -> Iterator[tuple[Unit, ScoredUnit]]:
    """Each unit with its result, as it is done and stored."""
    by_name = {handle.name: handle for handle in handles}
    stores = {run: UnitStore(run=run) for run in spec.protocols}
    tasks = [
        UnitTask(
            handle=by_name[unit.recording],
            unit=unit,
            stored=None if executor.shares_disk else {run: store.stored(unit) for run, store in stores.items()},
        )
        for unit in sorted(units, key=lambda unit: -unit.images)  # the longest first, to end together
    ]
    with closing(executor.compute(partial(score_unit, spec), tasks)) as results:
        for task, scored in results:
            unit = task.unit
            if isinstance(scored, FailedTask):
                yield unit, ScoredUnit(failure=f"{unit}: {scored.reason}")
                continue
            for run, content in scored.contents.items():
                stores[run].write(unit, scored.digests[run], content)
            yield unit, replace(scored, contents={})


def _write_results(
    results: Path,
    request: RunRequest,
    run: Path,
    scored: ScoredPart,
    manifest: Manifest,
    unrepeatable: tuple[str, ...],
) -> StoredRun:
    """Reduce the stored units of a run to its tables, its sums and its summary.

    Raises:
        DataError: a unit is damaged, or nothing could be used.
    """
    protocol = request.runs[run]
    units, failures = scored.digests(run), scored.failures(run)
    if not units:
        got = "; ".join(failures) or "no image to score"
        raise DataError(request.card.file, expected="a recording that can be used", got=got)
    problems = UnitStore(run=run).join(units, results, maps_name=IMAGE_MAPS)
    sums = sum_run(*open_tables(results), protocol=protocol)
    write_sums(sums, results / SUMS)
    metrics = summary_of(sums, protocol=protocol)
    outlines = [recording.vehicle_outline_m for recording in scored.recordings if recording.vehicle_outline_m]
    digests = {one.name: one.digest for one in scored.recordings if one.digest is not None}
    if not (metrics.images.evaluated or metrics.images.not_annotated or problems):
        reasons = [f"{problem} ({count})" for problem, count in metrics.images.problems.items()]
        failures.append(f"no image was scored; {listed(reasons)}" if reasons else "no image was scored")
    images = metrics.images.evaluated + metrics.images.not_annotated
    return write_run(
        results,
        metrics,
        manifest=manifest.with_data(digests),
        protocol=protocol,
        provenance=scored.provenance(run, images=images).model_copy(update={"unrepeatable": unrepeatable}),
        failures=[*failures, *problems],
        caveats=_caveats(request, metrics, scored.recordings),
        vehicle_outline_m=outlines[-1] if outlines else (),
    )


def _caveats(request: RunRequest, metrics: Summary, recordings: Sequence[PlannedRecording]) -> str:
    """Caveats for a reader: annotations not there or not reviewed, those of the data, errors of the method's input."""
    proposed = sum(not one.reviewed for one in recordings)
    unreviewed = f"{NOT_REVIEWED} ({proposed} of {len(recordings)} recordings)." if proposed else ""
    told = [f"{name} {error:g}" for name, error in request.input_errors.named.items()]
    errors = f"The method was told errors of its input: {', '.join(told)}." if told else ""
    exported = "" if request.exported is None else f"The reference was read from {request.exported.folder.name}."
    return "\n".join(
        part for part in (unreviewed, not_annotated(metrics), request.card.content.caveats, errors, exported) if part
    )
