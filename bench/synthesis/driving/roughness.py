"""The unevenness of a road, as far as wheels feel it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.scenario import BumpSpec

# ISO 8608: displacement spectra at 0.1 cycles/m, geometric means of the classes, m^3; they fall with n^-2.
SPECTRUM_M3 = {"A": 16e-6, "B": 64e-6, "C": 256e-6}
AT_CYCLES_PER_M = 0.1
# Waves longer than 20 m lift car and street alike, and the rendered street is flat. ISO 8608 ends at 2.83 cycles/m.
CYCLES_PER_M = (0.05, 2.83)
WAVES = 96
TRACK_M = 1.55  # between left and right wheels, for how far they feel the same


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RoadProfile:
    """Heights below the wheels, over the way along the road.

    Attributes:
        waves_per_m: (W,) float64, cycles per metre.
        amplitudes_m: (2, W) float64: of the mean of both wheel tracks, and of half their difference.
        phases_rad: (2, W) float64.
        bumps: across both tracks.
    """

    waves_per_m: NDArray[np.float64]
    amplitudes_m: NDArray[np.float64]
    phases_rad: NDArray[np.float64]
    bumps: tuple[BumpSpec, ...] = ()

    def heights_m(self, ways_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Heights below the left and the right wheel at (N,) ways."""
        turns = 2 * np.pi * np.outer(ways_m, self.waves_per_m)
        mean, half = (np.cos(turns + p) @ a for a, p in zip(self.amplitudes_m, self.phases_rad, strict=True))
        for bump in self.bumps:
            part = np.clip((ways_m - bump.at_m) / bump.length_m, -0.5, 0.5)
            mean = mean + bump.height_m * (0.5 + 0.5 * np.cos(2 * np.pi * part))
        return mean + half, mean - half


def road_profile(road_class: str | None, bumps: Sequence[BumpSpec], rng: np.random.Generator) -> RoadProfile:
    """Draw a road of a class.

    Each wave has the power that its class gives it. Left and right tracks of an isotropic road agree for waves that are
    long against their distance and go their own ways for short ones; the share in between is simplified to
    1 / (1 + (2 pi n track)^2).

    Source:
        ISO 8608:2016, road surface profiles.
    """
    edges = np.geomspace(*CYCLES_PER_M, WAVES + 1)
    waves = rng.uniform(edges[:-1], edges[1:])
    level = 0.0 if road_class is None else SPECTRUM_M3[road_class]
    powers = level * (waves / AT_CYCLES_PER_M) ** -2 * np.diff(edges)
    agreeing = 1.0 / (1.0 + (2 * np.pi * waves * TRACK_M) ** 2)
    shares = np.stack([(1 + agreeing) / 2, (1 - agreeing) / 2])
    return RoadProfile(
        waves_per_m=waves,
        amplitudes_m=np.sqrt(2 * powers * shares),
        phases_rad=rng.uniform(0, 2 * np.pi, (2, WAVES)),
        bumps=tuple(bumps),
    )
