"""Masks and scores in files: grey PNG files, NumPy archives, COCO run lengths; what can be wrong, and sizes.

The files may be foreign: their sizes are checked before anything is unpacked.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from tokenize import TokenError
from typing import IO, Annotated, Any, Literal

import cv2
import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from bench.atomic import read_regular
from bench.errors import DataError
from bench.plain_yaml import parse_yaml
from bench.recordings.files import read_text
from bench.recordings.images import PNG_START, decode_values, stated_size_px
from bench.recordings.validation import FileModel, validated


class FaultKind(StrEnum):
    """Kinds of faults, in the order of reports."""

    MISSING = "missing"
    UNREADABLE = "unreadable"
    WRONG_SIZE = "wrong size"
    UNCLEAR = "unclear"
    TWICE = "twice"
    EXTRA = "extra"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One thing that is wrong.

    Attributes:
        kind: of fault.
        place: the file relative to the folder of predictions, or the image that has none.
        reason: what was expected and what was found.
    """

    kind: FaultKind
    place: str
    reason: str


class WrongSizeError(DataError):
    """A prediction of a size that neither divides nor multiplies the image's."""


class UnclearError(DataError):
    """A prediction whose values are no mask and no scores."""


def kind_of(error: DataError) -> FaultKind:
    """The kind of fault that an error of a reader is."""
    kinds = {WrongSizeError: FaultKind.WRONG_SIZE, UnclearError: FaultKind.UNCLEAR}
    return kinds.get(type(error), FaultKind.UNREADABLE)


def reason_of(error: DataError) -> str:
    """The text of an error, without the file."""
    where = f"{error.field}: " if error.field else ""
    return f"{where}expected {error.expected}, got {error.got}" + (f"; {error.hint}" if error.hint else "")


Size = tuple[int, int]
LARGEST_PX = 1 << 26  # of one prediction


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageSizes:
    """The sizes of an image.

    Attributes:
        evaluated_px: (width, height) at which it is scored.
        stored_px: (width, height) of its file.
    """

    evaluated_px: Size
    stored_px: Size

    def refuse_unfit(self, size_px: Size, *, file: Path, field: str | None = None) -> None:
        """Refuse a size that is no whole fraction or multiple of the image's.

        Raises:
            WrongSizeError: it is not, or larger than any prediction need be.
        """
        got = "{} x {}".format(*size_px)
        bases = (self.evaluated_px, self.stored_px)
        if not any(_times(base, size_px) or _times(size_px, base) for base in bases):
            known = " or ".join(dict.fromkeys("{} x {}".format(*base) for base in bases))
            expected = f"{known} px, or a whole fraction or multiple of it"
            raise WrongSizeError(file, field=field, expected=expected, got=got)
        if size_px[0] * size_px[1] > LARGEST_PX:
            raise WrongSizeError(file, field=field, expected=f"at most {LARGEST_PX} pixels", got=got)


def on_cells(values: NDArray[Any], sizes: ImageSizes) -> tuple[NDArray[np.float32], int]:
    """Bring a map to square cells that tile the evaluated image.

    A map of a whole fraction of the evaluated size stays as it is, each of its pixels a cell. One of a whole multiple
    is averaged over the block of each image pixel. One that fits only the stored size is brought to that by the same
    two rules, and from there to the evaluated size as images are, by their mean over areas.

    Args:
        values: (rows, columns) numbers in [0, 1] or bool, of a size that `ImageSizes.refuse_unfit` lets pass.
        sizes: of the image.

    Returns:
        (rows, columns) float32 in [0, 1], and the side of a cell, px.
    """
    size = values.shape[1], values.shape[0]
    if factor := _times(sizes.evaluated_px, size):
        return values.astype(np.float32, copy=False), factor
    if factor := _times(size, sizes.evaluated_px):
        return _block_mean(values, factor), 1
    if factor := _times(sizes.stored_px, size):
        stored = np.repeat(np.repeat(values.astype(np.float32), factor, axis=0), factor, axis=1)
    else:
        stored = _block_mean(values, _times(size, sizes.stored_px))
    evaluated = cv2.resize(stored, sizes.evaluated_px, interpolation=cv2.INTER_AREA)
    return np.asarray(evaluated, dtype=np.float32), 1


