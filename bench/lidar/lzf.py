"""Unpacking of LZF, in which .pcd files are compressed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.machine_code import compiled


@compiled
def unpack_lzf(packed: NDArray[np.uint8], unpacked: NDArray[np.uint8]) -> int:
    """Unpack data of LZF, as the library of that name does; the number of bytes written, or -1 for damaged data.

    Args:
        packed: (P,) uint8.
        unpacked: (U,) uint8, to be filled.
    """
    read = write = 0
    while read < len(packed):
        control = int(packed[read])
        read += 1
        if control < 32:  # as they are, one byte more than it says
            if read + control + 1 > len(packed) or write + control + 1 > len(unpacked):
                return -1
            for _ in range(control + 1):
                unpacked[write] = packed[read]
                read += 1
                write += 1
            continue
        length = control >> 5
        if read + (length == 7) >= len(packed):
            return -1
        if length == 7:
            length += int(packed[read])
            read += 1
        source = write - ((control & 31) << 8) - int(packed[read]) - 1
        read += 1
        if source < 0 or write + length + 2 > len(unpacked):
            return -1
        for _ in range(length + 2):  # byte by byte: the two may overlap
            unpacked[write] = unpacked[source]
            source += 1
            write += 1
    return write
