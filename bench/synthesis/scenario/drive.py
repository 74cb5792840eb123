"""How the host drives."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from bench.recordings.validation import FileModel
from bench.synthesis.scenario.values import Number, refuse_misfit


class BumpSpec(FileModel):
    """A bump across the road that the suspension feels: a patch's edge, a sunken manhole, a low speed bump.

    It is too low to be part of the rendered street.

    Attributes:
        at_m: its middle, way ahead of the rear axle at the first image.
        height_m: negative for a dip.
        length_m: along the way; the profile is a raised cosine.
    """

    at_m: Number
    height_m: float = Field(ge=-0.1, le=0.1)
    length_m: float = Field(default=0.6, gt=0.1, le=10)


class HostSpec(FileModel):
    """How the host drives: values at `times_s`, linear in between, constant beyond; one value for a steady drive.

    Attributes:
        times_s: after the first image, increasing.
        speed_kmh: over the ground, never negative.
        yaw_rate_degps: positive to the left.
        gear: "reverse" drives backwards.
        ramp_s: time over which changes of acceleration and steering are spread, half of it before and half after; a
            driver's foot takes about 0.3 s.
        bumps: felt by a host with a suspension.
    """

    times_s: tuple[Number, ...] = (0.0,)
    speed_kmh: tuple[Annotated[float, Field(ge=0, le=500)], ...]
    yaw_rate_degps: tuple[Number, ...] = (0.0,)
    gear: Literal["forward", "reverse"] = "forward"
    ramp_s: float = Field(default=0.0, ge=0, le=2)
    bumps: tuple[BumpSpec, ...] = ()

    @model_validator(mode="after")
    def _profile_fits(self) -> HostSpec:
        refuse_misfit(self.times_s, speed_kmh=self.speed_kmh, yaw_rate_degps=self.yaw_rate_degps)
        return self
