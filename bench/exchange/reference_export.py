"""Export of the reference of a data set: every image that a run would score, a recording at a time."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.atomic import new_folder, write_bytes, write_text
from bench.errors import BenchError, DataError, OutputError, UnknownNameError
from bench.evaluation import Protocol
from bench.evaluation.summary import ProtocolOfRun
from bench.execution import FailedTask, TaskExecutor
from bench.harness.reference_files import (
    AREAS,
    HEAD,
    SCHEMA_VERSION,
    CategoryEntry,
    Form,
    ImageEntry,
    PixelsEntry,
    RecordingFile,
    ReferenceFolder,
    ReferenceHead,
    label_image,
    png_file,
    recording_file,
)
from bench.harness.stages import Progress
from bench.harness.unit import first_scored
from bench.methods.predictions.files import encode_run_lengths
from bench.recordings import DatasetCard, ImageRef, Recording, RecordingHandle, open_dataset
from bench.recordings.checked_json import write_checked
from bench.records.recording import MountedCamera
from bench.reference import ReferenceBuilder, ReferenceFrame


class RecordingWriter:
    """Writes the reference of a recording, one image after the other.

    Args:
        folder: of the export.
        recording: name.
        form: of the pixels.
        classes: that the protocol evaluates.
    """

    def __init__(self, folder: Path, recording: str, *, form: Form, classes: Sequence[str]) -> None:
        self._folder, self._recording, self._form = folder, recording, form
        names = [*classes, *AREAS]
        self._categories = {name: number for number, name in enumerate(names, start=1)}
        self._images: list[ImageEntry] = []
        self._annotations: list[PixelsEntry] = []

    def add(self, frame: ReferenceFrame, *, file_name: str) -> None:
        """Write the reference of an image."""
        image = ImageEntry.of(frame, number=len(self._images) + 1, file_name=file_name)
        self._images.append(image)
        labels = label_image(frame)
        if self._form == "png":
            for what, values in (("instances", frame.labels.astype(np.uint16)), ("labels", labels)):
                file = png_file(self._folder, self._recording, what, frame.camera, frame.timestamp_ns)
                write_bytes(file, cv2.imencode(".png", values)[1].tobytes())
            return
        for item in image.objects:
            if item.region_px:
                self._annotate(image, item.object_class, frame.labels == item.instance_id, item.instance_id)
        for area, label in AREAS.items():
            if (pixels := labels == label).any():
                self._annotate(image, area, pixels, 0)

    def add_problem(self, image: ImageRef, camera: MountedCamera, problem: str, *, file_name: str) -> None:
        """Note that an image has no reference, and why."""
        entry = ImageEntry(
            id=len(self._images) + 1, file_name=file_name, camera=camera.name, timestamp_ns=image.timestamp_ns,
            width=camera.model.width, height=camera.model.height, problem=problem,
        )  # fmt: skip
        self._images.append(entry)

    def finish(self) -> int:
        """Write the recording's file; the number of its images."""
        content = RecordingFile(
            recording=self._recording,
            categories=tuple(CategoryEntry(id=number, name=name) for name, number in self._categories.items()),
            images=tuple(self._images),
            annotations=tuple(self._annotations),
        )
        write_text(recording_file(self._folder, self._recording), content.model_dump_json(indent=1) + "\n")
        return len(self._images)

    def _annotate(self, image: ImageEntry, category: str, pixels: NDArray[np.bool_], instance_id: int) -> None:
        rows, columns = (np.flatnonzero(pixels.any(axis=axis)) for axis in (1, 0))
        left, top = int(columns[0]), int(rows[0])
        self._annotations.append(
            PixelsEntry(
                id=len(self._annotations) + 1,
                image_id=image.id,
                category_id=self._categories[category],
                instance_id=instance_id,
                segmentation=encode_run_lengths(pixels),
                area=int(np.count_nonzero(pixels)),
                bbox=(left, top, int(columns[-1]) + 1 - left, int(rows[-1]) + 1 - top),
                iscrowd=0 if instance_id else 1,
            )
        )


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
        task = partial(export_recording, folder=folder, protocol=protocol, form=form)
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


def export_recording(
    handle: RecordingHandle, *, folder: Path, protocol: Protocol, form: Form
) -> tuple[int, tuple[str, ...]]:
    """Write the reference of a recording; the number of its images, and a line for each without a reference."""
    recording, problems = handle.open(), []
    writer = RecordingWriter(folder, recording.name, form=form, classes=protocol.reference.classes)
    for name in sorted(recording.cameras):
        builder = ReferenceBuilder(recording, name, protocol.reference_settings())
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
