"""Reading .pcd and .ply, by open3d.

The only module that imports open3d. The import takes 0.6 s, so it is done when it is needed. The wheel links against
`libusb-1.0.so.0`, which servers and containers often lack; the `libusb-package` wheel carries that library, and once it
is loaded for the whole process the import finds it, with no system package and no root.
"""

from __future__ import annotations

import ctypes
import re
import struct
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from bench.errors import DataError
from bench.lidar.sweep import LARGEST_BYTES, Arrays


@cache
def open3d() -> ModuleType:
    """The open3d module, imported on the first call."""
    try:
        import libusb_package
    except ImportError:  # only wanted on Linux
        pass
    else:
        library = libusb_package.get_library_path()
        if library is not None:
            ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    import open3d as module

    return module


PLY_TYPES = {
    **{name: np.dtype(name) for name in ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64")},
    "char": np.dtype("i1"),
    "uchar": np.dtype("u1"),
    "short": np.dtype("i2"),
    "ushort": np.dtype("u2"),
    "int": np.dtype("i4"),
    "uint": np.dtype("u4"),
    "float": np.dtype("f4"),
    "double": np.dtype("f8"),
}
NUMBER_BYTES = b"0123456789+-.eEnaifINFty"
PLY_WORDS = frozenset({"comment", "obj_info", "element", "property", "end_header"})  # behind the first two lines


def read_cloud(path: Path) -> Arrays:
    """Read points, and intensities and rings where they are.

    Raises:
        DataError: cut short, empty, or not of the suffix's format.
    """
    _refuse_cut_short(path)
    library = open3d()
    quiet = library.utility.VerbosityContextManager(library.utility.VerbosityLevel.Error)
    try:
        with quiet:
            cloud = library.t.io.read_point_cloud(str(path))
    except RuntimeError as error:
        raise DataError(path, expected=f"a whole {path.suffix} file", got=" ".join(str(error).split())) from error
    names = {str(name) for name in cloud.point}
    if "positions" not in names or not len(cloud.point.positions):
        raise DataError(path, expected=f"a whole {path.suffix} file with points", got="none that could be read")
    arrays: Arrays = {"points_lidar": cloud.point.positions.numpy().copy()}
    for name, dtype in (("intensity", np.float32), ("ring", np.uint8)):
        if name in names:
            arrays[name] = cloud.point[name].numpy().reshape(-1).astype(dtype)
    return arrays


def _refuse_cut_short(path: Path) -> None:
    """Compare the length of a .ply or .pcd file with its header: open3d fills up what is missing with zeros."""
    content = path.read_bytes()
    end = re.search(rb"^(end_header|DATA \w+)\r?\n", content, re.MULTILINE)
    head = content[: end.end()].decode("ascii", "replace").split("\n") if end else []
    words = [line.split() for line in head if line.strip()]
    is_ply = path.suffix.lower() == ".ply"
    kind = next((w[1] for w in words if w[0] in {"format", "DATA"}), "")
    try:
        rows, row_bytes = _ply_rows(words) if is_ply else _pcd_rows(words)
    except (ValueError, IndexError, KeyError, StopIteration):
        raise DataError(path, expected=f"the header of a {path.suffix} file", got="another or none") from None
    body = content[end.end() :] if end else b""
    if not 0 < rows * row_bytes <= LARGEST_BYTES:
        got = f"a header of {rows} points of {row_bytes} bytes"
        raise DataError(path, expected=f"points of at most {LARGEST_BYTES} bytes", got=got)
    if kind == "binary_compressed":
        _refuse_lying(path, body, rows * row_bytes)
    if kind == "ascii" and len(body.split(b"\n")) - body.endswith(b"\n") < rows:
        raise DataError(path, expected=f"{rows} lines of points", got="fewer; the file is cut short")
    if kind == "ascii" and is_ply:
        _refuse_other_words(path, body.split(), rows, [kind for _, kind in _ply_columns(words)])
    if kind.startswith("binary") and kind != "binary_compressed" and len(body) < rows * row_bytes:
        got = f"{len(body)}; the file is cut short"
        raise DataError(path, expected=f"{rows} points of {row_bytes} bytes, {rows * row_bytes} bytes in all", got=got)


def _refuse_lying(path: Path, body: bytes, unpacked: int) -> None:
    """Compare the two lengths before compressed points with the file: open3d allocates what they state."""
    if len(body) < 8:
        raise DataError(path, expected="compressed points", got=f"{len(body)} bytes; the file is cut short")
    packed, stated = struct.unpack_from("<II", body)
    if stated != unpacked:
        raise DataError(path, expected=f"{unpacked} bytes when unpacked, as the header says", got=str(stated))
    if packed > len(body) - 8:
        raise DataError(path, expected=f"{packed} bytes packed", got=f"{len(body) - 8}; the file is cut short")


def _refuse_other_words(path: Path, words: list[bytes], rows: int, types: Sequence[np.dtype[Any]]) -> None:
    """Compare the words of points with their types: open3d prints the first that is none, past all streams."""
    try:
        if b"".join(words).translate(None, NUMBER_BYTES):
            raise ValueError("words that NumPy takes for numbers, but open3d does not")
        values = np.array(words[: rows * len(types)], dtype=np.bytes_).astype(np.float64).reshape(rows, len(types))
    except ValueError:
        expected = f"{rows} points of {len(types)} numbers"
        raise DataError(path, field="vertex", expected=expected, got="fewer, or words that are none") from None
    for column, kind in zip(values.T, types, strict=True):
        span = np.iinfo(kind) if kind.kind in "iu" else np.finfo(kind)
        fits = (column >= span.min) & (column <= span.max) & ((column % 1 == 0) | (kind.kind == "f"))
        if not fits.all():
            row = int(np.argmin(fits))
            raise DataError(path, field=f"vertex {row}", expected=f"numbers of type {kind}", got=f"{column[row]:g}")


def _ply_rows(words: list[list[str]]) -> tuple[int, int]:
    """Number of vertices and bytes of one; the vertices come first in every point cloud."""
    if [w[0] for w in words[:2]] != ["ply", "format"] or not {w[0] for w in words[2:]} <= PLY_WORDS:
        raise ValueError("lines that no header has")
    first = next(i for i, w in enumerate(words) if w[0] == "element")
    if words[first][1] != "vertex":
        raise ValueError("vertices do not come first")
    columns = _ply_columns(words)
    if not {"x", "y", "z"} <= {name for name, _ in columns}:
        raise ValueError("vertices without x, y and z")
    return int(words[first][2]), sum(kind.itemsize for _, kind in columns)


def _ply_columns(words: list[list[str]]) -> list[tuple[str, np.dtype[Any]]]:
    first = next(i for i, w in enumerate(words) if w[0] == "element")
    after = next(i for i, w in enumerate([*words, ["end_header"]]) if i > first and w[0] in {"element", "end_header"})
    return [(w[2], PLY_TYPES[w[1]]) for w in words[first:after] if w[0] == "property"]


def _pcd_rows(words: list[list[str]]) -> tuple[int, int]:
    entries = {w[0]: w[1:] for w in words}
    counts = entries.get("COUNT", ["1"] * len(entries["SIZE"]))
    columns = {len(entries[name]) for name in ("FIELDS", "SIZE", "TYPE")} | {len(counts)}
    sound = set(entries["SIZE"]) <= {"1", "2", "4", "8"} and set(entries["TYPE"]) <= {"I", "U", "F"}
    if len(columns) != 1 or not {"x", "y", "z"} <= set(entries["FIELDS"]) or not sound or min(map(int, counts)) < 1:
        raise ValueError("columns that do not fit together")
    if int(entries["WIDTH"][0]) * int(entries["HEIGHT"][0]) != int(entries["POINTS"][0]):
        raise ValueError("WIDTH and HEIGHT that do not make POINTS")
    return int(entries["POINTS"][0]), sum(int(s) * int(c) for s, c in zip(entries["SIZE"], counts, strict=True))