def _times(large: Size, small: Size) -> int:
    """Return how often `small` goes into `large` along both sides; 0 where it does not."""
    if min(small) < 1 or large[0] % small[0] or large[1] % small[1]:
        return 0
    factor = large[0] // small[0]
    return factor if factor == large[1] // small[1] else 0


def _block_mean(values: NDArray[Any], factor: int) -> NDArray[np.float32]:
    rows, columns = values.shape[0] // factor, values.shape[1] // factor
    blocks = values.reshape(rows, factor, columns, factor)
    means: NDArray[np.float64] = blocks.mean(axis=(1, 3), dtype=np.float64)
    return means.astype(np.float32)


LARGEST_SCORE = 65535
STATEMENT = "predictions.yaml"  # in a folder of predictions: what they are


FirstFrame = Literal[0, 1]


class FolderStatement(FileModel):
    """`predictions.yaml` of a folder of predictions.

    Attributes:
        sixteen_bits: "score" where PNG files of 16 bits hold scores, 0 to 65535 for 0 to 1.
        first_frame: number of a camera's first image, where the names count images.
    """

    sixteen_bits: Literal["score"] | None = None
    first_frame: FirstFrame | None = None


def read_statement(root: Path) -> FolderStatement:
    """What a folder says of its predictions; nothing without a file.

    Raises:
        DataError: a file that says something else.
    """
    file = root / STATEMENT
    if not file.exists():
        return FolderStatement()
    content = parse_yaml(read_text(file, largest_bytes=LARGEST_STATEMENT_BYTES), file=file)
    return validated(FolderStatement, content or {}, file=file)


LARGEST_STATEMENT_BYTES = 100_000
LARGEST_BYTES = 1 << 28  # of a file


def read_png_map(path: Path, sizes: ImageSizes, *, sixteen_bits: Literal["score"] | None = None) -> NDArray[Any]:
    """Read a prediction.

    Args:
        path: a PNG file of one grey channel.
        sizes: of the image.
        sixteen_bits: what the folder says that files of 16 bits are; None where it does not say.

    Returns:
        (rows, columns) bool, moving, for files of up to 8 bits; float32 scores in [0, 1] for files of 16 bits.

    Raises:
        DataError: missing, cut short, or no grey PNG.
        WrongSizeError: before anything is unpacked.
        UnclearError: a mask with other values than 0 and 255, or 0 and 1, or 16 bits of which the folder says nothing.
    """
    content = _content(path, LARGEST_BYTES)
    size_px = stated_size_px(content) if content.startswith(PNG_START) else None
    if size_px is None:
        got = f"{len(content)} bytes that begin with {content[:8].hex(' ')}" if content else "an empty file"
        raise DataError(path, expected="a whole PNG file", got=got)
    sizes.refuse_unfit(size_px, file=path)
    values = decode_values(content, file=path)
    if values.ndim != 2:
        raise DataError(path, expected="one grey channel", got=f"{values.shape[2]} channels")
    if values.dtype == np.uint16 and sixteen_bits == "score":
        return values.astype(np.float32) / np.float32(LARGEST_SCORE)
    if values.dtype == np.uint16:
        raise UnclearError(
            path,
            expected=f"a mask of 8 bits, or {STATEMENT} with `sixteen_bits: score`",
            got=f"16 bits, {shown_values(np.unique(values).tolist())}",
            hint="write ids as masks",
        )
    present = np.flatnonzero(np.bincount(values.ravel(), minlength=256)).tolist()
    if not (set(present) <= {0, 255} or set(present) <= {0, 1}):
        raise UnclearError(
            path,
            expected="a mask of the values 0 and 255, or 0 and 1",
            got=shown_values(present),
            hint=f"write scores as .npz, or as 16-bit PNG (0 to 65535) with {STATEMENT}",
        )
    moving: NDArray[np.bool_] = values > 0
    return moving


