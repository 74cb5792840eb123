"""Point clouds in .pcd and .ply: the header gives the offset of each number in a point, all that NumPy needs.

A field of COUNT 0, which some tools write for padding of another length, means that the offsets of the
fields behind it are unknown: files in which one of them is needed are refused. Compressed .pcd files are unpacked here:
open3d drops times of points that are whole numbers, and fields that pad a point (`_`) crash it.

This is the only module that imports open3d. The import takes 0.6 s, so it is done when it is needed. The wheel links
against `libusb-1.0.so.0`, which servers and containers often lack; the `libusb-package` wheel carries that library,
and once it is loaded for the whole process the import finds it, with no system package and no root.
"""

from __future__ import annotations

import ctypes
import re
import struct
import sys
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bench.atomic import write_bytes
from bench.errors import DataError, UsageError
from bench.lidar.fields import INTENSITY_FIELDS, RING_FIELDS, is_time
from bench.lidar.sweep import LARGEST_BYTES, Arrays


@cache
def open3d() -> ModuleType:
    """The open3d module, imported on the first call.

    Raises:
        UsageError: libraries of the system that it links against are missing.
    """
    try:
        import libusb_package
    except ImportError:  # only wanted on Linux
        pass
    else:
        library = libusb_package.get_library_path()
        if library is not None:
            ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    # Its viewers import plotly and dash, which nothing here needs; an installation may leave them out.
    viewers = "open3d.visualization"
    without_viewers = not all(map(find_spec, ("plotly", "dash")))
    if without_viewers:
        sys.modules.setdefault(viewers, ModuleType(viewers))
    try:
        import open3d as module
    except (ImportError, OSError) as error:
        hint = "it links against libraries that slim systems lack, on Debian: apt-get install libegl1 libgl1 libx11-6"
        raise UsageError(f"open3d: expected a library that loads, got {error}; {hint}") from error
    finally:
        if without_viewers:
            del sys.modules[viewers]
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
PLY_ORDERS: dict[str, Literal["=", "<", ">"]] = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
PCD_TYPES = {"I": "i", "U": "u", "F": "f"}
PCD_SIZES = {"I": (1, 2, 4, 8), "U": (1, 2, 4, 8), "F": (4, 8)}
PADDING = "_"
PLY_WORDS = frozenset({"comment", "obj_info", "element", "property", "end_header"})  # behind the first two lines
WANTED = frozenset({*"xyz", *INTENSITY_FIELDS, *RING_FIELDS})


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Header of a .pcd or .ply file.

    Attributes:
        kind: of the data, as the format calls it.
        rows: number of points.
        columns: name, type and count of numbers of each field of a point, in order.
    """

    kind: str
    rows: int
    columns: tuple[tuple[str, np.dtype[Any], int], ...]

    @property
    def row_bytes(self) -> int:
        """Of a point."""
        return sum(dtype.itemsize * count for _, dtype, count in self.columns)

    @property
    def lost(self) -> list[str]:
        """Fields that are needed and follow one of no numbers."""
        counts = [count for _, _, count in self.columns]
        behind = self.columns[counts.index(0) :] if 0 in counts else ()
        return [name for name, _, _ in behind if name in WANTED or is_time(name)]


def read_cloud(path: Path) -> Arrays:
    """Read points, and every other field of one number by its name.

    Raises:
        DataError: cut short, empty, or not of the suffix's format.
    """
    content = path.read_bytes()
    end = re.search(rb"^(end_header|DATA \w+)\r?\n", content, re.MULTILINE)
    last = "end_header" if path.suffix.lower() == ".ply" else "DATA"
    if not end:
        got = f"none in {len(content)} bytes"
        raise DataError(path, field=last, expected=f"the line that ends the header of a {path.suffix} file", got=got)
    head = content[: end.end()].decode("ascii", "replace").split("\n")
    words = [line.split() for line in head if line.strip() and not line.startswith("#")]
    try:
        layout = _ply_layout(words) if path.suffix.lower() == ".ply" else _pcd_layout(words)
    except (ValueError, IndexError, KeyError, StopIteration) as error:
        missing = isinstance(error, KeyError) and str(error.args[0]).isupper()
        got = f"no line {error.args[0]}" if missing else " ".join(str(error).split()) or "lines cut short"
        raise DataError(path, field="header", expected=f"the header of a {path.suffix} file", got=got) from None
    if not layout.rows:
        raise DataError(path, field="POINTS", expected="points", got="0, an empty cloud", hint="remove the file")
    if layout.lost:
        hint = "write the cloud again without padding, or without these fields"
        got = "0, so that their offsets are unknown"
        expected = f"a COUNT of 1 or more for each field before {', '.join(layout.lost)}"
        raise DataError(path, field="COUNT", expected=expected, got=got, hint=hint)
    if not 0 < layout.rows * layout.row_bytes <= LARGEST_BYTES:
        got = f"a header of {layout.rows} points of {layout.row_bytes} bytes"
        raise DataError(path, expected=f"points of at most {LARGEST_BYTES} bytes", got=got)
    body = content[end.end() :]
    match layout.kind:
        case "ascii":
            fields = _written(path, body, layout)
        case "binary_compressed":
            fields = _packed(path, _unpacked(path, body, layout), layout, by_column=True)
        case _:
            fields = _packed(path, body, layout)
    return _arrays(fields)


def write_pcd(path: Path, points: NDArray[np.floating], intensity: NDArray[np.float32] | None = None) -> None:
    """Write a binary .pcd of x, y, z and intensity, float32.

    Args:
        path: the file, overwritten.
        points: (N, 3), m.
        intensity: (N,), or None for 0.

    Raises:
        OutputError: it cannot be written.
    """
    values = np.zeros((len(points), 4), dtype="<f4")
    values[:, :3] = points
    if intensity is not None:
        values[:, 3] = intensity
    head = (
        "VERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
        f"WIDTH {len(values)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(values)}\nDATA binary\n"
    )
    write_bytes(path, head.encode() + values.tobytes())


def _arrays(fields: dict[str, NDArray[Any]]) -> Arrays:
    points = np.stack([fields.pop(axis) for axis in "xyz"], axis=-1)
    return {"points_lidar": points if points.dtype.kind == "f" else points.astype(np.float64)} | fields


def _packed(path: Path, body: bytes, layout: Layout, *, by_column: bool = False) -> dict[str, NDArray[Any]]:
    """Points as bytes, one after the other, or all of a field and then of the next."""
    needed = layout.rows * layout.row_bytes
    if len(body) < needed:
        got = f"{len(body)}; the file is cut short"
        expected = f"{layout.rows} points of {layout.row_bytes} bytes, {needed} bytes in all"
        raise DataError(path, expected=expected, got=got)
    fields, offset = dict[str, NDArray[Any]](), 0
    for name, dtype, count in layout.columns:
        if count == 1 and name != PADDING:
            start = offset * layout.rows if by_column else offset
            step = dtype.itemsize if by_column else layout.row_bytes
            values = np.ndarray((layout.rows,), dtype, body, start, (step,))
            fields[name] = values.astype(dtype.newbyteorder("="))
        offset += dtype.itemsize * count
    return fields


def _written(path: Path, body: bytes, layout: Layout) -> dict[str, NDArray[Any]]:
    """Points as text."""
    width = sum(count for _, _, count in layout.columns)
    words = body.split()
    if len(body.split(b"\n")) - body.endswith(b"\n") < layout.rows or len(words) < layout.rows * width:
        raise DataError(path, expected=f"{layout.rows} lines of {width} numbers", got="fewer; the file is cut short")
    table = np.array(words[: layout.rows * width], dtype=np.bytes_).reshape(layout.rows, width)
    fields, first = dict[str, NDArray[Any]](), 0
    for name, dtype, count in layout.columns:
        if count == 1 and name != PADDING:
            fields[name] = _typed(path, name, table[:, first], dtype)
        first += count
    return fields


def _typed(path: Path, name: str, words: NDArray[np.bytes_], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Words as numbers of a type that holds them."""
    try:
        with np.errstate(over="raise"):
            return words.astype(dtype) if dtype.kind != "f" else words.astype(np.float64).astype(dtype)
    except (ValueError, OverflowError, FloatingPointError) as error:
        got = " ".join(str(error).split())[:80]
        raise DataError(path, field=name, expected=f"numbers of type {dtype}", got=got) from None


