"""Files that were made to break a reader, small on disk."""

import io
import os
import struct
import zipfile
import zlib
from functools import partial

import cv2
import numpy as np

from tests.support.clouds import laz, pcd


def png_chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def png(width: int, height: int, *, bits: int = 8, colour: int = 0, rows: bytes = b"") -> bytes:
    """A PNG whose chunks are whole, whatever its header says of the pixels."""
    header = png_chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0))
    palette = png_chunk(b"PLTE", bytes(768)) if colour == 3 else b""
    pixels = png_chunk(b"IDAT", zlib.compress(rows, 9))
    return b"\x89PNG\r\n\x1a\n" + header + palette + pixels + png_chunk(b"IEND", b"")


def jpeg(width: int, height: int) -> bytes:
    _, encoded = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (height, width), dtype=np.uint8))
    return encoded.tobytes()


def jpeg_of_another_size(content: bytes, width: int, height: int) -> bytes:
    place = content.index(b"\xff\xc0")
    return content[: place + 5] + struct.pack(">HH", height, width) + content[place + 9 :]


NO_FILES = {  # what may stand in the place of a file
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "folder": lambda path: path.mkdir(),
}
WHOLE = "expected a whole PNG or JPEG file, got "
BLACK = png(64, 48, rows=bytes(65 * 48))
IMAGES = {  # content and what is told
    "missing": (None, "expected an image file"),
    "empty": (b"", f"{WHOLE}an empty file"),
    "text": (b"not an image", f"{WHOLE}12 bytes that begin with 6e 6f 74"),
    "nothing but the signature": (b"\x89PNG\r\n\x1a\n", "a PNG cut short at 8 bytes"),
    "30000 x 30000 px": (png(30_000, 30_000, rows=bytes(30_001 * 8)), "at most 67108864 px, got 30000 x 30000"),
    "the largest header": (png(2**31 - 1, 2**31 - 1), "at most 67108864 px"),
    "no pixels": (png(0, 0), "expected"),
    "a broken stream in whole chunks": (png(64, 48, rows=bytes(99)), "expected an image that can be decoded"),
    "cut short": (BLACK[:-20], "a PNG cut short"),
    "a byte less": (BLACK[:-1], "a PNG cut short"),
    "one byte turned": (bytes(b ^ (i == 45) for i, b in enumerate(BLACK)), "a damaged PNG"),
    "another size": (png(640, 480, rows=bytes(641 * 480)), "image size: expected 64 x 48 px"),
    "JPEG cut short": (jpeg(64, 48)[:-30], "a JPEG cut short"),
    "JPEG of 65000 x 65000 px": (jpeg_of_another_size(jpeg(64, 48), 65_000, 65_000), "at most 67108864 px"),
    "JPEG of nothing but its ends": (b"\xff\xd8\xff\xd9", "a damaged JPEG"),
}


