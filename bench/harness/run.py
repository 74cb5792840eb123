"""A whole run: data set, method and protocols in, answers, counts, sums and summaries out.

Its two tasks, to look at a recording and to take some images of a camera through all stages, run in workers. What is
computed is written to files; a file that is there is done, whoever wrote it.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter

from bench.atomic import folder_lock, is_temporary, make_folder
from bench.errors import BenchError, DataError, OutputError, UsageError
from bench.evaluation.protocol import Protocol
from bench.execution import FailedTask, Progress, SerialExecutor, TaskExecutor, compute_all
from bench.flow.dense import evict_flow, memoise_flow
from bench.harness.answers import (
    ANSWERS,
    FAILED,
    SKIPPED,
    Answer,
    answer_row,
    answers_agree,
    no_answer,
    read_answers,
    safe_name,
    write_answers,
)
from bench.harness.counts import COUNTS, count_answers, counts_mark, write_counts
from bench.harness.digests import digest_recording
from bench.harness.exact import is_oracle
from bench.harness.frames import FramePipeline, UnscorableFrame
from bench.harness.manifest import (
    ANSWERS_MANIFEST,
    MANIFEST,
    RECORDING_DIGEST_CHARS,
    AnswersManifest,
    Aspect,
    CodeOfRun,
    DatasetOfRun,
    MethodOfRun,
    differences,
    method_digest,
    read_manifest,
    write_manifest,
)
from bench.harness.references import StoredReference, evict_cache, find_references, message_without_root, reference_of
from bench.harness.stored import (
    RESULT_FILES,
    SUMMARY,
    Provenance,
    StoredRun,
    provenance_since,
    write_results,
)
from bench.methods import Scorable
from bench.methods.contract import own_copy
from bench.plain_text import listed
from bench.recordings import DatasetCard, ImageRef, Recording, RecordingHandle, open_dataset
from bench.recordings.annotations import NOT_REVIEWED
from bench.recordings.validation import read_json
from bench.records.recording import NO_INPUT_ERRORS, InputErrors

SERIAL = SerialExecutor()
LISTED = 3
REPLACE = "give another folder with --out, or replace what is there with --overwrite"

TASK_IMAGES = 100  # bounds what is held before it is written; many times the lag of the chance level

Part = tuple[int, int]  # number, from 1, and count: every `count`-th task of a run, from the `number`-th on
WHOLE: Part = (1, 1)


def parse_part(text: str) -> Part:
    """The part of a run that "2/8" names.

    Raises:
        UsageError: anything else.
    """
    numbers = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text)
    if not numbers or not 1 <= int(numbers[1]) <= int(numbers[2]):
        raise UsageError(f"--shard: expected I/N with I from 1 to N, for example 2/8, got {text!r}")
    return int(numbers[1]), int(numbers[2])


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Images from `start` up to, not including, `stop` of a camera; the method may read images before `start`.

    Attributes:
        handle: of the recording.
        camera: name.
        start: index of the first image to score.
        stop: index after the last.
        digest: of the recording's content.
    """

    handle: RecordingHandle
    camera: str
    start: int
    stop: int
    digest: str

    def __str__(self) -> str:
        return f"recording {self.handle.name!r}, camera {self.camera!r}, images {self.start} to {self.stop - 1}"

    @property
    def images(self) -> int:
        """Number of images to score."""
        return self.stop - self.start

    @property
    def place(self) -> str:
        """Of its files, below the folder of a stage and without their suffix."""
        return f"{safe_name(self.handle.name)}/{safe_name(self.camera)}-{self.start:08d}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunRequest:
    """A run of a method that is asked for: what is scored, and where the results go. Workers are handed it.

    Attributes:
        card: the data set.
        method: to be scored.
        folder: of the run; the results by a protocol lie in a folder of its name below.
        protocols: the rules; at least one.
        settings: of the method, as they were asked for.
        split: of the data set; None for all of it.
        input_errors: injected into the method's input; the reference keeps the true calibration and ego-motion.
        overwrite: replace another run in the folder.
        flow_cache: where dense flow is stored for other runs; None for nowhere.
    """

    card: DatasetCard
    method: Scorable
    folder: Path
    protocols: Sequence[Protocol]
    settings: Mapping[str, object] = field(default_factory=dict)
    split: str | None = None
    input_errors: InputErrors = NO_INPUT_ERRORS
    overwrite: bool = False
    flow_cache: Path | None = None

    @property
    def results(self) -> dict[Path, Protocol]:
        """The protocols by the folder of their results."""
        return {self.folder / safe_name(protocol.name): protocol for protocol in self.protocols}

    def recordings(self) -> list[RecordingHandle]:
        """The recordings to be scored, with the input errors."""
        return [replace(handle, input_errors=self.input_errors) for handle in open_dataset(self.card, self.split)]

    def answers(self, results: Path, task: Task) -> Path:
        """File of the answers of a task that are scored by a protocol; those of an oracle depend on it."""
        folder = results if is_oracle(self.method) else self.folder
        return folder / ANSWERS / f"{task.place}.parquet"

    def is_answered(self, task: Task) -> bool:
        """True where all answers of a task are there."""
        return all(self.answers(results, task).is_file() for results in self.results)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedRecording:
    """A recording as a run sees it.

    Attributes:
        name: of the recording.
        tasks: none where it cannot be used.
        digest: of its content; None where it does not open.
        vehicle_outline_m: the ego vehicle from above, vehicle frame.
        reviewed: False for proposed objects that nobody has reviewed.
        failure: why it cannot be used; "" where it can.
    """

    name: str
    tasks: tuple[Task, ...] = ()
    digest: str | None = None
    vehicle_outline_m: tuple[tuple[float, float], ...] = ()
    failure: str = ""
    reviewed: bool = True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScoredPart:
    """The tasks of a run, or of a part of one, done.

    Attributes:
        results: by each protocol; none of a part.
        failures: one line for each recording and task that could not be used.
        tasks: how many this part has.
        done: how many of these have results.
        tasks_of_run: how many all parts have together.
        provenance: how the answers came about; no image is scored yet.
    """

    results: Sequence[StoredRun]
    failures: Sequence[str]
    tasks: int
    done: int
    tasks_of_run: int
    provenance: Provenance


