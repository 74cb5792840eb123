"""Compressed parts of a bag, unpacked up to a limit: a few bytes of a hostile file could fill the memory."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import lz4.frame

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

ZSTD, LZ4 = "zstd", "lz4"


@dataclass(frozen=True, slots=True)
class Unpacked:
    """What came out.

    Attributes:
        data: as far as it could be unpacked.
        fault: what is wrong with the rest; None where there is nothing.
    """

    data: bytes
    fault: str | None = None


def unpack(packed: bytes, compression: str, *, most_bytes: int) -> Unpacked:
    """Unpack data that a file holds.

    Args:
        packed: the compressed bytes.
        compression: "zstd", "lz4" or "" for none.
        most_bytes: more than this is never unpacked.
    """
    if compression == "":
        return Unpacked(packed) if len(packed) <= most_bytes else Unpacked(b"", f"more than {most_bytes} bytes")
    if compression not in (ZSTD, LZ4):
        return Unpacked(b"", f"the unknown compression {compression[:20]!r}")
    decompressor = zstd.ZstdDecompressor() if compression == ZSTD else lz4.frame.LZ4FrameDecompressor()
    try:
        data = decompressor.decompress(packed, max_length=most_bytes + 1)
    except (zstd.ZstdError, RuntimeError, EOFError, ValueError) as error:
        return Unpacked(b"", f"{compression} data that cannot be unpacked ({' '.join(str(error).split())[:80]})")
    if len(data) > most_bytes:
        return Unpacked(b"", f"more than {most_bytes} bytes when unpacked")
    if not decompressor.eof:
        return Unpacked(data, f"{compression} data that is cut short")
    return Unpacked(data)


def unpacked_start(packed: bytes, *, count: int) -> bytes:
    """The first bytes of what zstd packed; fewer where it cannot be unpacked.

    Args:
        packed: the compressed bytes, or enough of their beginning.
        count: how many bytes are wanted.
    """
    try:
        return zstd.ZstdDecompressor().decompress(packed, max_length=count)
    except zstd.ZstdError:
        return b""