def shown_values(values: Sequence[int]) -> str:
    """The first few of the values of a file."""
    return f"the values {', '.join(map(str, values[:6]))}{', ...' if len(values) > 6 else ''}"


def _content(path: Path, largest_bytes: int) -> bytes:
    try:
        return read_regular(path, largest_bytes=largest_bytes)
    except OSError as error:
        raise DataError(path, expected="a file of predictions", got=error.strerror or str(error)) from error


ARRAY = "score"
_UNREADABLE = (
    *(OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, zlib.error),
    *(SyntaxError, TokenError),  # of headers that are no Python
)
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def read_npz_scores(path: Path, sizes: ImageSizes) -> NDArray[np.float32]:
    """Read the array `score`; other arrays of the file are not looked at.

    Args:
        path: an `.npz` file.
        sizes: of the image.

    Returns:
        (rows, columns) float32 in [0, 1].

    Raises:
        DataError: missing, cut short, pickled, or without floats of this name.
        WrongSizeError: before anything is unpacked.
        UnclearError: NaN, or values outside [0, 1].
    """
    try:
        with zipfile.ZipFile(path) as archive, archive.open(f"{ARRAY}.npy") as member:
            shape = _shape(path, member)
            sizes.refuse_unfit((shape[1], shape[0]), file=path, field=ARRAY)
            member.seek(0)
            scores = npy.read_array(member, allow_pickle=False)
    except DataError:
        raise
    except (*_UNREADABLE, zipfile.BadZipFile) as error:
        got = " ".join(str(error).split())[:200] or type(error).__name__
        raise DataError(path, field=ARRAY, expected="an .npz file with this array", got=got) from error
    low, high = float(scores.min()), float(scores.max())
    if not (low >= 0 and high <= 1):  # also for NaN
        got = f"{low:g} to {high:g}"
        hint = "bring them to [0, 1], for example by the logistic function; the order is what counts"
        raise UnclearError(path, field=ARRAY, expected="scores in [0, 1]", got=got, hint=hint)
    return scores.astype(np.float32)


def _shape(path: Path, member: IO[bytes]) -> tuple[int, int]:
    """(rows, columns) from the header."""
    version = npy.read_magic(member)
    if version not in _HEADERS:
        raise DataError(path, field=ARRAY, expected="an array of NumPy's format 1 or 2", got=f"{version}")
    shape, _, kind = _HEADERS[version](member)
    if len(shape) != 2 or kind.kind != "f":
        raise DataError(path, field=ARRAY, expected="floats on (rows, columns)", got=f"{kind} {shape}")
    return shape[0], shape[1]


LARGEST_TEXT_BYTES = 1 << 26  # of a file: the text of some twenty thousand masks
_NUMBERS = re.compile("(?:[P-o]{0,6}[0-O])*")  # as text each ends with a letter below "P"; 35 bits are enough

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
        """True if it belongs to a camera, or names none."""
        return self.camera in (None, camera)


_ENTRIES = TypeAdapter(list[MaskEntry])


def read_entries(path: Path) -> list[MaskEntry]:
    """Read a file of masks; the run lengths are not decoded yet.

    Raises:
        DataError: missing, too large, no JSON, or not a list of entries; names the first that is wrong.
    """
    content = _content(path, LARGEST_TEXT_BYTES)
    try:
        return _ENTRIES.validate_json(content)
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
        one = decode_run_lengths(mask, file=file, field=field)
        if moving is not None and moving.shape != one.shape:
            got = f"{moving.shape} and {one.shape} (height, width)"
            raise DataError(file, field=field, expected="all masks of an image at one size", got=got)
        moving = one if moving is None else moving | one
    assert moving is not None
    return moving