def run_benchmark(
    request: RunRequest, *, part: Part = WHOLE, executor: TaskExecutor = SERIAL, progress: Progress | None = None
) -> ScoredPart:
    """Score a method on a data set by one or several protocols, and store what it answered, counted and summed.

    What is there already of the same run is not computed again: the method is asked once for any number of protocols,
    and an interrupted run, or parts of this one, go on where they were. Parts may work at the same time, in one folder;
    from others, the folders are copied together.

    Args:
        request: the run.
        part: which of its tasks; without the others nothing is summed.
        executor: computes the tasks; the result does not depend on it.
        progress: called with the images done and their number, which is 0 while none is known.

    Returns:
        The results by each protocol. Recordings, tasks and images that could not be used are listed in
        `summary.failures`; the metrics are of the rest.

    Raises:
        DataError: the data set is not there, nothing of it could be used, the folder holds another run or something
            that is no run or is in use by another one, or there is no space for the results.
        UsageError: the method cannot be copied for each task, or other processes cannot import it.
    """
    start_s, handles, alone = perf_counter(), request.recordings(), part == WHOLE  # before anything is written
    method = _identify(request, executor)
    make_folder(request.folder)
    with folder_lock(request.folder, shared=not alone, wait=False), executor:
        refuse_foreign(request.folder)
        if progress is not None:
            progress(0, 0)
        recordings = _plan(request, handles, executor)
        manifest = _begin(request, method, recordings)
        tasks_of_run = [task for recording in recordings for task in recording.tasks]
        tasks = tasks_of_run[part[0] - 1 :: part[1]]
        try:
            images_asked, failed = _process_all(request, manifest, tasks, executor, progress)
        finally:
            if alone:  # a worker, or a run before, may have been killed while it wrote, and nobody else writes here
                _remove(*(entry for entry in request.folder.rglob(".*") if is_temporary(entry.name)))
        evict_cache()
        if request.flow_cache is not None:
            evict_flow(request.flow_cache)
        scored = ScoredPart(
            results=(),
            failures=[*filter(None, (recording.failure for recording in recordings)), *failed],
            tasks=len(tasks),
            done=len(tasks) - len(failed),
            tasks_of_run=len(tasks_of_run),
            provenance=provenance_since(start_s, images_asked=images_asked, workers=executor.workers),
        )
        return replace(scored, results=_reduce(request, manifest, recordings, scored)) if alone else scored


def _identify(request: RunRequest, executor: TaskExecutor) -> MethodOfRun:
    """The method, which each task gets a copy of.

    Raises:
        UsageError: it cannot be copied, or other processes cannot import it.
    """
    own_copy(request.method)
    method = MethodOfRun.of(request.method, asked=request.settings)
    if not (method.is_identified or isinstance(executor, SerialExecutor)):
        raise UsageError(
            f"method {method.name!r}: expected code that other processes can import, got {method.place}, which no file "
            f"holds; put it into a file, or score with one worker"
        )
    return method