def _unpacked(path: Path, body: bytes, layout: Layout) -> bytes:
    """The points of a compressed file; the two lengths before them are compared with the file first."""
    from bench.lidar.lzf import unpack_lzf  # numba takes half a second, and only these files need it

    if len(body) < 8:
        raise DataError(path, expected="compressed points", got=f"{len(body)} bytes; the file is cut short")
    packed, stated = struct.unpack_from("<II", body)
    unpacked = layout.rows * layout.row_bytes
    if stated != unpacked:
        raise DataError(path, expected=f"{unpacked} bytes when unpacked, as the header says", got=str(stated))
    if packed > len(body) - 8:
        raise DataError(path, expected=f"{packed} bytes packed", got=f"{len(body) - 8}; the file is cut short")
    points = np.empty(unpacked, dtype=np.uint8)
    written = unpack_lzf(np.frombuffer(body, dtype=np.uint8, count=packed, offset=8), points)
    if written != unpacked:
        got = "data that is damaged" if written < 0 else f"{written}"
        raise DataError(path, expected=f"{unpacked} bytes of unpacked points", got=got)
    return points.tobytes()


def _ply_layout(words: list[list[str]]) -> Layout:
    """The vertices come first in every point cloud."""
    if [w[0] for w in words[:2]] != ["ply", "format"] or not {w[0] for w in words[2:]} <= PLY_WORDS:
        raise ValueError("lines that no header has")
    first = next(i for i, w in enumerate(words) if w[0] == "element")
    if words[first][1] != "vertex":
        raise ValueError("vertices do not come first")
    after = next(i for i, w in enumerate(words) if i > first and w[0] in {"element", "end_header"})
    order = PLY_ORDERS[words[1][1]]
    columns = [(w[2], PLY_TYPES[w[1]].newbyteorder(order), 1) for w in words[first:after] if w[0] == "property"]
    return _checked(Layout(kind=words[1][1], rows=int(words[first][2]), columns=tuple(columns)))


