"""The reference as data: what a protocol counts in each image, for programs that know nothing of lidars.

```
DIR/reference.json                                     data set, protocol, recordings
DIR/<recording>.json                                   its images, and the objects of each
DIR/<recording>/instances/<camera>/<timestamp_ns>.png  16 bits: k for the pixels of G of the image's k-th object
DIR/<recording>/labels/<camera>/<timestamp_ns>.png     8 bits: a `Label`
```
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.atomic import new_folder, path_inside, write_bytes, write_text
from bench.errors import BenchError, DataError, OutputError
from bench.evaluation import Protocol
from bench.evaluation.summary import ProtocolOfRun
from bench.execution import FailedTask, TaskExecutor
from bench.harness.counts import told
from bench.harness.stages import Progress
from bench.harness.tasks import first_scored
from bench.recordings import DatasetCard, ImageRef, Recording, RecordingHandle, open_dataset
from bench.records.reference import ReferenceFrame, ReferenceObject
from bench.reference import ReferenceBuilder

HEAD = "reference.json"

AS_COUNTED = ("track_id", "object_class", "status", "reason", "category", "direction", "points", "polygon_px",
              "region_px", "unknown_px")  # fmt: skip


class Label(IntEnum):
    """Kind of a pixel."""

    BACKGROUND = 0  # a detection here is a false positive
    CORE = 1  # of an evaluated object
    UNKNOWN = 2  # its unknown band; neither right nor wrong, as the next one
    IGNORED = 3  # objects that move and are not evaluated, areas that are not annotated
    OUTSIDE = 4  # outside of the lens's field, or the ego vehicle's own body: counts for nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceExport:
    """A reference that was exported.

    Attributes:
        folder: where it lies.
        images: of each recording, by name.
        problems: one line for each image without a reference.
    """

    folder: Path
    images: Mapping[str, int]
    problems: tuple[str, ...]


def export_references(
    card: DatasetCard,
    *,
    protocol: Protocol,
    out: Path,
    executor: TaskExecutor,
    split: str | None = None,
    progress: Progress | None = None,
) -> ReferenceExport:
    """Write the reference of each image of a data set; the folder appears whole or not at all.

    Args:
        card: the data set.
        protocol: of the reference.
        out: a folder that is new or empty.
        executor: computes the recordings.
        split: of the data set; None for all of it.
        progress: called with the recordings done and their number.

    Raises:
        DataError: the folder holds something, or a recording cannot be opened.
        UnknownNameError: no such split.
    """
    handles = open_dataset(card, split)
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
        counts = {handle.name: images[handle.name] for handle in handles}
        rules = ProtocolOfRun(name=protocol.name, version=protocol.version, digest=protocol.digest).model_dump()
        head = {"schema_version": 1, "dataset": card.name, "split": split, "protocol": rules, "recordings": counts}
        write_text(folder / HEAD, _json(head))
    lines = tuple(line for handle in handles for line in problems[handle.name])
    return ReferenceExport(folder=out, images=counts, problems=lines)


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
    recording, entries = handle.open(), list[dict[str, object]]()
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
    file = path_inside(folder, f"{recording.name}.json", file=folder / HEAD, field="recordings")
    write_text(file, _json({"recording": recording.name, "images": entries}))
    return len(entries), tuple(str(entry["problem"]) for entry in entries if entry["problem"])


def _write_pixels(folder: Path, frame: ReferenceFrame) -> None:
    for what, values in (("instances", frame.labels.astype(np.uint16)), ("labels", label_image(frame))):
        name = f"{frame.recording}/{what}/{frame.camera}/{frame.timestamp_ns}.png"
        write_bytes(path_inside(folder, name, file=folder / HEAD), cv2.imencode(".png", values)[1].tobytes())


def _entry(
    image: ImageRef, recording: Recording, frame: ReferenceFrame | None = None, *, problem: str = ""
) -> dict[str, object]:
    """An image as `<recording>.json` has it; its objects stand nearest first, and what is unknown is null."""
    inside, model = image.path.is_relative_to(recording.root), recording.cameras[image.camera].model
    return {
        "file_name": image.path.relative_to(recording.root).as_posix() if inside else image.path.name,
        "camera": image.camera,
        "timestamp_ns": image.timestamp_ns,
        "width": model.width,
        "height": model.height,
        "ego_speed_mps": None if frame is None else frame.ego_speed_mps,
        "annotated": frame is None or frame.annotated,
        "objects": [] if frame is None else [_object(k, item) for k, item in enumerate(frame.objects, start=1)],
        "problem": problem,
    }


def _object(number: int, item: ReferenceObject) -> dict[str, object]:
    """An annotated object; `instance_id` is the number of its pixels in `instances`."""
    centre_m = [float(value) for value in item.centroid_m]
    return {
        "instance_id": number,
        **{name: getattr(item, name) for name in AS_COUNTED},
        "speed_mps": None if math.isnan(item.speed_mps) else float(item.speed_mps),
        "range_m": None if math.isnan(item.range_m) else float(item.range_m),
        "centroid_m": None if math.isnan(sum(centre_m)) else centre_m,
    }


def _json(content: object) -> str:
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