def _plan(request: RunRequest, handles: Sequence[RecordingHandle], executor: TaskExecutor) -> list[PlannedRecording]:
    """The recordings in the order of the data set."""
    planned = compute_all(executor, partial(plan_recording, request.method), handles)
    return [
        PlannedRecording(name=handle.name, failure=f"recording {handle.name!r}: it could not be opened: {one.reason}")
        if isinstance(one, FailedTask)
        else one
        for handle, one in zip(handles, planned, strict=True)
    ]


def _process_all(
    request: RunRequest,
    manifest: AnswersManifest,
    tasks: Sequence[Task],
    executor: TaskExecutor,
    progress: Progress | None,
) -> tuple[int, list[str]]:
    """Compute tasks; the number of images that were asked of, and one line for each task that failed."""
    failures = dict.fromkeys(map(str, tasks), "")
    total, done = sum(task.images for task in tasks), 0
    unanswered = [task for task in tasks if not request.is_answered(task)]

    def compute(function: Callable[[RunRequest, AnswersManifest, Task], str], tasks: Sequence[Task]) -> Iterator[Task]:
        with closing(executor.compute(partial(function, request, manifest), tasks)) as results:
            for task, failure in results:
                if isinstance(failure, FailedTask):
                    failure = f"method {request.method.name!r}, {task}: {failure.reason}"
                failures[str(task)] = failure or failures[str(task)]
                yield task

    longest_first = sorted(tasks, key=lambda task: -task.images)  # to end together
    for task in compute(process_task, longest_first):
        done += task.images
        if progress is not None:
            progress(done, total)
    asked = [task for task in unanswered if request.is_answered(task)]
    if not is_oracle(request.method):
        for _ in compute(ask_again, asked[:1]):
            pass
    return sum(task.images for task in asked), [*filter(None, failures.values())]


def _begin(request: RunRequest, method: MethodOfRun, recordings: Sequence[PlannedRecording]) -> AnswersManifest:
    """Note of what run the folder is; of what is there, only that of the same run stays.

    Raises:
        DataError: the folder holds another run and `overwrite` is not set, or a damaged manifest.
    """
    digests = {one.name: one.digest[:RECORDING_DIGEST_CHARS] for one in recordings if one.digest is not None}
    dataset = DatasetOfRun(
        name=request.card.name,
        card=request.card.address,
        split=request.split,
        input_errors=dict(request.input_errors.named),
        recordings=dict(sorted(digests.items())),
    )
    manifest = AnswersManifest(dataset=dataset, method=method, code=CodeOfRun.here())
    file = request.folder / ANSWERS_MANIFEST
    is_begun = any(request.folder.rglob("*.parquet"))  # what did not open has left no result to be lost
    there = read_json(AnswersManifest, file) if is_begun else None
    others = _other_aspects(there, manifest, request, folder=request.folder)
    if there is None or not method.is_identified or others - {Aspect.DATA}:
        _remove(request.folder / ANSWERS)
        for results in request.folder.glob(f"*/{MANIFEST}"):
            _remove_results(results.parent)
    elif others:
        was = there.dataset.recordings
        for name in (name for name in was if was[name] != dataset.recordings.get(name)):
            for place in (ANSWERS, f"*/{ANSWERS}", f"*/{COUNTS}"):
                _remove(*request.folder.glob(f"{place}/{safe_name(name)}"))
    write_manifest(file, manifest)
    for results, protocol in request.results.items():
        mine, stored = manifest.by(protocol), read_manifest(results)
        if stored is None or _other_aspects(stored, mine, request, folder=results, of={Aspect.PROTOCOL, Aspect.CODE}):
            _remove_results(results)
        if not (results / SUMMARY).is_file():
            write_manifest(results / MANIFEST, mine)
    return manifest


def _other_aspects(
    stored: AnswersManifest | None,
    asked: AnswersManifest,
    request: RunRequest,
    *,
    folder: Path,
    of: Set[Aspect] = frozenset(Aspect),
) -> set[Aspect]:
    """What decides results and is another in the stored run.

    Raises:
        DataError: there is such, and `overwrite` is not set.
    """
    others = [] if stored is None else [one for one in differences(stored, asked) if one.decides and one.aspect in of]
    if others and not request.overwrite:
        got, hint = f"another one: {'; '.join(map(str, others))}", REPLACE
        raise DataError(folder, expected="an empty folder or the run that is asked for", got=got, hint=hint)
    return {one.aspect for one in others}


