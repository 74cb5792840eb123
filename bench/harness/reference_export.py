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
from bench.errors import BenchError, DataError
from bench.evaluation import Protocol
from bench.execution import FailedTask, TaskExecutor
from bench.harness.references import message_without_root
from bench.harness.stages import Progress
from bench.harness.tasks import first_scored
from bench.recordings import DatasetCard, ImageRef, RecordingHandle, open_dataset
from bench.records.reference import ReferenceFrame, ReferenceObject
from bench.reference import ReferenceBuilder

HEAD = "reference.json"
Entry = dict[str, object]

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
    entries: dict[str, list[Entry]] = {}
    with new_folder(out) as folder, executor:
        task = partial(_export_recording, folder=folder, protocol=protocol)
        with closing(executor.compute(task, handles)) as results:
            for handle, outcome in results:
                if isinstance(outcome, FailedTask):
                    raise DataError(handle.name, expected="a recording that can be exported", got=outcome.reason)
                entries[handle.name] = outcome
                if progress is not None:
                    progress(len(entries), len(handles))
        images = {handle.name: len(entries[handle.name]) for handle in handles}
        rules = {"name": protocol.name, "version": protocol.version, "digest": protocol.digest}
        head = {"schema_version": 1, "dataset": card.name, "split": split, "protocol": rules, "recordings": images}
        write_text(folder / HEAD, _json(head))
    problems = [str(entry["problem"]) for name in images for entry in entries[name] if entry["problem"]]
    return ReferenceExport(folder=out, images=images, problems=tuple(problems))


def label_image(frame: ReferenceFrame) -> NDArray[np.uint8]:
    """The `Label` of each pixel, (H, W) uint8."""
    labels = np.full(frame.valid.shape, Label.BACKGROUND, dtype=np.uint8)
    labels[frame.ignored] = Label.IGNORED
    labels[frame.unknown] = Label.UNKNOWN
    labels[frame.labels > 0] = Label.CORE
    labels[~frame.valid] = Label.OUTSIDE
    return labels


def _export_recording(handle: RecordingHandle, *, folder: Path, protocol: Protocol) -> list[Entry]:
    """Write the reference of a recording; its images without their objects."""
    recording = handle.open()
    entries = [
        _export_image(builder, image, folder)
        for name in sorted(recording.cameras)
        for builder in [ReferenceBuilder(recording, name, protocol.reference_settings())]
        for image in recording.images[name][first_scored(recording.images[name]) :]
    ]
    file = path_inside(folder, f"{recording.name}.json", file=folder / HEAD, field="recordings")
    write_text(file, _json({"recording": recording.name, "images": entries}))
    return [entry | {"objects": []} for entry in entries]


def _export_image(builder: ReferenceBuilder, image: ImageRef, folder: Path) -> Entry:
    """Write the pixels of an image; return it as `<recording>.json` has it, its objects nearest first."""
    recording, model = builder.recording, builder.camera.model
    inside = image.path.is_relative_to(recording.root)
    entry: Entry = {
        "file_name": image.path.relative_to(recording.root).as_posix() if inside else image.path.name,
        "camera": image.camera,
        "timestamp_ns": image.timestamp_ns,
        "width": model.width,
        "height": model.height,
    }
    try:
        frame = builder.build(image)
    except BenchError as error:
        return entry | {
            "ego_speed_mps": None,
            "annotated": True,
            "objects": [],
            "problem": message_without_root(error, recording),
        }
    for what, values in (("instances", frame.labels.astype(np.uint16)), ("labels", label_image(frame))):
        file = path_inside(
            folder, f"{recording.name}/{what}/{image.camera}/{image.timestamp_ns}.png", file=folder / HEAD
        )
        write_bytes(file, cv2.imencode(".png", values)[1].tobytes())
    objects = [_object(number, item) for number, item in enumerate(frame.objects, start=1)]
    of_frame = {"ego_speed_mps": frame.ego_speed_mps, "annotated": frame.annotated}
    return entry | of_frame | {"objects": objects, "problem": ""}


def _object(number: int, item: ReferenceObject) -> dict[str, object]:
    """An annotated object; `instance_id` is the number of its pixels in `instances`, what is unknown is null."""
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