def npz(**arrays: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def zipped(packing: int = zipfile.ZIP_DEFLATED, **members: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", packing, compresslevel=1) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return file.getvalue()


def npy_header(shape: tuple[int, ...], kind: str = "<f4") -> bytes:
    text = repr({"descr": kind, "fortran_order": False, "shape": shape}).encode()
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


POINTS = np.random.default_rng(3).uniform(-20, 20, (500, 3)).astype(np.float32)
NPZ = npz(points_lidar=POINTS)


def spoiled(content: bytes, place: int, count: int = 12) -> bytes:
    return content[:place] + bytes(byte ^ 0x5A for byte in content[place : place + count]) + content[place + count :]


NPZ_FILES = {
    "no zip": b"PK\x03\x04 and nothing",
    # It takes seconds, which are not spent on importing this.
    "zip of zeros": partial(npz, points_lidar=np.broadcast_to(np.float32(0), (24_000_000, 3))),
    "header of a trillion points": zipped(points_lidar=npy_header((10**12, 3))),
    "damaged stream": spoiled(NPZ, 200),
    "packed by bzip2": zipped(zipfile.ZIP_BZIP2, points_lidar=npy_header((1, 3)) + bytes(12)),
    "point times without end": npz(points_lidar=POINTS, time_offset_ns=np.full(500, -(2**63), dtype=np.int64)),
}


LAZ = laz(POINTS.astype(np.float64))
LAYERED_LAZ = laz(POINTS.astype(np.float64), point_format=6)
POINTS_AT = struct.Struct("<96xI")  # in the header of a .laz file


def put(content: bytes, place: int, kind: str, number: float) -> bytes:
    return content[:place] + struct.pack(kind, number) + content[place + struct.calcsize(kind) :]


def chunk_table_at(content: bytes) -> int:
    return struct.unpack_from("<q", content, POINTS_AT.unpack_from(content)[0])[0]


def laszip_record_at(content: bytes) -> int:
    return content.index(b"laszip encoded") + 52


LAZ_FILES = {
    "text": b"not points" * 40,
    "nothing but a header": LAZ[:227],
    "four billion points": put(LAZ, 107, "<I", 2**32 - 1),  # at its place in LAS 1.2
    "damaged stream": spoiled(LAZ, len(LAZ) // 2, 40),
    "scales of NaN": put(LAZ, 131, "<d", np.nan),
    "scales without end": put(LAZ, 131, "<d", 1e308),
    "points at an offset beyond the file": put(LAZ, 96, "<I", 2**31),
    "four billion chunks": put(LAZ, chunk_table_at(LAZ) + 4, "<I", 2**32 - 1),
    "chunks of four billion points": put(LAZ, laszip_record_at(LAZ) + 12, "<I", 2**32 - 2),
    "chunks of four billion bytes": spoiled(LAZ, chunk_table_at(LAZ) + 8, 4),
    "chunk table beyond the end": put(LAZ, POINTS_AT.unpack_from(LAZ)[0], "<q", 2**40),
    "layers of four billion bytes": put(LAYERED_LAZ, POINTS_AT.unpack_from(LAYERED_LAZ)[0] + 42, "<I", 2**32 - 1),
    "times that are no number": laz(POINTS.astype(np.float64), gps_time=np.full(500, np.nan)),
}

ROWS = np.column_stack([POINTS, np.ones(500, np.float32)]).astype("<f4")
PCD_FILES = {
    "a trillion points": pcd(10**12, body=bytes(120)),
    "a negative number of points": pcd(-5, body=bytes(120)),
    "no number of points": pcd(10, POINTS="many", body=bytes(120)),
    "columns without end": pcd(10, COUNT="999999999 1 1", body=bytes(160)),
    "text of words": pcd(2, data="ascii", body=b"1 2 3\n4 five 6\n"),
    "text of too few numbers": pcd(2, data="ascii", body=b"1 2 3\n4 5\n"),
    "text of numbers beyond their type": pcd(1, data="ascii", body=b"1 2 1e300\n"),
    "beyond any map": pcd(500, body=np.where(np.arange(1500) == 22, np.float32(1e30), POINTS.ravel()).tobytes()),
}

CLOUDS = {".npz": NPZ_FILES, ".laz": LAZ_FILES, ".pcd": PCD_FILES}


LAUGHS = "a0: &a0 [ha, ha, ha, ha, ha, ha, ha, ha, ha]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 12)
)
YAML_FILES = {
    "a tag that imports": "name: !!python/name:os.system\n",
    "a billion laughs": LAUGHS + "name: *a11\n",
    "a billion merges": "".join(
        f"m{n}: &m{n} {{{'<<: [' + ', '.join([f'*m{n - 1}'] * 9) + '], ' if n else ''}k{n}: 1}}\n" for n in range(12)
    ),
    "itself": "name: &me [*me]\n",
    "nested deeply": "name: " + "[" * 5000 + "]" * 5000,
    "a number of 5000 digits": "name: " + "9" * 5000,
    "a day that is none": "name: 2001-13-45\n",
    "control characters": "name: \x07\x1b[2J\n",
    "no UTF-8": b"name: \xff\xfe",
}
