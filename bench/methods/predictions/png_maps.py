"""Masks and scores as grey PNG files."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError
from bench.methods.predictions.faults import UnclearError
from bench.methods.predictions.sizes import ImageSizes
from bench.recordings.images import PNG_START, read_unchanged

GREY = 0
COLOUR_TYPES = {2: "a colour PNG", 3: "a PNG with a palette", 4: "a PNG with transparency", 6: "a colour PNG"}
LARGEST_SCORE = 65535
LARGEST_BYTES = 1 << 28  # of a file
_HEADER = struct.Struct(">8xI4sIIBB")  # past the signature: length, "IHDR", width, height, bits, colour type


def read_png_map(path: Path, sizes: ImageSizes) -> NDArray[Any]:
    """Read a prediction.

    Args:
        path: a PNG file of one grey channel.
        sizes: of the image.

    Returns:
        (rows, columns) bool, moving, for files of up to 8 bits; float32 scores in [0, 1] for files of 16 bits.

    Raises:
        DataError: missing, cut short, or no grey PNG.
        WrongSizeError: before anything is unpacked.
        UnclearError: a mask with other values than 0 and 255, or 0 and 1.
    """
    width, height = _grey_size(path)
    sizes.refuse_unfit((width, height), file=path)
    values = read_unchanged(path)
    if values.shape != (height, width):
        raise DataError(path, expected="a grey PNG", got=f"{values.ndim} axes of {values.shape} when unpacked")
    if values.dtype == np.uint16:
        return values.astype(np.float32) / np.float32(LARGEST_SCORE)
    present = np.flatnonzero(np.bincount(values.ravel(), minlength=256)).tolist()
    if not (set(present) <= {0, 255} or set(present) <= {0, 1}):
        raise UnclearError(
            path,
            expected="a mask of the values 0 and 255, or 0 and 1",
            got=f"the values {', '.join(map(str, present[:6]))}{', ...' if len(present) > 6 else ''}",
            do="write scores as 16-bit PNG (0 to 65535) or .npz",
        )
    moving: NDArray[np.bool_] = values > 0
    return moving


def _grey_size(path: Path) -> tuple[int, int]:
    """(width, height) from the header, so that nothing larger than an image is ever unpacked."""
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            start = file.read(_HEADER.size)
    except OSError as error:
        raise DataError(path, expected="a PNG file", got=error.strerror or str(error)) from error
    if size > LARGEST_BYTES:
        raise DataError(path, expected=f"a PNG file of at most {LARGEST_BYTES} bytes", got=f"{size}")
    if not start.startswith(PNG_START) or len(start) < _HEADER.size:
        got = f"{len(start)} bytes that begin with {start[:8].hex(' ')}" if start else "an empty file"
        raise DataError(path, expected="a whole PNG file", got=got)
    _, name, width, height, bits, colour = _HEADER.unpack(start)
    if name != b"IHDR":
        raise DataError(path, expected="a PNG file that begins with its header", got=repr(name))
    if colour != GREY:
        raise DataError(path, expected="one grey channel", got=COLOUR_TYPES.get(colour, f"colour type {colour}"))
    if bits not in (1, 2, 4, 8, 16):
        raise DataError(path, expected="8 bits for a mask, 16 bits for scores", got=f"{bits} bits")
    return width, height
