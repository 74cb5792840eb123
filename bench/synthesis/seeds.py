"""Random numbers that depend on names, never on order."""

from __future__ import annotations

import hashlib

import numpy as np


def named_rng(seed: int, *names: str | int) -> np.random.Generator:
    """A generator of its own for each purpose, the same on every run and in every process.

    Args:
        seed: of the scenario.
        names: what the numbers are for: recording, sensor, frame.
    """
    text = "/".join([str(seed), *map(str, names)])
    return np.random.default_rng(int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "little"))
