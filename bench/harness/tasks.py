"""The two tasks of a run: look at a recording, and take some images of a camera through all stages.

Both run in workers. What is computed is written to files; a file that is there is done, whoever wrote it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter

from bench.errors import BenchError, DataError, OutputError
from bench.evaluation import Protocol
from bench.execution import largest_resident_mb
from bench.flow import memoise_flow
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
from bench.harness.counts import count_answers, counts_mark, write_counts
from bench.harness.digests import RecordingDigests, digest_recording
from bench.harness.exact import is_oracle
from bench.harness.frames import FramePipeline, UnscorableFrame
from bench.harness.manifest import AnswersManifest, CodeOfRun, differences, method_digest
from bench.harness.references import StoredReference, find_references, message_without_root, reference_of
from bench.methods import Scorable
from bench.recordings import DatasetCard, ImageRef, Recording, RecordingHandle, open_dataset
from bench.records.recording import NO_INPUT_ERRORS, InputErrors

TASK_IMAGES = 100  # bounds what is held before it is written; many times the lag of the chance level


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Images from `start` up to, not including, `stop` of a camera; the method may read images before `start`.

    Attributes:
        handle: of the recording.
        camera: name.
        start: index of the first image to score.
        stop: index after the last.
        digests: of the recording.
    """

    handle: RecordingHandle
    camera: str
    start: int
    stop: int
    digests: RecordingDigests

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


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedRecording:
    """A recording as a run sees it.

    Attributes:
        name: of the recording.
        tasks: none where it cannot be used.
        digest: of its content; None where it does not open.
        vehicle_outline_m: the ego vehicle from above, vehicle frame.
        reviewed: False where objects were proposed and nobody has looked at them.
        failure: why it cannot be used; "" where it can.
    """

    name: str
    tasks: tuple[Task, ...] = ()
    digest: str | None = None
    vehicle_outline_m: tuple[tuple[float, float], ...] = ()
    failure: str = ""
    reviewed: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of a task, whose results are in files.

    Attributes:
        failure: why there are none; "" where there are.
        asked: images of which the method was asked.
        peak_memory_mb: of the process so far.
    """

    failure: str = ""
    asked: int = 0
    peak_memory_mb: float = 0.0


def plan_recording(method: Scorable, handle: RecordingHandle) -> PlannedRecording:
    """Open a recording, take its digest and list its tasks; what is wrong with it is returned, not raised."""
    try:
        recording = handle.open()
        digests = digest_recording(recording)
    except BenchError as error:
        return PlannedRecording(name=handle.name, failure=f"recording {handle.name!r}: {error}")
    _keep(handle, digests, recording)
    return PlannedRecording(
        name=handle.name,
        tasks=tuple(cut_tasks(handle, recording, digests, method)),
        digest=digests.whole,
        vehicle_outline_m=tuple((float(x), float(y)) for x, y in recording.vehicle_outline_m),
        reviewed=all(track.reviewed for track in recording.tracks),
    )


def cut_tasks(
    handle: RecordingHandle, recording: Recording, digests: RecordingDigests, method: Scorable
) -> Iterator[Task]:
    """Cut a recording into tasks; a camera's first images, without history or not to be scored, belong to none."""
    for camera in sorted(recording.cameras):
        images = recording.images[camera]
        for start in range(max(method.history, first_scored(images)), len(images), TASK_IMAGES):
            stop = min(start + TASK_IMAGES, len(images))
            yield Task(handle=handle, camera=camera, start=start, stop=stop, digests=digests)


def first_scored(images: Sequence[ImageRef]) -> int:
    """Index of the first image of a camera that is to be scored; their number where none is."""
    return next((index for index, image in enumerate(images) if image.scored), len(images))


def process_task(
    request: RunRequest, manifest: AnswersManifest, task: Task, *, answered: Callable[[int], object] | None = None
) -> Outcome:
    """Take the images of a task through the stages of which there is no file; a fault is returned, not raised.

    Args:
        request: the run.
        manifest: of the process that began it.
        task: which images.
        answered: called after each image with the number of those that the method was asked for.

    Raises:
        OutputError: a result cannot be stored.
        DataError: this process has other code than the run began with.
    """
    _refuse_other_code(request, manifest)
    failure, asked = "", 0
    try:
        with memoise_flow(request.flow_cache):
            asked = _process(request, task, answered)
    except OutputError:
        raise
    except BenchError as error:
        failure = f"recording {task.handle.name!r}, camera {task.camera!r}: {error}"
    except MemoryError:
        failure = f"{task}: the memory that the process may use was not enough"
    return Outcome(failure=failure, asked=asked, peak_memory_mb=largest_resident_mb())


def _process(request: RunRequest, task: Task, answered: Callable[[int], object] | None) -> int:
    """Find the references, ask and count, each where its file is missing; return how many images were asked of."""
    due = {
        results: protocol
        for results, protocol in request.results.items()
        if not (counts_mark(results, task.place).is_file() and request.answers(results, task).is_file())
    }
    if not due:
        return 0
    recording, asked = _open(task.handle, task.digests), 0
    images = recording.images[task.camera][task.start : task.stop]
    settings = [protocol.reference for protocol in due.values()]
    found = find_references(recording, images, settings=settings, digest=task.digests.reference)
    for (results, protocol), references in zip(due.items(), found, strict=True):
        file = request.answers(results, task)
        if not file.is_file():
            asked += task.images
            write_answers(file, ask(recording, task, request.method, references, answered=answered))
        answers = read_answers(file)
        counts = count_answers(recording, images, answers=answers, references=references, protocol=protocol)
        write_counts(results, task.place, *counts)
    return asked


def ask(
    recording: Recording,
    task: Task,
    method: Scorable,
    references: Sequence[StoredReference],
    *,
    answered: Callable[[int], object] | None = None,
) -> list[Answer]:
    """Ask a method, or an oracle, for each image of a task; an image without an answer says why.

    Args:
        recording: the drive.
        task: which images.
        method: to be asked.
        references: of the images, which only oracles see.
        answered: as of `process_task`.
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
        if answered is not None:
            answered(len(answers))
    return answers


def ask_again(request: RunRequest, manifest: AnswersManifest, task: Task) -> Outcome:
    """Ask once more for the first image of a task that is done; where the answer is another one, the image fails.

    A mask that differs by more than rounding comes of something noted in a module: then all answers depend on what a
    process did before.

    Args:
        request: the run.
        manifest: as of `process_task`.
        task: which images.

    Raises:
        OutputError: a result cannot be stored.
    """
    file = request.answers(request.folder, task)
    try:
        recording, (first, *others) = _open(task.handle, task.digests), read_answers(file)
    except BenchError as error:
        return Outcome(failure=f"{task}: {error}")
    with memoise_flow(request.flow_cache):
        (again,) = ask(recording, replace(task, stop=task.start + 1), request.method, [""])
    if answers_agree(first, again):
        return Outcome()
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


def _open(handle: RecordingHandle, digests: RecordingDigests) -> Recording:
    last = _last
    if last is not None and last[0] == (handle.name, digests, handle.input_errors):
        return last[1]
    return _keep(handle, digests, handle.open())


def _keep(handle: RecordingHandle, digests: RecordingDigests, recording: Recording) -> Recording:
    global _last
    _last = (handle.name, digests, handle.input_errors), recording
    return recording