def _pcd_layout(words: list[list[str]]) -> Layout:
    entries = {w[0]: w[1:] for w in words}
    names, kinds, sizes = entries["FIELDS"], entries["TYPE"], list(map(int, entries["SIZE"]))
    counts = list(map(int, entries.get("COUNT", ["1"] * len(names))))
    if len({len(names), len(kinds), len(sizes), len(counts)}) > 1:
        numbers = f"{len(names)} FIELDS, {len(kinds)} TYPE, {len(sizes)} SIZE and {len(counts)} COUNT"
        raise ValueError(f"{numbers}, not one for each field")
    if any(size not in PCD_SIZES.get(kind, ()) for kind, size in zip(kinds, sizes, strict=True)) or min(counts) < 0:
        raise ValueError("a TYPE, SIZE or COUNT that no field has")
    width, height = int(entries["WIDTH"][0]), int(entries.get("HEIGHT", ["1"])[0])
    rows = int(entries.get("POINTS", [str(width * height)])[0])
    if width * height != rows:
        raise ValueError(f"WIDTH {width} and HEIGHT {height} that do not make POINTS {rows}")
    kind = entries["DATA"][0]
    if kind not in {"ascii", "binary", "binary_compressed"}:
        raise ValueError(f"DATA {kind}")
    types = [np.dtype(f"<{PCD_TYPES[kind]}{size}") for kind, size in zip(kinds, sizes, strict=True)]
    columns = tuple(zip(names, types, counts, strict=True))
    return _checked(Layout(kind=kind, rows=rows, columns=columns))


def _checked(layout: Layout) -> Layout:
    """Refuse points without x, y and z, and fields that share a name."""
    named = [name for name, _, count in layout.columns if count == 1 and name != PADDING]
    if not {"x", "y", "z"} <= set(named) or len(set(named)) < len(named):
        raise ValueError(f"the fields {', '.join(named)}, without x, y and z or with a name twice")
    return layout
