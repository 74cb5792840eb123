"""The way to a Dask scheduler."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from bench.errors import DataError, UsageError

if TYPE_CHECKING:
    from distributed import Client

CONNECTION_S = 10.0  # until a scheduler that does not answer is not there
CLOSING_S = 1.0


def scheduler_address(text: str) -> str:
    """The address of a scheduler.

    Args:
        text: the address itself, with its protocol, or the file that `dask scheduler --scheduler-file` writes.

    Raises:
        DataError: neither.
    """
    if "://" in text:
        return text
    expected, hint = "an address, or the file of a Dask scheduler", "for example tcp://localhost:8786"
    try:
        content = json.loads(Path(text).read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(text, expected=expected, got=error.strerror or str(error), hint=hint) from error
    except (ValueError, RecursionError) as error:
        raise DataError(text, expected=expected, got=f"no JSON ({error})", hint=hint) from error
    address = content.get("address") if isinstance(content, dict) else None
    if not isinstance(address, str):
        raise DataError(text, field="address", expected="text", got=repr(address), hint=hint)
    return address


@contextmanager
def connected(scheduler: str) -> Iterator[Client]:
    """A client, whose own messages are kept back: what matters of them is raised."""
    try:
        import dask
        from distributed import Client
    except ImportError as error:
        hint = "install it: pip install 'fisheye-bench[cluster]'"
        raise UsageError(f"--scheduler: expected Dask, which is optional, got none ({error}); {hint}") from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL + 1)  # for good: its threads outlive the client
    with dask.config.set({"distributed.comm.timeouts.connect": f"{CONNECTION_S:g}s"}):
        try:
            client = Client(scheduler, timeout=CONNECTION_S, set_as_default=False, name="fisheye-bench")
        except (OSError, ValueError, TimeoutError) as error:
            got = f"none within {CONNECTION_S:g} s ({' '.join(str(error).split())})"
            hint = "start one with `dask scheduler`, and workers with `dask worker`; or compute here, with --workers"
            raise DataError(scheduler, expected="a Dask scheduler", got=got, hint=hint) from error
        try:
            yield client
        finally:
            with suppress(OSError, TimeoutError):
                client.close(timeout=CLOSING_S)
