"""Masks as COCO run lengths.

A mask is read column by column; runs of 0 and 1 follow each other, the first of 0. The lengths stand as a list or as
text: each number, from the fourth on its difference to the last but one, in groups of five bits, the lowest first,
bit 6 set where more follow, 48 added to make it a letter.

`pycocotools` is not used to decode: for lengths that do not add up to the mask it returns memory that was never
written (2.0.11), so they would have to be decoded first to find out.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from bench.errors import DataError
from bench.methods.predictions.sizes import ImageSizes

LARGEST_BYTES = 1 << 26  # of a file: the text of some twenty thousand masks
_LETTERS = (48, 111)  # "0" to "o": six bits
_MOST_GROUPS = 7  # 35 bits, enough for any length and its difference

Side = Annotated[int, Field(ge=1, strict=True)]


class RunLengths(BaseModel):
    """COCO's run lengths of one mask."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    size: tuple[Side, Side]
    counts: str | list[Annotated[int, Field(ge=0, strict=True)]]


class MaskEntry(BaseModel):
    """An entry of a file; COCO's other keys (`category_id`, `score`, `bbox` ...) are not looked at."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    image: str | Annotated[int, Field(strict=True)]
    camera: str | None = None
    segmentation: RunLengths | None

    @property
    def name(self) -> str:
        """The image, as a file would be named."""
        return str(self.image)

    def is_of(self, camera: str) -> bool:
        """Whether it is of a camera, or does not say of which."""
        return self.camera in (None, camera)


_ENTRIES = TypeAdapter(list[MaskEntry])


def read_entries(path: Path) -> list[MaskEntry]:
    """Read a file of masks; the run lengths are not decoded yet.

    Raises:
        DataError: missing, too large, no JSON, or not a list of entries; names the first that is wrong.
    """
    try:
        size = path.stat().st_size
        if size > LARGEST_BYTES:
            raise DataError(path, expected=f"a file of at most {LARGEST_BYTES} bytes", got=f"{size}")
        return _ENTRIES.validate_json(path.read_bytes())
    except OSError as error:
        raise DataError(path, expected="a file of masks", got=error.strerror or str(error)) from error
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"]) or None
        expected = 'a list of {"image": name, "segmentation": {"size": [height, width], "counts": run lengths}}'
        raise DataError(path, field=field, expected=expected, got=first["msg"]) from error


def decode_union(entries: Sequence[MaskEntry], sizes: ImageSizes, *, file: Path) -> NDArray[np.bool_]:
    """The union of all masks of an image.

    Args:
        entries: of one image, at least one.
        sizes: of the image.
        file: that they come from, for messages.

    Returns:
        (rows, columns) bool, moving; at the evaluated size where all entries are empty.

    Raises:
        DataError: run lengths that are cut short or do not add up.
        WrongSizeError: before anything is unpacked, also where the entries are of different sizes.
    """
    masks = [entry.segmentation for entry in entries if entry.segmentation is not None]
    width, height = sizes.evaluated_px
    if not masks:
        return np.zeros((height, width), dtype=bool)
    field = f"image {entries[0].name}"
    moving: NDArray[np.bool_] | None = None
    for mask in masks:
        sizes.refuse_unfit((mask.size[1], mask.size[0]), file=file, field=field)
        one = _decode(mask, file, field)
        if moving is not None and moving.shape != one.shape:
            got = f"{moving.shape} and {one.shape} (height, width)"
            raise DataError(file, field=field, expected="all masks of an image at one size", got=got)
        moving = one if moving is None else moving | one
    assert moving is not None
    return moving


def _decode(mask: RunLengths, file: Path, field: str) -> NDArray[np.bool_]:
    height, width = mask.size
    lengths = _lengths(mask.counts, file, field) if isinstance(mask.counts, str) else mask.counts
    if any(length < 0 for length in lengths) or sum(lengths) != height * width:
        expected = f"run lengths that add up to {height} x {width} = {height * width}"
        got = f"a sum of {sum(lengths)}" if all(length >= 0 for length in lengths) else "a negative length"
        raise DataError(file, field=field, expected=expected, got=got)
    values = np.arange(len(lengths)) % 2 == 1
    return np.ascontiguousarray(np.repeat(values, lengths).reshape(width, height).T)


def _lengths(text: str, file: Path, field: str) -> list[int]:
    lengths: list[int] = []
    number = groups = 0
    for letter in text:
        code = ord(letter)
        if not _LETTERS[0] <= code <= _LETTERS[1] or groups == _MOST_GROUPS:
            raise DataError(file, field=field, expected="COCO run lengths", got=f"{letter!r} among them")
        bits = code - _LETTERS[0]
        number |= (bits & 0x1F) << 5 * groups
        groups += 1
        if bits & 0x20:
            continue
        if bits & 0x10:  # the sign
            number -= 1 << 5 * groups
        lengths.append(number + lengths[-2] if len(lengths) > 2 else number)
        number = groups = 0
    if groups:
        raise DataError(file, field=field, expected="whole COCO run lengths", got="a number that is cut short")
    return lengths
