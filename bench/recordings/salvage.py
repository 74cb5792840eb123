"""What can still be used of a recording that does not open."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from bench.egomotion import Trajectory
from bench.errors import DataError
from bench.recordings.records import Recording

Part = Literal["trajectory", "annotations"]
Complaint = Callable[[DataError], None]

ALWAYS_NS = 2**61  # the stand-in for a lost trajectory reaches this far to both sides of 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Salvaged:
    """Every fault of the files that opening reads, and the rest of the recording.

    Attributes:
        faults: one error per fault.
        recording: what is left; cameras, images, sweeps and objects that cannot be used are not in it. None where not
            even the calibration can be used.
        lost: parts of `recording` that only fill the place: a trajectory that stands still, no tracks.
    """

    faults: tuple[DataError, ...]
    recording: Recording | None
    lost: frozenset[Part] = frozenset()


def refuse(error: DataError) -> None:
    """The complaint of whoever opens: the first fault ends it."""
    raise error


@contextmanager
def collected(faults: list[DataError]) -> Iterator[list[bool]]:
    """Catch a fault; what is yielded is empty once the block did not end well."""
    well = [True]
    try:
        yield well
    except DataError as error:
        faults.append(error)
        well.clear()


def standing_still(source: Path) -> Trajectory:
    """Fills the place of a lost trajectory, at all times."""
    return Trajectory(
        source=str(source),
        timestamps_ns=np.array([-ALWAYS_NS, ALWAYS_NS], dtype=np.int64),
        rotations=Rotation.identity(2),
        positions_m=np.zeros((2, 3)),
        max_gap_ns=2 * ALWAYS_NS,
    )
