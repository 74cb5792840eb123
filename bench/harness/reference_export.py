"""The reference as data: what a protocol counts in each image, for programs that know nothing of lidars.

```
DIR/reference.json                                     data set, protocol, recordings
DIR/<recording>.json                                   its images, and the objects of each
DIR/<recording>/instances/<camera>/<timestamp_ns>.png  16 bits: k for the pixels of G of the image's k-th object
DIR/<recording>/labels/<camera>/<timestamp_ns>.png     8 bits: a `Label`
```

Names of recordings and cameras are percent-encoded where a file cannot be called so.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.atomic import new_folder, write_bytes, write_text
from bench.errors import BenchError, DataError
from bench.evaluation.protocol import Protocol
from bench.execution import FailedTask, Progress, TaskExecutor, compute_all
from bench.harness.answers import safe_name
from bench.harness.references import message_without_root
from bench.harness.run import first_scored
from bench.recordings import DatasetCard, ImageRef, RecordingHandle, open_dataset
from bench.records.reference import ReferenceFrame
from bench.reference.build import ReferenceBuilder

HEAD = "reference.json"
Entry = dict[str, object]

AS_COUNTED = ("track_id", "object_class", "status", "reason", "category", "direction", "points", "polygon_px",
              "region_px", "unknown_px")  # fmt: skip
MEASURED = ("speed_mps", "range_m", "centroid_m")


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
    with new_folder(out) as folder:
        task = partial(_export_recording, protocol=protocol, folder=folder)
        exported = compute_all(executor, task, handles, progress=progress)
        problems, images = list[str](), dict[str, int]()
        for handle, of_images in zip(handles, exported, strict=True):
            if isinstance(of_images, FailedTask):
                raise DataError(handle.name, expected="a recording that can be exported", got=of_images.reason)
            images[handle.name] = len(of_images)
            problems += filter(None, of_images)
        rules = {"name": protocol.name, "version": protocol.version, "digest": protocol.digest}
        head = {"schema_version": 1, "dataset": card.name, "split": split, "protocol": rules, "recordings": images}
        _write_json(folder / HEAD, head)
    return ReferenceExport(folder=out, images=images, problems=tuple(problems))


def label_image(frame: ReferenceFrame) -> NDArray[np.uint8]:
    """The `Label` of each pixel, (H, W) uint8."""
    labels = np.full(frame.valid.shape, Label.BACKGROUND, dtype=np.uint8)
    labels[frame.ignored] = Label.IGNORED
    labels[frame.unknown] = Label.UNKNOWN
    labels[frame.labels > 0] = Label.CORE
    labels[~frame.valid] = Label.OUTSIDE
    return labels


def _export_recording(handle: RecordingHandle, *, folder: Path, protocol: Protocol) -> list[str]:
    """Write the reference of a recording; for each image the problem that it has, or ""."""
    recording = handle.open()
    entries = [
        _export_image(builder, image, folder / safe_name(recording.name))
        for name in sorted(recording.cameras)
        for builder in [ReferenceBuilder(recording, name, protocol.reference)]
        for image in recording.images[name][first_scored(recording.images[name]) :]
    ]
    _write_json(folder / f"{safe_name(recording.name)}.json", {"recording": recording.name, "images": entries})
    return [str(entry["problem"]) for entry in entries]


def _export_image(builder: ReferenceBuilder, image: ImageRef, folder: Path) -> Entry:
    """Write the pixels of an image; return it as `<recording>.json` has it, its objects nearest first.

    The `instance_id` of an object is the number of its pixels in `instances`; what is unknown is null.
    """
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
        without: Entry = {"ego_speed_mps": None, "annotated": True, "objects": []}
        return entry | without | {"problem": message_without_root(error, recording)}
    for what, values in (("instances", frame.labels.astype(np.uint16)), ("labels", label_image(frame))):
        file = folder / what / safe_name(image.camera) / f"{image.timestamp_ns}.png"
        write_bytes(file, cv2.imencode(".png", values)[1].tobytes())
    objects = [
        {"instance_id": number}
        | {name: getattr(item, name) for name in AS_COUNTED}
        | {name: _known(getattr(item, name)) for name in MEASURED}
        for number, item in enumerate(frame.objects, start=1)
    ]
    of_frame = {"ego_speed_mps": frame.ego_speed_mps, "annotated": frame.annotated}
    return entry | of_frame | {"objects": objects, "problem": ""}


def _known(value: ArrayLike) -> object:
    """A measurement for JSON; None for NaN."""
    return None if np.isnan(value).any() else np.asarray(value).tolist()


def _write_json(file: Path, content: object) -> None:
    write_text(file, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