def refuse_foreign(folder: Path) -> None:
    """Refuse a folder that holds something and is no run's.

    Raises:
        DataError: it is.
    """
    if folder.is_dir() and not (folder / ANSWERS_MANIFEST).is_file():
        foreign = sorted(entry.name for entry in folder.iterdir() if not is_temporary(entry.name))
        if foreign:
            got = f"one with {listed(foreign, LISTED)}, and without {ANSWERS_MANIFEST}"
            hint = "give another folder with --out, or move what is in it"
            raise DataError(folder, expected="an empty folder or that of a run", got=got, hint=hint)


def _remove_results(results: Path) -> None:
    """Remove the results by a protocol; what this program did not write stays."""
    for pattern in RESULT_FILES:
        _remove(*results.glob(pattern))


def _remove(*places: Path) -> None:
    for place in places:
        if place.is_dir() and not place.is_symlink():
            shutil.rmtree(place)
        else:
            place.unlink(missing_ok=True)


def _reduce(
    request: RunRequest, manifest: AnswersManifest, recordings: Sequence[PlannedRecording], scored: ScoredPart
) -> list[StoredRun]:
    """Reduce the counts of a run to its results by each protocol.

    Raises:
        DataError: counts are damaged, or nothing could be used.
    """
    if not scored.done:
        got = "; ".join(scored.failures) or "no image to score"
        where = f"data set {request.card.name!r}, method {request.method.name!r}"
        raise DataError(where, expected="a recording that can be used", got=got)
    outlines = [recording.vehicle_outline_m for recording in recordings if recording.vehicle_outline_m]
    return [
        write_results(
            results,
            manifest=manifest.by(protocol),
            protocol=protocol,
            provenance=scored.provenance,
            failures=scored.failures,
            caveats=[*_caveats(request, recordings)],
            vehicle_outline_m=outlines[-1] if outlines else (),
        )
        for results, protocol in request.results.items()
    ]


def _caveats(request: RunRequest, recordings: Sequence[PlannedRecording]) -> Iterator[str]:
    """Caveats for a reader: annotations that were not reviewed, those of the card, errors of the method's input."""
    if proposed := sum(not one.reviewed for one in recordings):
        yield f"{NOT_REVIEWED} ({proposed} of {len(recordings)} recordings)."
    yield request.card.content.caveats
    if told := [f"{name} {error:g}" for name, error in request.input_errors.named.items()]:
        yield f"The method was told errors of its input: {', '.join(told)}."


def plan_recording(method: Scorable, handle: RecordingHandle) -> PlannedRecording:
    """Open a recording, take its digest and list its tasks; what is wrong with it is returned, not raised."""
    try:
        recording = handle.open()
        digest = digest_recording(recording)
    except BenchError as error:
        return PlannedRecording(name=handle.name, failure=f"recording {handle.name!r}: {error}")
    return PlannedRecording(
        name=handle.name,
        tasks=tuple(cut_tasks(handle, recording, digest, method)),
        digest=digest,
        vehicle_outline_m=tuple((float(x), float(y)) for x, y in recording.vehicle_outline_m),
        reviewed=all(track.reviewed for track in recording.tracks),
    )


def cut_tasks(handle: RecordingHandle, recording: Recording, digest: str, method: Scorable) -> Iterator[Task]:
    """Cut a recording into tasks; a camera's first images, without history or not to be scored, belong to none."""
    for camera in sorted(recording.cameras):
        images = recording.images[camera]
        for start in range(max(method.history, first_scored(images)), len(images), TASK_IMAGES):
            stop = min(start + TASK_IMAGES, len(images))
            yield Task(handle=handle, camera=camera, start=start, stop=stop, digest=digest)


def first_scored(images: Sequence[ImageRef]) -> int:
    """Index of the first image of a camera that is to be scored; their number where none is."""
    return next((index for index, image in enumerate(images) if image.scored), len(images))


def process_task(request: RunRequest, manifest: AnswersManifest, task: Task) -> str:
    """Take the images of a task through the stages of which there is no file.

    Args:
        request: the run.
        manifest: of the process that began it.
        task: which images.

    Returns:
        Why there are no results; "" where there are.

    Raises:
        OutputError: a result cannot be stored.
        DataError: this process has other code than the run began with.
    """
    _refuse_other_code(request, manifest)
    try:
        with memoise_flow(request.flow_cache):
            _process(request, task)
    except OutputError:
        raise
    except BenchError as error:
        return f"recording {task.handle.name!r}, camera {task.camera!r}: {error}"
    except MemoryError:
        return f"{task}: the memory that the process may use was not enough"
    return ""


