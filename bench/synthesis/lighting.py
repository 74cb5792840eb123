"""Where the light of a recording comes from, and how long the cameras expose in it.

Brightness is what the picture shows, 1 is white, after exposure and the camera's tone curve: a day's shadows, a fifth
as bright as the sun in the street, come out half as bright in the picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.scenario import LightSpec


@dataclass(frozen=True, slots=True, kw_only=True)
class _Day:
    """The numbers of a kind of light."""

    elevations_deg: tuple[float, float]
    sun_light: float
    sky_light: float
    horizon: float
    zenith: float
    cloud: float
    sun_glow: float
    shutter_ms: float
    gain: float


# Sun and sky light: an automatic exposure puts a road of albedo 0.3 at about 110 of 255, so that a level
# white sheet by day gets about 1.4. Under low sun the road, lit at a grazing angle, is mostly lit by the sky, and what
# stands upright and faces the sun is bright. Clouds send the same from everywhere.
# Shutter: a car camera of f/2 in 50,000 lux needs 2 ms at its lowest gain, under clouds (10,000 lux) 6 ms; by night it
# exposes for as long as 15 images per second and moving objects allow, and then turns up the gain.
KINDS = {
    "sunny": _Day(
        elevations_deg=(35.0, 65.0), sun_light=0.90, sky_light=0.72, horizon=0.92, zenith=0.62, cloud=0.06,
        sun_glow=0.3, shutter_ms=2.0, gain=1.0,
    ),
    "overcast": _Day(
        elevations_deg=(35.0, 65.0), sun_light=0.0, sky_light=1.25, horizon=0.88, zenith=0.95, cloud=0.035,
        sun_glow=0.0, shutter_ms=6.0, gain=1.0,
    ),
    "low_sun": _Day(
        elevations_deg=(10.0, 22.0), sun_light=1.10, sky_light=0.65, horizon=0.95, zenith=0.48, cloud=0.08,
        sun_glow=0.8, shutter_ms=5.0, gain=1.5,
    ),
    "night": _Day(
        elevations_deg=(35.0, 65.0), sun_light=0.0, sky_light=0.045, horizon=0.07, zenith=0.02, cloud=0.1,
        sun_glow=0.0, shutter_ms=20.0, gain=6.0,
    ),
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lighting:
    """The light of a recording.

    Attributes:
        kind: as in `LightSpec`.
        towards_sun: (3,) float64, unit vector, world.
    """

    kind: str
    towards_sun: NDArray[np.float64]

    @property
    def night(self) -> bool:
        """Whether lamps give the light."""
        return self.kind == "night"

    @property
    def sun_light(self) -> float:
        """Brightness of white paper that faces the sun, by the sun alone."""
        return KINDS[self.kind].sun_light

    @property
    def sky_light(self) -> float:
        """Brightness of white paper that lies on the ground, by the sky alone."""
        return KINDS[self.kind].sky_light

    @property
    def horizon(self) -> float:
        """Brightness of the sky at the horizon."""
        return KINDS[self.kind].horizon

    @property
    def zenith(self) -> float:
        """Brightness of the sky at its top."""
        return KINDS[self.kind].zenith

    @property
    def cloud(self) -> float:
        """Standard deviation of the clouds, relative to the sky."""
        return KINDS[self.kind].cloud

    @property
    def sun_glow(self) -> float:
        """Brightness of the sky around the sun, added."""
        return KINDS[self.kind].sun_glow

    @property
    def shutter_ms(self) -> float:
        """How long cameras expose by themselves."""
        return KINDS[self.kind].shutter_ms

    @property
    def gain(self) -> float:
        """How much cameras amplify by themselves; noise grows with it."""
        return KINDS[self.kind].gain


def lighting(spec: LightSpec, rng: np.random.Generator) -> Lighting:
    """The light that a recording asks for; what it leaves open is drawn."""
    azimuth_deg, elevation_deg = rng.uniform(0, 360), rng.uniform(*KINDS[spec.kind].elevations_deg)
    azimuth = np.radians(azimuth_deg if spec.azimuth_deg is None else spec.azimuth_deg)
    elevation = np.radians(elevation_deg if spec.elevation_deg is None else spec.elevation_deg)
    flat = np.cos(elevation)
    towards_sun = np.array([np.cos(azimuth) * flat, np.sin(azimuth) * flat, np.sin(elevation)])
    return Lighting(kind=spec.kind, towards_sun=towards_sun)
