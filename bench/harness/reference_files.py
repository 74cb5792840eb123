"""The reference as data: what a protocol counts in each image, for programs that know nothing of lidars.

```
DIR/reference.json                                     data set, protocol, form, recordings
DIR/<recording>.json                                   its images, and the objects of each; the keys are COCO's
DIR/<recording>/instances/<camera>/<timestamp_ns>.png  16 bits: k for the pixels of G of the image's k-th object
DIR/<recording>/labels/<camera>/<timestamp_ns>.png     8 bits: a `Label`
```

Of the form "coco" the pixels are `annotations` of the recording's JSON, run lengths: one for each object that has
pixels, with its `instance_id`, and one each for all other labels, with `iscrowd` 1. An object is told once, in the
entry of its image, with its place there as `instance_id`; `annotations` name that.

A recording's JSON is read once, images one at a time: memory is that of one image and of one recording's text.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bench.atomic import path_inside, read_regular
from bench.errors import BenchError, DataError
from bench.evaluation.summary import ProtocolOfRun
from bench.harness.digests.content import FileDigests, digest_of
from bench.methods.predictions.files import RunLengths, decode_run_lengths
from bench.recordings.checked_json import read_checked
from bench.recordings.images import decode_image
from bench.recordings.validation import FileModel, SidePx, TimeNs, read_json
from bench.records.recording import ImageRef, MountedCamera
from bench.records.reference import Category, Direction, IgnoreReason, ReferenceFrame, ReferenceObject, Status

HEAD = "reference.json"
SCHEMA_VERSION = 1
Form = Literal["png", "coco"]


class Label(IntEnum):
    """Kind of a pixel."""

    BACKGROUND = 0  # a detection here is a false positive
    CORE = 1  # of an evaluated object
    UNKNOWN = 2  # its unknown band; neither right nor wrong, as the next one
    IGNORED = 3  # objects that move and are not evaluated, areas that are not annotated
    OUTSIDE = 4  # outside of the lens's field, or the ego vehicle's own body: counts for nothing


AREAS = {"unknown band": Label.UNKNOWN, "ignored area": Label.IGNORED, "outside": Label.OUTSIDE}  # by COCO's category

Count = Annotated[int, Field(ge=0)]
Number = Annotated[int, Field(ge=1)]


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
        same = {name: getattr(item, name) for name in _SAME}
        known = {name: _or_none(getattr(item, name)) for name in ("speed_mps", "range_m")}
        x, y = map(float, item.centroid_m)
        return cls(instance_id=number, centroid_m=None if math.isnan(x + y) else (x, y), **same, **known)

    def record(self) -> ReferenceObject:
        """The object, without its polygon, which only drawings need."""
        return ReferenceObject(
            **{name: getattr(self, name) for name in _SAME},
            speed_mps=_or_nan(self.speed_mps),
            range_m=_or_nan(self.range_m),
            centroid_m=np.array(self.centroid_m or (math.nan, math.nan)),
            polygon=None,
        )


_SAME = (
    *("track_id", "object_class", "status", "reason", "category", "direction"),
    *("points", "polygon_px", "region_px", "unknown_px"),
)


class ImageEntry(FileModel):
    """An image.

    Attributes:
        id: within the file.
        file_name: of the image, relative to the recording's folder where it lies there.
        camera: name.
        timestamp_ns: exposure.
        width: px.
        height: px.
        ego_speed_mps: over the ground.
        annotated: False where nobody knows what moves: it is not scored.
        objects: all annotated ones, nearest first.
        problem: why it has no reference; "" where it has one.
    """

    id: Number
    file_name: str
    camera: str
    timestamp_ns: TimeNs
    width: SidePx
    height: SidePx
    ego_speed_mps: float = 0.0
    annotated: bool = True
    objects: tuple[ObjectEntry, ...] = ()
    problem: str = ""

    @classmethod
    def of(cls, frame: ReferenceFrame, *, number: int = 1, file_name: str = "") -> ImageEntry:
        """The entry of an image with a reference."""
        height, width = frame.valid.shape
        return cls(
            id=number, file_name=file_name, camera=frame.camera, timestamp_ns=frame.timestamp_ns,
            width=width, height=height, ego_speed_mps=frame.ego_speed_mps, annotated=frame.annotated,
            objects=tuple(ObjectEntry.of(place, item) for place, item in enumerate(frame.objects, start=1)),
        )  # fmt: skip

    def frame(self, recording: str, instances: NDArray[np.integer], labels: NDArray[np.uint8]) -> ReferenceFrame:
        """The reference again, without the polygons of its objects.

        Args:
            recording: name.
            instances: (H, W), the number of the object that a pixel is of; 0 for none.
            labels: (H, W), of `label_image`.
        """
        unknown = labels == Label.UNKNOWN
        return ReferenceFrame(
            recording=recording,
            camera=self.camera,
            timestamp_ns=self.timestamp_ns,
            ego_speed_mps=self.ego_speed_mps,
            objects=tuple(item.record() for item in self.objects),
            labels=instances.astype(np.int32, copy=False),
            ignored=unknown | (labels == Label.IGNORED),
            unknown=unknown,
            valid=labels != Label.OUTSIDE,
            annotated=self.annotated,
        )


def label_image(frame: ReferenceFrame) -> NDArray[np.uint8]:
    """The `Label` of each pixel, (H, W) uint8."""
    labels = np.full(frame.valid.shape, Label.BACKGROUND, dtype=np.uint8)
    labels[frame.ignored] = Label.IGNORED
    labels[frame.unknown] = Label.UNKNOWN
    labels[frame.labels > 0] = Label.CORE
    labels[~frame.valid] = Label.OUTSIDE
    return labels


class CategoryEntry(FileModel):
    """A class of objects, or one of `AREAS`."""

    id: Number
    name: str


class PixelsEntry(FileModel):
    """Pixels of an object, or with `iscrowd` 1 and `instance_id` 0 of an area."""

    id: Number
    image_id: Number
    category_id: Number
    instance_id: Count
    segmentation: RunLengths
    area: Count
    bbox: tuple[float, float, float, float]
    iscrowd: Literal[0, 1]


class RecordingFile(FileModel):
    """`<recording>.json`."""

    recording: str
    categories: tuple[CategoryEntry, ...]
    images: tuple[ImageEntry, ...]
    annotations: tuple[PixelsEntry, ...]


class ReferenceHead(FileModel):
    """`reference.json`.

    Attributes:
        schema_version: of the folder.
        form: of the pixels.
        dataset: name.
        split: of it; None for all.
        protocol: that the reference is by.
        recordings: name -> images.
    """

    schema_version: Literal[1]
    form: Form
    dataset: str
    split: str | None
    protocol: ProtocolOfRun
    recordings: dict[str, Count]


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def recording_file(folder: Path, recording: str) -> Path:
    """The JSON file of a recording, inside the folder whatever its name."""
    return path_inside(folder, f"{recording}.json", file=folder / HEAD, field="recordings")


def png_file(folder: Path, recording: str, what: str, camera: str, timestamp_ns: int) -> Path:
    """A file of pixels, `what` being "instances" or "labels"."""
    return path_inside(folder, f"{recording}/{what}/{camera}/{timestamp_ns}.png", file=folder / HEAD)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceFolder:
    """An exported reference.

    Attributes:
        folder: where it lies.
        head: what it is of.
    """

    folder: Path
    head: ReferenceHead

    @classmethod
    def open(cls, folder: Path) -> ReferenceFolder:
        """Open an export.

        Raises:
            DataError: not one, or damaged; names file and field.
        """
        head = read_checked(ReferenceHead, folder / HEAD, expected="what `fisheye-bench reference export` wrote")
        return cls(folder=folder, head=head)

    def recording(self, name: str) -> RecordingReference:
        """The reference of a recording.

        Raises:
            DataError: the recording is not there, or its file is damaged.
        """
        if name not in self.head.recordings:
            got = f"{len(self.head.recordings)} others"
            raise DataError(self.folder / HEAD, field="recordings", expected=f"recording {name!r}", got=got)
        return RecordingReference(self, name)

    def frames(self) -> Iterator[ReferenceFrame]:
        """The reference of every image that has one, by recording and camera in order of time."""
        for name in self.head.recordings:
            recording = self.recording(name)
            for image in recording.images:
                if not image.problem:
                    yield recording.frame(image)


class RecordingReference:
    """The reference of one recording, as it was exported; holds its text, never pixels.

    Args:
        exported: the whole export.
        name: of the recording.

    Raises:
        DataError: a file that is missing or damaged, names the field.
    """

    def __init__(self, exported: ReferenceFolder, name: str) -> None:
        self._exported, self._name = exported, name
        self.file = recording_file(exported.folder, name)
        content = read_json(RecordingFile, self.file)
        self.images = content.images
        self._by_image = {(image.camera, image.timestamp_ns): image for image in content.images}
        self._categories = {category.id: category.name for category in content.categories}
        self._pixels: dict[int, list[tuple[int, PixelsEntry]]] = {}
        for place, image in enumerate(content.images):
            if [item.instance_id for item in image.objects] != [*range(1, len(image.objects) + 1)]:
                expected = "objects that are numbered from 1 in their order"
                raise DataError(self.file, field=f"images[{place}].objects", expected=expected, got="others")
        by_id = {image.id: image for image in content.images}
        for place, pixels in enumerate(content.annotations):
            if (fault := self._fault(pixels, by_id.get(pixels.image_id))) is not None:
                field, expected, got = fault
                raise DataError(self.file, field=f"annotations[{place}].{field}", expected=expected, got=got)
            self._pixels.setdefault(pixels.image_id, []).append((place, pixels))

    def _fault(self, pixels: PixelsEntry, image: ImageEntry | None) -> tuple[str, str, str] | None:
        """Field of an entry that is wrong, what is expected and what was found; None for none."""
        if image is None:
            return "image_id", "an image of this file", str(pixels.image_id)
        if pixels.instance_id > len(image.objects):
            return "instance_id", f"at most {len(image.objects)}, an object of its image", str(pixels.instance_id)
        if not pixels.instance_id and self._categories.get(pixels.category_id) not in AREAS:
            return "category_id", f"that of one of {', '.join(AREAS)}", str(pixels.category_id)
        if pixels.segmentation.size != (image.height, image.width):
            got = "{} x {}".format(*pixels.segmentation.size)
            return "segmentation.size", f"{image.height} x {image.width} (height, width)", got
        return None

    def image(self, camera: str, timestamp_ns: int) -> ImageEntry:
        """The entry of an image.

        Raises:
            DataError: there is none.
        """
        found = self._by_image.get((camera, timestamp_ns))
        if found is None:
            expected = f"an image of {camera!r} at {timestamp_ns} ns"
            raise DataError(self.file, field="images", expected=expected, got=f"{len(self.images)} others")
        return found

    def build(self, image: ImageRef, camera: MountedCamera) -> ReferenceFrame:
        """The reference of an image, in place of `bench.reference.ReferenceBuilder`.

        Raises:
            BenchError: it has none, for the reason that the export gives.
            DataError: it is not in the export, is of another size than the camera, or is damaged.
        """
        entry, model = self.image(image.camera, image.timestamp_ns), camera.model
        if (entry.width, entry.height) != (model.width, model.height):
            expected, got = f"{model.width} x {model.height} px", f"{entry.width} x {entry.height}"
            raise DataError(self.file, field=f"images, id {entry.id}", expected=expected, got=got)
        return self.frame(entry)

    def frame(self, image: ImageEntry) -> ReferenceFrame:
        """The reference of an image.

        Raises:
            BenchError: it has none, for the reason that the export gives.
            DataError: pixels that cannot be read, or contradict the image's entry.
        """
        if image.problem:
            raise BenchError(image.problem)
        instances, labels, place = self._read(image)
        numbers = np.bincount(instances.ravel(), minlength=len(image.objects) + 1)[1:]
        if len(numbers) > len(image.objects):
            expected = f"instances 1 to {len(image.objects)}, the objects of {self.file.name}"
            raise DataError(place, expected=expected, got=str(len(numbers)))
        for item, pixels in zip(image.objects, numbers.tolist(), strict=True):
            if pixels != item.region_px:
                expected = f"{item.region_px} pixels of instance {item.instance_id}, as {self.file.name} says"
                raise DataError(place, expected=expected, got=str(pixels))
        if (labels > max(Label)).any():
            raise DataError(place, expected=f"labels 0 to {max(Label)}", got=str(int(labels.max())))
        if ((labels == Label.CORE) != (instances > 0)).any():
            raise DataError(place, expected="label 1 where an instance is, and nowhere else", got="another place")
        return image.frame(self._name, instances, labels)

    def digest(self, images: Sequence[ImageRef]) -> str:
        """SHA-256 of what was read of images, and of their files of pixels."""
        entries = [found for image in images if (found := self._by_image.get((image.camera, image.timestamp_ns)))]
        runs = [pixels for entry in entries for _, pixels in self._pixels.get(entry.id, [])]
        named = [self._categories.get(pixels.category_id) for pixels in runs]
        read = FileDigests()  # an image without its file is told where it is scored
        return digest_of(entries, runs, named, [read.of(file) for entry in entries for file in self._files(entry)])

    def _files(self, image: ImageEntry) -> list[Path]:
        """The files that hold an image's pixels, beside that of the recording."""
        if self._exported.head.form == "coco":
            return []
        key = image.camera, image.timestamp_ns
        return [png_file(self._exported.folder, self._name, what, *key) for what in ("instances", "labels")]

    def _read(self, image: ImageEntry) -> tuple[NDArray[Any], NDArray[Any], Path]:
        """Instances and labels of an image, and the file to name."""
        if files := self._files(image):
            instances, labels = _read_png(files[0], image, bits=16), _read_png(files[1], image, bits=8)
            return instances, labels, files[0]
        instances = np.zeros((image.height, image.width), dtype=np.uint16)
        labels = np.zeros_like(instances, dtype=np.uint8)
        for place, entry in self._pixels.get(image.id, []):
            pixels = decode_run_lengths(entry.segmentation, file=self.file, field=f"annotations[{place}].segmentation")
            instances[pixels] = entry.instance_id
            labels[pixels] = Label.CORE if entry.instance_id else AREAS[self._categories[entry.category_id]]
        return instances, labels, self.file


def _read_png(file: Path, image: ImageEntry, *, bits: Literal[8, 16]) -> NDArray[Any]:
    expected = f"a grey PNG of {bits} bits, {image.width} x {image.height} px"
    try:
        content = read_regular(file)
    except OSError as error:
        raise DataError(file, expected=expected, got=error.strerror or str(error)) from error
    values = decode_image(content, cv2.IMREAD_UNCHANGED, file=file)
    if values.dtype != f"uint{bits}" or values.shape != (image.height, image.width):
        raise DataError(file, expected=expected, got=f"{values.dtype} {values.shape}")
    return values
