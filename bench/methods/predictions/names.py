"""Which image a name means: a time, a frame number, or the name of the image's file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, get_args

from bench.errors import UsageError
from bench.methods.predictions.images import CameraImages, NamedImage

Naming = Literal["auto", "timestamp", "frame", "image"]
NAMINGS: tuple[Naming, ...] = get_args(Naming)
LONGEST_NUMBER = 19  # digits of an int64


def named_images(names: Sequence[str], images: CameraImages, *, naming: Naming = "auto") -> dict[str, NamedImage]:
    """The images that names mean; names that mean none are left out.

    Args:
        names: of the predictions of one camera in one recording.
        images: of this camera.
        naming: what the names are; "auto" takes what most of them fit.

    Raises:
        UsageError: they fit two readings equally well, which mean different images.
    """
    if naming != "auto":
        return _read_as(naming, names, images)
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
        by_stem = {image.stem: image for image in images.images}
        return {name: by_stem[name] for name in names if name in by_stem}
    by_number: Mapping[int, NamedImage] = {
        (image.timestamp_ns if naming == "timestamp" else image.frame): image for image in images.images
    }
    numbers = {name: int(name) for name in names if _is_number(name)}
    return {name: by_number[number] for name, number in numbers.items() if number in by_number}


def _is_number(name: str) -> bool:
    return name.isascii() and name.isdigit() and len(name) <= LONGEST_NUMBER
