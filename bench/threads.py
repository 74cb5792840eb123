"""One process, one thread per library, memory that stays: or processes fight for cores and timings mean nothing.

The libraries are imported on use, since other processes start before this one loads them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from bench.memory import reuse_freed_memory

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
