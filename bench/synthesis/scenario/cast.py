"""Who is on the scene."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from bench.errors import UnknownNameError
from bench.recordings.validation import FileModel
from bench.synthesis.bodies import BODIES
from bench.synthesis.scenario.values import Name, NotNegative, Number, refuse_misfit

Speed = Annotated[float, Field(ge=0, le=150)]


def _known_body(kind: str) -> str:
    if kind not in BODIES:
        raise ValueError(str(UnknownNameError("kind of actor", kind, BODIES)))
    return kind


class ActorSpec(FileModel):
    """A body on the scene.

    Attributes:
        name: the track's id.
        kind: a name of `bench.synthesis.bodies.BODIES`.
        at_s: when it is at its place, after the first image.
        position_m: its middle on the ground, x forward and y left of where the host's origin is at `at_s`.
        heading_deg: direction of travel at `at_s`, to the left of the host's forward direction then.
        times_s: of the profile below, after the first image, increasing.
        speed_mps: along the heading at `times_s`, linear in between, constant beyond; one value for a steady way.
        yaw_rate_degps: positive to the left; as `speed_mps`.
        gear: "reverse" moves against the heading, tail first.
        floor_m: height of the ground below it, for someone on the pavement.
    """

    name: Name
    kind: Annotated[str, AfterValidator(_known_body)]
    at_s: NotNegative = 0.0
    position_m: tuple[Number, Number]
    heading_deg: Number = 0.0
    times_s: tuple[Number, ...] = (0.0,)
    speed_mps: tuple[Speed, ...] | Speed = 0.0
    yaw_rate_degps: tuple[Number, ...] | Number = 0.0
    gear: Literal["forward", "reverse"] = "forward"
    floor_m: float = Field(default=0.0, ge=0, le=0.3)

    @model_validator(mode="after")
    def _profile_fits(self) -> ActorSpec:
        refuse_misfit(self.times_s, speed_mps=self.speed_mps, yaw_rate_degps=self.yaw_rate_degps)
        return self
