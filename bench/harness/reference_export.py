"""Export of the reference of a data set: every image that a run would score, a recording at a time."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from bench.atomic import new_folder
from bench.errors import BenchError, DataError, OutputError, UnknownNameError
from bench.evaluation import Protocol
from bench.evaluation.summary import ProtocolOfRun
from bench.execution import FailedTask, TaskExecutor
from bench.harness.reference_files import HEAD, SCHEMA_VERSION, Form, RecordingWriter, ReferenceFolder, ReferenceHead
from bench.harness.stages import Progress
from bench.harness.unit import first_scored
from bench.recordings import DatasetCard, ImageRef, Recording, RecordingHandle, open_dataset
from bench.recordings.checked_json import write_checked
from bench.reference import ReferenceBuilder


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportSpec:
    """Settings that are the same for all recordings of an export.

    Attributes:
        folder: to write into.
        protocol: of the reference.
        form: of the pixels.
    """

    folder: Path
    protocol: Protocol
    form: Form


def export_references(
    card: DatasetCard,
    *,
    protocol: Protocol,
    form: Form,
    out: Path,
    executor: TaskExecutor,
    split: str | None = None,
    recording: str | None = None,
    progress: Progress | None = None,
) -> tuple[ReferenceFolder, tuple[str, ...]]:
    """Write the reference of each image of a data set; the folder appears whole or not at all.

    Args:
        card: the data set.
        protocol: of the reference.
        form: of the pixels.
        out: a folder that is new or empty.
        executor: computes the recordings.
        split: of the data set; None for all of it.
        recording: name of the only one to export; None for all.
        progress: called with the recordings done and their number.

    Returns:
        The export, and one line for each image without a reference.

    Raises:
        DataError: the folder holds something, or a recording cannot be opened.
        UnknownNameError: no such split or recording.
    """
    handles = _chosen(open_dataset(card, split), recording)
    images: dict[str, int] = {}
    problems: dict[str, tuple[str, ...]] = {}
    with new_folder(out) as folder, executor:
        task = partial(export_recording, ExportSpec(folder=folder, protocol=protocol, form=form))
        with closing(executor.compute(task, handles)) as results:
            for handle, outcome in results:
                if isinstance(outcome, FailedTask):
                    raise DataError(handle.name, expected="a recording that can be exported", got=outcome.reason)
                images[handle.name], problems[handle.name] = outcome
                if progress is not None:
                    progress(len(images), len(handles))
        head = ReferenceHead(
            schema_version=SCHEMA_VERSION,
            form=form,
            dataset=card.name,
            split=split,
            protocol=ProtocolOfRun(name=protocol.name, version=protocol.version, digest=protocol.digest),
            recordings={handle.name: images[handle.name] for handle in handles},
        )
        write_checked(folder / HEAD, head)
    return ReferenceFolder.open(out), tuple(line for handle in handles for line in problems[handle.name])


def export_recording(spec: ExportSpec, handle: RecordingHandle) -> tuple[int, tuple[str, ...]]:
    """Write the reference of a recording; the number of its images, and a line for each without a reference."""
    recording, problems = handle.open(), []
    classes = spec.protocol.reference.classes
    writer = RecordingWriter(spec.folder, recording.name, form=spec.form, classes=classes)
    for name in sorted(recording.cameras):
        builder = ReferenceBuilder(recording, name, spec.protocol.reference_settings())
        images = recording.images[name]
        for image in images[first_scored(images) :]:
            file_name = _file_name(image, recording)
            try:
                writer.add(builder.build(image), file_name=file_name)
            except OutputError:
                raise
            except BenchError as error:
                problem = str(error).replace(str(recording.root), recording.name)  # as a run tells it
                writer.add_problem(image, recording.cameras[name], problem, file_name=file_name)
                problems.append(problem)
    return writer.finish(), tuple(problems)


def _chosen(handles: tuple[RecordingHandle, ...], recording: str | None) -> list[RecordingHandle]:
    found = [handle for handle in handles if recording in (None, handle.name)]
    if not found:
        raise UnknownNameError("recording", str(recording), (handle.name for handle in handles))
    return found


def _file_name(image: ImageRef, recording: Recording) -> str:
    inside = image.path.is_relative_to(recording.root)
    return image.path.relative_to(recording.root).as_posix() if inside else image.path.name
