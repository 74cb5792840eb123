"""Scores as NumPy archives."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from tokenize import TokenError
from typing import IO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from bench.errors import DataError
from bench.methods.predictions.faults import UnclearError
from bench.methods.predictions.sizes import ImageSizes

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
        do = "bring them to [0, 1], for example by the logistic function; the order is what counts"
        raise UnclearError(path, field=ARRAY, expected="scores in [0, 1]", got=got, do=do)
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
