"""Reading .las and .laz.

The decompressor allocates what a file states before it checks whether the file holds as much, and where that fails the
process is aborted. So every length in a file is compared with the file first.
"""

from __future__ import annotations

import logging
import struct
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from bench.errors import DataError
from bench.lidar.sweep import LARGEST_BYTES, Arrays

HEADER = struct.Struct("<94xHII")  # bytes of the header, offset of the points, records between them
RECORD_BYTES = 54  # at least, of a record between header and points
CHUNKED, LAYERED = 2, 3  # ways of compression, the first field of the LASzip record
ITEMS_AT, ITEM = 34, struct.Struct("<HHH")  # what a point consists of, in the LASzip record: kind, bytes, version
PLACES = frozenset({"X", "Y", "Z"})
LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}  # of a layered chunk, by kind of item
LAYER_A_BYTE = 14  # the kind of extra bytes


def read_laz(path: Path) -> Arrays:
    """Read points, and the other dimensions that say something, by their names.

    Every point has all dimensions of its format; those in which all are 0 hold nothing.

    Raises:
        DataError: cut short, or not a .las or .laz file.
    """
    points = _points(path)
    with np.errstate(over="ignore", invalid="ignore"):  # scales without end: what comes of them is refused later
        places = np.column_stack([points.x, points.y, points.z]).astype(np.float64, copy=False)
    arrays: Arrays = {"points_lidar": places}
    for dimension in points.point_format.dimensions:
        values = np.asarray(points[dimension.name])
        if dimension.name not in PLACES and values.ndim == 1 and values.any():
            arrays[dimension.name] = values
    return arrays


def _points(path: Path) -> Any:
    """The record of laspy, with all dimensions."""
    import laspy  # 0.15 s, and only these files need it

    logging.getLogger("laspy").setLevel(logging.CRITICAL)  # what it would print is in our errors
    try:
        with path.open("rb") as file:
            _refuse_wrong_header(path, file)
            with laspy.open(file, closefd=False, read_evlrs=False) as opened:
                header = opened.header
                count, point_bytes = header.point_count, header.point_format.size
                if count * point_bytes > LARGEST_BYTES:
                    got = f"a header of {count} points, {count * point_bytes} bytes"
                    expected = f"at most {LARGEST_BYTES} bytes unpacked"
                    raise DataError(path, field="points", expected=expected, got=got)
                if header.are_points_compressed:
                    _refuse_wrong_chunks(path, file, header)
                file.seek(header.offset_to_point_data)
                points = opened.read_points(-1)
    except (DataError, KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # the decompressor raises its own kinds, down to a panic that is no Exception
        got = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise DataError(path, expected=f"a whole {path.suffix} file", got=got) from error
    if count != len(points):
        got = f"{len(points)}; the file may be cut short"
        raise DataError(path, field="points", expected=f"{count} points as its header says", got=got)
    return points


def _refuse_wrong_header(path: Path, file: BinaryIO) -> None:
    head, size = file.read(HEADER.size), file.seek(0, 2)
    file.seek(0)
    if len(head) < HEADER.size:
        raise DataError(path, expected="a whole .laz file", got=f"{len(head)} bytes")
    header_bytes, points_at, records = HEADER.unpack(head)
    if not header_bytes + records * RECORD_BYTES <= points_at <= size:
        got = f"a header of {header_bytes} bytes, {records} records, points at {points_at} of {size} bytes"
        raise DataError(path, field="header", expected="lengths within the file", got=got)


def _refuse_wrong_chunks(path: Path, file: BinaryIO, header: Any) -> None:
    """Compare the chunks that the points are compressed in with the file."""
    import lazrs

    def refuse(field: str, expected: str, got: object) -> None:
        raise DataError(path, field=field, expected=expected, got=f"{got}; the file is damaged or cut short")

    start, point_bytes = header.offset_to_point_data, header.point_format.size
    record = bytes(header.vlrs[header.vlrs.index("LasZipVlr")].record_data)
    laszip = lazrs.LazVlr(record)
    if laszip.item_size() != point_bytes:
        refuse("LASzip record", f"points of {point_bytes} bytes", laszip.item_size())
    if int.from_bytes(record[:2], "little") not in (CHUNKED, LAYERED):
        return  # one stream of points without lengths
    count_in = laszip.chunk_size()
    if not laszip.uses_variable_size_chunks() and not 0 < count_in * point_bytes <= LARGEST_BYTES:
        refuse("LASzip record", f"chunks of at most {LARGEST_BYTES} bytes", f"{count_in} points")
    table, chunks = _chunk_table(file, start)
    most = header.point_count if laszip.uses_variable_size_chunks() else -(-header.point_count // count_in)
    if not 0 <= chunks <= most:
        refuse("chunk table", f"{most} chunks at most", chunks if chunks >= 0 else "none")
    file.seek(start)
    entries = lazrs.read_chunk_table(file, laszip)
    points, packed = sum(entry[0] for entry in entries), sum(entry[1] for entry in entries)
    if points < header.point_count or start + 8 + packed > table:
        got = f"{points} points in {packed}"
        refuse("chunk table", f"chunks of {header.point_count} points in {table - start - 8} bytes", got)
    if int.from_bytes(record[:2], "little") == LAYERED:
        offset, head_bytes = start + 8, point_bytes + 4
        for _, packed in entries:
            file.seek(offset + head_bytes)
            sizes = np.frombuffer(file.read(4 * _layers(record)), dtype="<u4")
            if head_bytes + sizes.nbytes + int(sizes.sum()) > packed:
                refuse("layers of a chunk", f"{packed} bytes", f"{sizes.sum()}")
            offset += packed


def _chunk_table(file: BinaryIO, start: int) -> tuple[int, int]:
    """Offset of the table of chunks and the number that it states; -1 where there is none."""
    size = file.seek(0, 2)
    for offset in (start, size - 8):  # of its address: before the points, or at the end of a file that was streamed
        file.seek(offset)
        table = int.from_bytes(file.read(8), "little", signed=True)
        if start + 8 <= table <= size - 8:
            file.seek(table + 4)
            return table, int.from_bytes(file.read(4), "little")
    return 0, -1


def _layers(record: bytes) -> int:
    items = ITEM.iter_unpack(record[ITEMS_AT : ITEMS_AT + (len(record) - ITEMS_AT) // ITEM.size * ITEM.size])
    return sum(size if kind == LAYER_A_BYTE else LAYERS.get(kind, 0) for kind, size, _ in items)
