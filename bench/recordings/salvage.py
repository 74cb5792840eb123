"""What can still be used of a recording that does not open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bench.errors import DataError
from bench.recordings.records import Recording

Part = Literal["trajectory", "annotations"]


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
