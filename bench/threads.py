"""One process, one thread per library, memory that stays: or processes fight for cores and timings mean nothing.

The libraries are imported on use, since other processes start before this one loads them.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # of glibc's malloc.h
KEPT_BYTES = 1 << 29
LARGEST_MAPPED_BYTES = 1 << 25  # glibc takes no more


def reuse_freed_memory() -> None:
    """Have the C library keep what is freed for the rest of this process, instead of giving it back to the system.

    Flow, counts and rendering take and free the same tens of megabytes for every image. Taken from the system anew,
    page by page, they cost Farnebäck's flow a seventh of its time. The peak stays what it was. Only glibc is told;
    other libraries are left as they are.
    """
    tell = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if tell is not None:
        tell(M_MMAP_THRESHOLD, LARGEST_MAPPED_BYTES)
        tell(M_TRIM_THRESHOLD, KEPT_BYTES)


THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def use_one_thread() -> None:
    """Keep libraries to one thread for the rest of this process, those too that are loaded later: a worker's start."""
    import cv2
    from threadpoolctl import threadpool_limits

    reuse_freed_memory()
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    cv2.setNumThreads(1)
    threadpool_limits(1)


@contextmanager
def single_threaded() -> Iterator[None]:
    """Keep OpenCV and BLAS to one thread inside the block; freed memory is reused from here on."""
    import cv2
    from threadpoolctl import threadpool_limits

    reuse_freed_memory()
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with threadpool_limits(limits=1):
            yield
    finally:
        cv2.setNumThreads(threads)
