"""Reading .npz and .bin."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from bench.errors import DataError

Arrays = dict[str, NDArray[Any]]

BIN_COLUMNS = 4  # x, y, z, intensity
LARGEST_BYTES = 1 << 28  # of an unpacked sweep: ten million points
UNREADABLE = (
    *(OSError, ValueError, EOFError, KeyError, AttributeError, TypeError, MemoryError),
    *(NotImplementedError, RuntimeError, zlib.error, zipfile.BadZipFile),
    *(SyntaxError, TokenError),  # of headers that are no Python
)
NPY_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
NPZ_TYPES = {
    "points_lidar": {"f": "floating point"},
    "intensity": {"f": "floating point"},
    "time_offset_ns": {"i": "int64"},
    "ring": {"u": "uint8", "i": "integers"},
}
NPZ_ARRAYS = tuple(NPZ_TYPES)
NPZ_STORED = {"intensity": np.float32, "time_offset_ns": np.int64, "ring": np.uint8}


def read_npz(path: Path) -> Arrays:
    """Read our own arrays; objects (pickles) and arrays of other names are refused.

    `numpy.load` alone allocates what a header states before it checks whether the file holds as much.

    Raises:
        DataError: cut short, an array that is missing, unknown or of another type.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
            if unpacked > LARGEST_BYTES:
                raise DataError(
                    path, expected=f"at most {LARGEST_BYTES} bytes of arrays", got=f"{unpacked} when unpacked"
                )
            arrays: Arrays = {
                entry.filename.removesuffix(".npy"): _array(path, archive, entry) for entry in archive.infolist()
            }
    except DataError:
        raise
    except UNREADABLE as error:
        got = " ".join(str(error).split())[:200] or type(error).__name__
        raise DataError(path, expected="a whole .npz file of plain arrays", got=got) from error
    for name, values in arrays.items():
        if name not in NPZ_TYPES:
            raise DataError(path, field=name, expected=f"only the arrays {', '.join(NPZ_ARRAYS)}", got="this one")
        if values.dtype.kind not in NPZ_TYPES[name]:
            expected = " or ".join(NPZ_TYPES[name].values())
            raise DataError(path, field=name, expected=expected, got=str(values.dtype))
    if "points_lidar" not in arrays:
        raise DataError(path, field="points_lidar", expected="an array of this name", got="none")
    if "ring" in arrays and arrays["ring"].size and not 0 <= int(arrays["ring"].max()) < 256:
        raise DataError(path, field="ring", expected="0 to 255", got=str(arrays["ring"].max()))
    return {name: values.astype(NPZ_STORED.get(name, values.dtype), copy=False) for name, values in arrays.items()}


def _array(path: Path, archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """An array of an entry, read-only."""
    if entry.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:  # `zipfile` limits no other's memory
        raise zipfile.BadZipFile(f"{entry.filename} is packed in another way than by deflate")
    with archive.open(entry) as packed:
        content = packed.read(entry.file_size)  # without the size, a stream is unpacked beyond it
    if len(content) != entry.file_size:
        raise zipfile.BadZipFile(f"{entry.filename} is cut short")
    member = io.BytesIO(content)
    version = npy.read_magic(member)
    if version not in NPY_HEADERS:
        raise DataError(path, field=entry.filename, expected="NumPy's format 1 or 2", got=str(version))
    shape, by_column, kind = NPY_HEADERS[version](member)
    told, held = math.prod(shape) * max(kind.itemsize, 1), len(content) - member.tell()
    if told > held or min(shape, default=0) < 0:
        got = f"a header of {shape} x {kind.itemsize} bytes over {held}"
        raise DataError(path, field=entry.filename, expected="a whole array", got=got)
    if kind.hasobject:
        raise DataError(path, field=entry.filename, expected="an array of numbers", got="Python objects")
    values = np.frombuffer(content, dtype=kind, count=math.prod(shape), offset=member.tell())
    return values.reshape(shape, order="F" if by_column else "C")


def read_bin(path: Path) -> Arrays:
    """Read KITTI's float32 rows of x, y, z and intensity.

    Raises:
        DataError: empty, or not whole rows.
    """
    size = path.stat().st_size
    if not size or size % (4 * BIN_COLUMNS):
        raise DataError(
            path, expected="rows of four float32 (16 bytes)", got=f"{size} bytes; the file may be cut short"
        )
    rows = np.fromfile(path, dtype="<f4").reshape(-1, BIN_COLUMNS)
    return {"points_lidar": rows[:, :3].copy(), "intensity": rows[:, 3].copy()}
