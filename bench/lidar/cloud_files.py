"""Point clouds in .pcd: the header gives the offset of each number in a point, all that NumPy needs.

A field of COUNT 0, which some tools write for padding of another length, means that the offsets of the
fields behind it are unknown: files in which one of them is needed are refused. open3d reads .pcd, too, but drops times
of points that are whole numbers, and fields that pad a point (`_`) crash it.
"""

from __future__ import annotations

import io
import re
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError
from bench.lidar.fields import is_time
from bench.lidar.sweep import LARGEST_BYTES, Arrays

TYPES = {
    **{("I", size): np.dtype(f"<i{size}") for size in (1, 2, 4, 8)},
    **{("U", size): np.dtype(f"<u{size}") for size in (1, 2, 4, 8)},
    **{("F", size): np.dtype(f"<f{size}") for size in (4, 8)},
}
PADDING = "_"


class Column(NamedTuple):
    """A field of a point: so many numbers of a type."""

    name: str
    dtype: np.dtype[Any]
    numbers: int

    @property
    def is_read(self) -> bool:
        """It is one number, and no padding."""
        return self.numbers == 1 and self.name != PADDING


def read_pcd(path: Path) -> Arrays:
    """Read points of text or of bytes, and every other field of one number by its name.

    Raises:
        DataError: cut short, empty, compressed, or no .pcd.
    """
    content = path.read_bytes()
    end = re.search(rb"^DATA \w+\r?\n", content, re.MULTILINE)
    if not end:
        got = f"none in {len(content)} bytes"
        raise DataError(path, field="DATA", expected="the line that ends the header of a .pcd file", got=got)
    head = content[: end.end()].decode("ascii", "replace").split("\n")
    lines = {words[0]: words[1:] for words in map(str.split, head) if words and not words[0].startswith("#")}
    try:
        columns, rows = _columns(lines), _rows(lines)
    except (ValueError, IndexError, KeyError) as error:
        got = f"no line {error.args[0]}" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise DataError(path, field="header", expected="the header of a .pcd file", got=got) from None
    if not rows:
        raise DataError(path, field="POINTS", expected="points", got="0, an empty cloud", hint="remove the file")
    counts = [column.numbers for column in columns]
    behind = columns[counts.index(0) :] if 0 in counts else []
    if lost := [column.name for column in behind if column.name in {*"xyz"} or is_time(column.name)]:
        expected = f"a COUNT of 1 or more for each field before {', '.join(lost)}"
        got = "0, so that their offsets are unknown"
        hint = "write the cloud again without padding, or without these fields"
        raise DataError(path, field="COUNT", expected=expected, got=got, hint=hint)
    row_bytes = sum(column.dtype.itemsize * column.numbers for column in columns)
    if not 0 < rows * row_bytes <= LARGEST_BYTES:
        got = f"a header of {rows} points of {row_bytes} bytes"
        raise DataError(path, expected=f"points of at most {LARGEST_BYTES} bytes", got=got)
    kind = lines["DATA"][0]
    if kind not in {"ascii", "binary"}:
        hint = f"pcl_convert_pcd_ascii_binary {path.name} NEW.pcd 1"
        raise DataError(path, field="DATA", expected="ascii or binary", got=kind, hint=hint)
    table = _table(path, content[end.end() :], columns, rows, is_text=kind == "ascii")
    fields = {
        column.name: table[str(i)].astype(column.dtype.newbyteorder("="))
        for i, column in enumerate(columns)
        if column.is_read
    }
    points = np.stack([fields.pop(axis) for axis in "xyz"], axis=-1)
    return {"points_lidar": points if points.dtype.kind == "f" else points.astype(np.float64)} | fields


def _columns(lines: dict[str, list[str]]) -> list[Column]:
    names, kinds, sizes = lines["FIELDS"], lines["TYPE"], list(map(int, lines["SIZE"]))
    counts = list(map(int, lines.get("COUNT", ["1"] * len(names))))
    if len({len(names), len(kinds), len(sizes), len(counts)}) > 1:
        numbers = f"{len(names)} FIELDS, {len(kinds)} TYPE, {len(sizes)} SIZE and {len(counts)} COUNT"
        raise ValueError(f"{numbers}, not one for each field")
    kinds_of_numbers = list(zip(kinds, sizes, strict=True))
    if not set(kinds_of_numbers) <= TYPES.keys() or min(counts) < 0:
        raise ValueError("a TYPE, SIZE or COUNT that no field has")
    types = [TYPES[kind] for kind in kinds_of_numbers]
    columns = [Column(*each) for each in zip(names, types, counts, strict=True)]
    read = [column.name for column in columns if column.is_read]
    if not {"x", "y", "z"} <= set(read) or len(set(read)) < len(read):
        raise ValueError(f"the fields {', '.join(read)}, without x, y and z or with a name twice")
    return columns


def _rows(lines: dict[str, list[str]]) -> int:
    width, height = int(lines["WIDTH"][0]), int(lines.get("HEIGHT", ["1"])[0])
    rows = int(lines.get("POINTS", [str(width * height)])[0])
    if width * height != rows:
        raise ValueError(f"WIDTH {width} and HEIGHT {height} that do not make POINTS {rows}")
    return rows


def _table(path: Path, body: bytes, columns: list[Column], rows: int, *, is_text: bool) -> NDArray[Any]:
    """(rows,) of a structured type, whose fields are called by the numbers of the columns."""
    dtype = np.dtype(
        [
            (str(i), column.dtype, (column.numbers,)) if column.numbers > 1 else (str(i), column.dtype)
            for i, column in enumerate(columns)
            if column.numbers
        ]
    )
    if not is_text:
        if len(body) < rows * dtype.itemsize:
            expected = f"{rows} points of {dtype.itemsize} bytes, {rows * dtype.itemsize} bytes in all"
            raise DataError(path, expected=expected, got=f"{len(body)}; the file is cut short")
        return np.frombuffer(body, dtype=dtype, count=rows)
    try:
        with warnings.catch_warnings(action="ignore"):  # of a file without lines
            table = np.loadtxt(io.BytesIO(body), dtype=dtype, comments=None, max_rows=rows, ndmin=1)
    except (ValueError, OverflowError) as error:
        got = " ".join(str(error).split())[:200]
        raise DataError(path, expected=f"{rows} lines of numbers as the header says", got=got) from None
    if len(table) < rows:
        raise DataError(path, expected=f"{rows} lines of numbers", got=f"{len(table)}; the file is cut short")
    return table