def _process(request: RunRequest, task: Task) -> None:
    """Find the references, ask and count, each where its file is missing."""
    due = {
        results: protocol
        for results, protocol in request.results.items()
        if not (counts_mark(results, task.place).is_file() and request.answers(results, task).is_file())
    }
    if not due:
        return
    recording = _open(task.handle, task.digest)
    images = recording.images[task.camera][task.start : task.stop]
    settings = [protocol.reference for protocol in due.values()]
    found = find_references(recording, images, settings=settings, digest=task.digest)
    for (results, protocol), references in zip(due.items(), found, strict=True):
        file = request.answers(results, task)
        if not file.is_file():
            write_answers(file, ask(recording, task, request.method, references))
        answers = read_answers(file)
        counts = count_answers(recording, images, answers=answers, references=references, protocol=protocol)
        write_counts(results, task.place, *counts)


def ask(recording: Recording, task: Task, method: Scorable, references: Sequence[StoredReference]) -> list[Answer]:
    """Ask a method, or an oracle, for each image of a task; an image without an answer says why.

    Args:
        recording: the drive.
        task: which images.
        method: to be asked.
        references: of the images, which only oracles see.
    """
    pipeline = FramePipeline(recording, task.camera, method=method)
    answers: list[Answer] = []
    for index, row in zip(range(task.start, task.stop), references, strict=True):
        image = pipeline.images[index]
        key = {"recording": recording.name, "camera": task.camera, "timestamp_ns": image.timestamp_ns}
        try:
            given = pipeline.method_input(index)
            began = perf_counter()
            said = pipeline.ask(index, given, partial(reference_of, row, recording.name))
            answers.append(answer_row(key, said, seconds=perf_counter() - began))
        except UnscorableFrame as reason:
            answers.append(no_answer(key, SKIPPED, message_without_root(reason, recording)))
        except BenchError as error:
            answers.append(no_answer(key, FAILED, message_without_root(error, recording)))
    return answers


def ask_again(request: RunRequest, manifest: AnswersManifest, task: Task) -> str:
    """Ask once more for the first image of a task that is done; where the answer is another one, the image fails.

    A mask that differs by more than rounding comes of something noted in a module: then all answers depend on what a
    process did before.

    Args:
        request: the run.
        manifest: as of `process_task`.
        task: which images.

    Returns:
        As `process_task`.

    Raises:
        OutputError: a result cannot be stored.
    """
    file = request.answers(request.folder, task)
    try:
        recording, (first, *others) = _open(task.handle, task.digest), read_answers(file)
    except BenchError as error:
        return f"{task}: {error}"
    with memoise_flow(request.flow_cache):
        (again,) = ask(recording, replace(task, stop=task.start + 1), request.method, [""])
    if answers_agree(first, again):
        return ""
    key = {name: first[name] for name in ("recording", "camera", "timestamp_ns")}
    problem = (
        f"method {request.method.name!r}, recording {recording.name!r}, camera {task.camera!r}, image at "
        f"{key['timestamp_ns']} ns: expected the same answer when asked again at the end, got another; what is noted "
        f"in a module or class, and random numbers without a seed of their own, make scores depend on --workers"
    )
    for results in request.results:
        counts_mark(results, task.place).unlink(missing_ok=True)
    write_answers(file, [no_answer(key, FAILED, problem), *others])
    return process_task(request, manifest, task)


def _refuse_other_code(request: RunRequest, manifest: AnswersManifest) -> None:
    """Refuse to compute with other code than the run began with.

    Raises:
        DataError: names the difference.
    """
    began = manifest.by(request.protocols[0])  # any: what counts is compared as well
    own = manifest.method.model_copy(update={"code_digest": method_digest(request.method)})
    here = began.model_copy(update={"code": CodeOfRun.here(), "method": own})
    if other := [str(difference) for difference in differences(began, here) if difference.decides]:
        hint = "install the same everywhere, and start the run and its workers again"
        raise DataError("this worker", expected="the code that the run began with", got="; ".join(other), hint=hint)


_last: tuple[object, Recording] | None = None  # that was opened; tasks of a recording mostly follow each other


def _open(handle: RecordingHandle, digest: str) -> Recording:
    global _last
    key = repr(handle), digest  # with the folder: a copy of the data may be gone by now
    if _last is None or _last[0] != key:
        _last = key, handle.open()
    return _last[1]
