"""The directions and times of a revolution's beams."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.scenario import LidarSpec

SECOND_NS = 1_000_000_000
FIRINGS_PER_S = 20_833  # of all 64 lasers: 2083 columns, 0.1728 degrees apart, at 10 Hz
# HDL-64E S2, user's manual: an upper block from 2 to -8.33 degrees, a third of a degree apart, and a lower block from
# -8.83 to -24.33 degrees, half a degree apart.
BEAMS_DEG = np.concatenate([2.0 - np.arange(32) / 3, -8.83 - np.arange(32) / 2])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beams:
    """One revolution: C columns of 64 beams.

    Attributes:
        offsets_ns: (C,) int64, time of each column after the middle of the revolution.
        rays_lidar: (C, 64, 3) float32, unit length, lidar frame.
    """

    offsets_ns: NDArray[np.int64]
    rays_lidar: NDArray[np.float32]


def revolution(spec: LidarSpec) -> Beams:
    """The beams of a revolution that starts and ends straight behind, turns clockwise and looks ahead in its middle.

    Columns outside of the stored sector are left out.
    """
    columns = max(1, round(FIRINGS_PER_S / spec.rotation_hz))
    fractions = (np.arange(columns) + 0.5) / columns - 0.5
    fractions = fractions[np.abs(fractions) * 360.0 <= spec.sector_deg / 2]
    azimuths, elevations = -2 * np.pi * fractions[:, None], np.radians(BEAMS_DEG)[None, :]
    flat = np.cos(elevations)
    lifts = np.broadcast_to(np.sin(elevations), (len(fractions), len(BEAMS_DEG)))
    return Beams(
        offsets_ns=np.rint(fractions * SECOND_NS / spec.rotation_hz).astype(np.int64),
        rays_lidar=np.stack([flat * np.cos(azimuths), flat * np.sin(azimuths), lifts], axis=-1).astype(np.float32),
    )
