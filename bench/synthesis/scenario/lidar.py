"""The lidar on the host."""

from __future__ import annotations

from pydantic import Field

from bench.recordings.validation import FileModel
from bench.synthesis.scenario.values import NotNegative, Place


class LidarSpec(FileModel):
    """A 64-beam lidar that turns clockwise, as Velodyne's HDL-64E.

    The weakest return by default lets a 10 % target out to about 140 m when it is hit squarely, and asphalt below a
    lidar on the roof out to about 35 m, where it is hit at 3 degrees; beyond, more and more pulses are lost.

    Attributes:
        position_m: in the vehicle frame, axes along the vehicle's.
        rotation_hz: revolutions per second.
        max_range_m: returns from further away are not stored.
        range_noise_m: standard deviation.
        weakest_return_per_m2: reflectance times the cosine of incidence over the square of the range at which half of
            the pulses come back; 0 for all.
        pane_returns: share of pulses on panes of glass that come back, from dust, when they hit squarely; the others
            pass or are mirrored away.
        sector_deg: points are stored in this sector about straight ahead.
    """

    position_m: Place
    rotation_hz: float = Field(default=10.0, ge=1, le=100)
    max_range_m: float = Field(default=60.0, ge=1, le=1000)
    range_noise_m: NotNegative = 0.02
    weakest_return_per_m2: NotNegative = 5e-6
    pane_returns: float = Field(default=0.2, ge=0, le=1)
    sector_deg: float = Field(default=360.0, gt=0, le=360)
