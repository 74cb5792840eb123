"""The reference as data: what a protocol counts in each image, for programs that know nothing of lidars.

```
DIR/reference.json                                     data set, protocol, recordings
DIR/<recording>.json                                   its images, and the objects of each
DIR/<recording>/instances/<camera>/<timestamp_ns>.png  16 bits: k for the pixels of G of the image's k-th object
DIR/<recording>/labels/<camera>/<timestamp_ns>.png     8 bits: a `Label`
```
"""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bench.atomic import new_folder, path_inside, write_bytes, write_text
from bench.errors import BenchError, DataError, OutputError, UnknownNameError
from bench.evaluation import Protocol
from bench.evaluation.summary import ProtocolOfRun
from bench.execution import FailedTask, TaskExecutor
from bench.harness.counts import told
from bench.harness.stages import Progress
from bench.harness.tasks import first_scored
from bench.recordings import DatasetCard, ImageRef, Recording, RecordingHandle, open_dataset
from bench.recordings.validation import FileModel, SidePx, TimeNs
from bench.records.reference import Category, Direction, IgnoreReason, ReferenceFrame, ReferenceObject, Status
from bench.reference import ReferenceBuilder

HEAD = "reference.json"

Count = Annotated[int, Field(ge=0)]
Number = Annotated[int, Field(ge=1)]


class Label(IntEnum):
    """Kind of a pixel."""

    BACKGROUND = 0  # a detection here is a false positive
    CORE = 1  # of an evaluated object
    UNKNOWN = 2  # its unknown band; neither right nor wrong, as the next one
    IGNORED = 3  # objects that move and are not evaluated, areas that are not annotated
    OUTSIDE = 4  # outside of the lens's field, or the ego vehicle's own body: counts for nothing


class ObjectEntry(FileModel):
    """An annotated object in an image; see `ReferenceObject`. What is unknown is null.

    Attributes:
        instance_id: its place in the image's list, from 1; in `instances` the number of its pixels.
        category: its kind of motion.
    """

    instance_id: Number
    track_id: str
    object_class: str
    status: Status
    reason: IgnoreReason | None
    category: Category | None
    direction: Direction | None
    speed_mps: float | None
    range_m: float | None
    centroid_m: tuple[float, float] | None
    points: Count
    polygon_px: Count
    region_px: Count
    unknown_px: Count

    @classmethod
    def of(cls, number: int, item: ReferenceObject) -> ObjectEntry:
        """The entry of an image's object of a number."""
        same = ("track_id", "object_class", "status", "reason", "category", "direction", "points", "polygon_px")
        x, y = map(float, item.centroid_m)
        return cls(
            instance_id=number,
            centroid_m=None if math.isnan(x + y) else (x, y),
            speed_mps=None if math.isnan(item.speed_mps) else float(item.speed_mps),
            range_m=None if math.isnan(item.range_m) else float(item.range_m),
            **{name: getattr(item, name) for name in (*same, "region_px", "unknown_px")},
        )


class ImageEntry(FileModel):
    """An image.

    Attributes:
        file_name: of the image, relative to the recording's folder where it lies there.
        camera: name.
        timestamp_ns: exposure.
        width: px.
        height: px.
        ego_speed_mps: over the ground; null where it has no reference.
        annotated: False where nobody knows what moves: it is not scored.
        objects: all annotated ones, nearest first.
        problem: why it has no reference; "" where it has one.
    """

    file_name: str
    camera: str
    timestamp_ns: TimeNs
    width: SidePx
    height: SidePx
    ego_speed_mps: float | None = None
    annotated: bool = True
    objects: tuple[ObjectEntry, ...] = ()
    problem: str = ""


class RecordingFile(FileModel):
    """`<recording>.json`."""

    recording: str
    images: tuple[ImageEntry, ...]


class ReferenceHead(FileModel):
    """`reference.json`.

    Attributes:
        schema_version: of the folder.
        dataset: name.
        split: of it; None for all.
        protocol: that the reference is by.
        recordings: name -> images.
    """

    schema_version: Literal[1] = 1
    dataset: str
    split: str | None
    protocol: ProtocolOfRun
    recordings: dict[str, Count]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceExport:
    """A reference that was exported.

    Attributes:
        folder: where it lies.
        head: what it is of.
        problems: one line for each image without a reference.
    """

    folder: Path
    head: ReferenceHead
    problems: tuple[str, ...]


