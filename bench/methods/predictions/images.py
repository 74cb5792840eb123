"""The images of a data set that predictions are paired with, and which of them a name means."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Literal, NamedTuple, get_args

from bench.errors import UsageError
from bench.methods.predictions.files import STATEMENT, FirstFrame, ImageSizes
from bench.recordings import ImageRef, RecordingHandle, frame_gaps


class ImageKey(NamedTuple):
    """An image of a data set; it sorts by recording, camera and time."""

    recording: str
    camera: str
    timestamp_ns: int

    def __str__(self) -> str:
        return f"{self.recording}/{self.camera}/{self.timestamp_ns}"


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedImage:
    """An image and what it may be called.

    Attributes:
        timestamp_ns: its time.
        frame: its number.
        file: name of its file.
        scored: whether it will be scored: not excluded, with as many images before it as are asked for, no gap between.
    """

    timestamp_ns: int
    frame: int
    file: str
    scored: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraImages:
    """All images of a camera in a recording, excluded ones included, by increasing time; `annotated` where any is."""

    recording: str
    camera: str
    sizes: ImageSizes
    annotated: bool
    images: tuple[NamedImage, ...]

    def key(self, image: NamedImage) -> ImageKey:
        """The image among all of the data set."""
        return ImageKey(self.recording, self.camera, image.timestamp_ns)


def camera_images(handle: RecordingHandle, *, history: int) -> Iterator[CameraImages]:
    """The images of a recording, camera by camera.

    Args:
        handle: of the recording.
        history: images that must lie before one that is scored, each at its due time.

    Raises:
        DataError: the recording cannot be opened.
    """
    whole = replace(handle, exclusions=()).open()
    remaining = {
        camera: tuple(
            ref for i, ref in enumerate(refs) if not any(e.covers(i, ref.timestamp_ns) for e in handle.exclusions)
        )
        for camera, refs in whole.images.items()
    }
    scorable = replace(whole, images=remaining)
    for name, camera in sorted(whole.cameras.items()):
        refs = whole.images[name]
        late = {gap.index for gap in frame_gaps(scorable, name)}
        scored = {
            ref.timestamp_ns
            for i, ref in enumerate(remaining[name])
            if i >= history and late.isdisjoint(range(i - history + 1, i + 1))
        }
        yield CameraImages(
            recording=whole.name,
            camera=name,
            sizes=ImageSizes(
                evaluated_px=(camera.model.width, camera.model.height),
                stored_px=(camera.stored_size_px[0], camera.stored_size_px[1]),
            ),
            annotated=any(whole.annotated.covers(ref.timestamp_ns) for ref in remaining[name]),
            images=tuple(
                NamedImage(
                    timestamp_ns=ref.timestamp_ns, frame=frame, file=ref.path.name, scored=ref.timestamp_ns in scored
                )
                for ref, frame in zip(refs, _frame_numbers(refs), strict=True)
            ),
        )


def _frame_numbers(refs: Sequence[ImageRef]) -> list[int]:
    """The numbers that name the files, where these are numbers but no times; else indices from 0."""
    stems = [ref.path.stem for ref in refs]
    if all(stem.isascii() and stem.isdigit() for stem in stems):
        numbers = [int(stem) for stem in stems]
        times = [ref.timestamp_ns for ref in refs]
        if numbers != times and len(set(numbers)) == len(numbers):
            return numbers
    return list(range(len(refs)))


Naming = Literal["auto", "timestamp", "frame", "image"]
NAMINGS: tuple[Naming, ...] = get_args(Naming)
LONGEST_NUMBER = 19  # digits of an int64


def named_images(
    names: Sequence[str], images: CameraImages, *, naming: Naming = "auto", first_frame: FirstFrame | None = None
) -> dict[str, NamedImage]:
    """The images that names mean; names that mean none are left out.

    Args:
        names: of the predictions of one camera in one recording.
        images: of this camera.
        naming: what the names are; "auto" takes what most of them fit.
        first_frame: number of the first image, where the names count images; None where nobody says so.

    Raises:
        UsageError: they fit two readings equally well, which mean different images; or they are numbers that may count
            from 0 or from 1, and nobody says which; or what is said contradicts `naming`.
    """
    if first_frame is not None:
        if naming not in ("auto", "frame"):
            raise UsageError(f"{STATEMENT}: first_frame: expected none beside --names {naming}, got {first_frame}")
        numbered = dict(enumerate(images.images, first_frame))
        return {name: numbered[int(name)] for name in names if _is_number(name) and int(name) in numbered}
    found = _most_named(names, images) if naming == "auto" else _read_as(naming, names, images)
    _refuse_unclear_indices(names, found, images)
    return found


def _refuse_unclear_indices(names: Sequence[str], found: Mapping[str, NamedImage], images: CameraImages) -> None:
    """Refuse indices without a 0 that may count from 1, of which each would mean the image before its own."""
    count, numbers = len(images.images), {int(name) for name in names if _is_number(name)}
    by_index = [image.frame for image in images.images] == list(range(count))
    only_indices = found == _read_as("frame", names, images) and not any(
        found == _read_as(other, names, images) for other in ("timestamp", "image")
    )
    if found and by_index and only_indices and 0 not in numbers and numbers & {1, count}:
        raise UsageError(
            f"predictions of {images.recording}/{images.camera}: expected frame numbers that count from 0, got "
            f"{min(numbers)} to {max(numbers)} of {count} images, which may count from 1; say `first_frame: 0` or "
            f"`first_frame: 1` in {STATEMENT}, or name them by the times of the images"
        )


def _most_named(names: Sequence[str], images: CameraImages) -> dict[str, NamedImage]:
    readings = {one: _read_as(one, names, images) for one in NAMINGS if one != "auto"}
    most = max(len(found) for found in readings.values())
    best = {one: found for one, found in readings.items() if len(found) == most}
    first = next(iter(best.values()))
    if any(found != first for found in best.values()):
        name = next(n for n in names if len({found.get(n) for found in best.values()}) > 1)
        raise UsageError(
            f"predictions of {images.recording}/{images.camera}: {name!r} may be a {' or a '.join(best)}, which are "
            f"different images; say which with --names {' or --names '.join(best)}"
        )
    return first


def _read_as(naming: Naming, names: Sequence[str], images: CameraImages) -> dict[str, NamedImage]:
    if naming == "image":
        by_name = {name: image for image in images.images for name in (image.file, PurePath(image.file).stem)}
        return {name: by_name[name] for name in names if name in by_name}
    by_number: Mapping[int, NamedImage] = {
        (image.timestamp_ns if naming == "timestamp" else image.frame): image for image in images.images
    }
    numbers = {name: int(name) for name in names if _is_number(name)}
    return {name: by_number[number] for name, number in numbers.items() if number in by_number}


def _is_number(name: str) -> bool:
    return name.isascii() and name.isdigit() and len(name) <= LONGEST_NUMBER