def decode_run_lengths(mask: RunLengths, *, file: Path, field: str) -> NDArray[np.bool_]:
    """Unpack a mask; its size is for the caller to check before.

    Not by `pycocotools` (2.0.11): of run lengths that are too short it returns memory that was never written, and of
    those that are too long it never frees the mask.

    Args:
        mask: to unpack.
        file: that it comes from, for messages.
        field: of the file.

    Raises:
        DataError: run lengths that are cut short or do not add up.
    """
    (height, width), counts = mask.size, mask.counts
    if isinstance(counts, str) and not _NUMBERS.fullmatch(counts):
        raise DataError(file, field=field, expected="whole COCO run lengths", got=f"{counts[:40]!r}")
    runs = _from_text(counts) if isinstance(counts, str) else counts
    if sum(runs) != height * width or min(runs) < 0:
        expected = f"run lengths that add up to {height} x {width} = {height * width}"
        got = "shorter ones" if sum(runs) < height * width and min(runs, default=0) >= 0 else "longer or negative ones"
        raise DataError(file, field=field, expected=expected, got=got)
    moving = np.repeat(np.arange(len(runs)) % 2 == 1, runs)  # column by column, the first run does not move
    return np.ascontiguousarray(moving.reshape(width, height).T)


def _from_text(counts: str) -> list[int]:
    """Numbers of COCO's text: 5 bits a letter, the lowest first, bit 6 for more; from the fourth on differences.

    Source:
        `rleFrString` of maskApi.c in pycocotools.
    """
    letters = np.frombuffer(counts.encode(), dtype=np.uint8).astype(np.int64) - ord("0")
    ends = np.flatnonzero(letters & 0x20 == 0)
    starts = np.concatenate([np.zeros(1, dtype=np.int64), ends + 1])[: len(ends)]
    places = np.arange(len(letters)) - np.repeat(starts, ends - starts + 1)
    numbers = np.add.reduceat((letters & 0x1F) << 5 * places, starts) if len(ends) else starts
    numbers -= np.where(letters[ends] & 0x10, np.int64(1) << 5 * (places[ends] + 1), 0)
    for first in (1, 2):
        numbers[first::2] = np.cumsum(numbers[first::2])
    return [int(number) for number in numbers.tolist()]


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """The file that holds the prediction of an image.

    Attributes:
        file: that holds it.
        camera: of the image.
        names: by which the file's list names the image; empty for a file of one image.
        sizes: of the image.
        sixteen_bits: what the folder says of PNG files of 16 bits.
    """

    file: Path
    camera: str
    names: tuple[str, ...]
    sizes: ImageSizes
    sixteen_bits: Literal["score"] | None = None


class PredictionReader:
    """Reads predictions; the last file of many images stays in memory."""

    def __init__(self) -> None:
        self._held: tuple[Path, Mapping[str, list[MaskEntry]]] | None = None

    def entries(self, file: Path) -> Mapping[str, list[MaskEntry]]:
        """The entries of a file of many images, by the names of their images.

        Raises:
            DataError: it cannot be read.
        """
        if self._held is None or self._held[0] != file:
            by_name: defaultdict[str, list[MaskEntry]] = defaultdict(list)
            for entry in read_entries(file):
                by_name[entry.name].append(entry)
            self._held = file, dict(by_name)
        return self._held[1]

    def read(self, prediction: Prediction) -> NDArray[Any]:
        """Read a prediction.

        Returns:
            (rows, columns) bool, moving, or float32 scores in [0, 1], at the size that they were stored at.

        Raises:
            DataError: it cannot be used; of the subclasses in `faults` where its size or values are at fault.
        """
        if prediction.names:
            entries = self.entries(prediction.file)
            chosen = [e for name in prediction.names for e in entries.get(name, []) if e.is_of(prediction.camera)]
            return decode_union(chosen, prediction.sizes, file=prediction.file)
        if prediction.file.suffix.lower() == ".npz":
            return read_npz_scores(prediction.file, prediction.sizes)
        return read_png_map(prediction.file, prediction.sizes, sixteen_bits=prediction.sixteen_bits)