def export_references(
    card: DatasetCard,
    *,
    protocol: Protocol,
    out: Path,
    executor: TaskExecutor,
    split: str | None = None,
    recording: str | None = None,
    progress: Progress | None = None,
) -> ReferenceExport:
    """Write the reference of each image of a data set; the folder appears whole or not at all.

    Args:
        card: the data set.
        protocol: of the reference.
        out: a folder that is new or empty.
        executor: computes the recordings.
        split: of the data set; None for all of it.
        recording: name of the only one to export; None for all.
        progress: called with the recordings done and their number.

    Raises:
        DataError: the folder holds something, or a recording cannot be opened.
        UnknownNameError: no such split or recording.
    """
    known = open_dataset(card, split)
    handles = [handle for handle in known if recording in (None, handle.name)]
    if not handles:
        raise UnknownNameError("recording", str(recording), (handle.name for handle in known))
    images: dict[str, int] = {}
    problems: dict[str, tuple[str, ...]] = {}
    with new_folder(out) as folder, executor:
        task = partial(_export_recording, folder=folder, protocol=protocol)
        with closing(executor.compute(task, handles)) as results:
            for handle, outcome in results:
                if isinstance(outcome, FailedTask):
                    raise DataError(handle.name, expected="a recording that can be exported", got=outcome.reason)
                images[handle.name], problems[handle.name] = outcome
                if progress is not None:
                    progress(len(images), len(handles))
        head = ReferenceHead(
            dataset=card.name,
            split=split,
            protocol=ProtocolOfRun(name=protocol.name, version=protocol.version, digest=protocol.digest),
            recordings={handle.name: images[handle.name] for handle in handles},
        )
        write_text(folder / HEAD, head.model_dump_json(indent=1) + "\n")
    lines = tuple(line for handle in handles for line in problems[handle.name])
    return ReferenceExport(folder=out, head=head, problems=lines)


def label_image(frame: ReferenceFrame) -> NDArray[np.uint8]:
    """The `Label` of each pixel, (H, W) uint8."""
    labels = np.full(frame.valid.shape, Label.BACKGROUND, dtype=np.uint8)
    labels[frame.ignored] = Label.IGNORED
    labels[frame.unknown] = Label.UNKNOWN
    labels[frame.labels > 0] = Label.CORE
    labels[~frame.valid] = Label.OUTSIDE
    return labels


def _export_recording(handle: RecordingHandle, *, folder: Path, protocol: Protocol) -> tuple[int, tuple[str, ...]]:
    """Write the reference of a recording; the number of its images, and a line for each without a reference."""
    recording, entries = handle.open(), list[ImageEntry]()
    for name in sorted(recording.cameras):
        builder = ReferenceBuilder(recording, name, protocol.reference_settings())
        images = recording.images[name]
        for image in images[first_scored(images) :]:
            try:
                frame = builder.build(image)
                _write_pixels(folder, frame)
                entries.append(_entry(image, recording, frame))
            except OutputError:
                raise
            except BenchError as error:
                entries.append(_entry(image, recording, problem=told(error, recording)))
    content = RecordingFile(recording=recording.name, images=tuple(entries))
    file = path_inside(folder, f"{recording.name}.json", file=folder / HEAD, field="recordings")
    write_text(file, content.model_dump_json(indent=1) + "\n")
    return len(entries), tuple(entry.problem for entry in entries if entry.problem)


def _write_pixels(folder: Path, frame: ReferenceFrame) -> None:
    for what, values in (("instances", frame.labels.astype(np.uint16)), ("labels", label_image(frame))):
        name = f"{frame.recording}/{what}/{frame.camera}/{frame.timestamp_ns}.png"
        write_bytes(path_inside(folder, name, file=folder / HEAD), cv2.imencode(".png", values)[1].tobytes())


def _entry(
    image: ImageRef, recording: Recording, frame: ReferenceFrame | None = None, *, problem: str = ""
) -> ImageEntry:
    inside, model = image.path.is_relative_to(recording.root), recording.cameras[image.camera].model
    return ImageEntry(
        file_name=image.path.relative_to(recording.root).as_posix() if inside else image.path.name,
        camera=image.camera,
        timestamp_ns=image.timestamp_ns,
        width=model.width,
        height=model.height,
        ego_speed_mps=None if frame is None else frame.ego_speed_mps,
        annotated=frame is None or frame.annotated,
        objects=() if frame is None else tuple(ObjectEntry.of(k, one) for k, one in enumerate(frame.objects, start=1)),
        problem=problem,
    )
