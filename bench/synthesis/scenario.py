"""What a scenario file says."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from bench.cameras import camera_from_parameters
from bench.errors import BenchError, UnknownNameError
from bench.recordings.validation import FileModel
from bench.synthesis.actors import BODIES

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")]
NotNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Place = tuple[float, float, float]


def _known_body(kind: str) -> str:
    if kind not in BODIES:
        raise ValueError(str(UnknownNameError("kind of actor", kind, BODIES)))
    return kind


class CameraSpec(FileModel):
    """A camera on the host.

    Attributes:
        name: as the recording calls it.
        model: a name of `bench.cameras.CAMERA_MODELS`.
        width: image width, px.
        height: image height, px.
        parameters: the model's own.
        position_m: in the vehicle frame.
        yaw_deg: of the optical axis, to the left of forward.
        pitch_down_deg: of the optical axis, below the horizon.
        roll_deg: about the optical axis, clockwise as the camera sees itself turn.
        noise_grey: standard deviation of the sensor noise, grey values of 255.
    """

    name: Name
    model: str
    width: int = Field(gt=0, le=8192)
    height: int = Field(gt=0, le=8192)
    parameters: dict[str, Any]
    position_m: Place
    yaw_deg: float = 0.0
    pitch_down_deg: float = 0.0
    roll_deg: float = 0.0
    noise_grey: NotNegative = 1.2

    @model_validator(mode="after")
    def _lens_exists(self) -> CameraSpec:
        try:
            camera_from_parameters(self.model, width=self.width, height=self.height, **self.parameters)
        except (BenchError, TypeError) as error:
            raise ValueError(str(error)) from error
        return self


class LidarSpec(FileModel):
    """A 64-beam lidar that turns clockwise.

    Attributes:
        position_m: in the vehicle frame, axes along the vehicle's.
        rotation_hz: revolutions per second.
        max_range_m: returns from further away are not stored.
        range_noise_m: standard deviation.
        sector_deg: points are stored in this sector about straight ahead.
    """

    position_m: Place
    rotation_hz: Positive = 10.0
    max_range_m: Positive = 60.0
    range_noise_m: NotNegative = 0.02
    sector_deg: float = Field(default=360.0, gt=0, le=360)


class HostSpec(FileModel):
    """How the host drives: values at `times_s`, linear in between, constant beyond; one value for a steady drive.

    Attributes:
        times_s: after the first image, increasing.
        speed_kmh: over the ground, never negative.
        yaw_rate_degps: positive to the left.
        gear: "reverse" drives backwards.
    """

    times_s: tuple[float, ...] = (0.0,)
    speed_kmh: tuple[NotNegative, ...]
    yaw_rate_degps: tuple[float, ...] = (0.0,)
    gear: Literal["forward", "reverse"] = "forward"

    @model_validator(mode="after")
    def _profile_fits(self) -> HostSpec:
        count = len(self.times_s)
        if any(b <= a for a, b in zip(self.times_s[:-1], self.times_s[1:], strict=True)):
            raise ValueError("times_s that increase")
        for name in ("speed_kmh", "yaw_rate_degps"):
            if len(getattr(self, name)) not in {1, count} or not count:
                raise ValueError(f"{name}: one value, or one for each of the {count} times")
        return self


class StreetSpec(FileModel):
    """The street: straight up to the host's first place, then a bend of at most 90 degrees, then straight again.

    Attributes:
        lanes_left: lanes to the left of the host's own.
        lanes_right: lanes to the right of it.
        lane_width_m: of every lane.
        kerb_m: height of the pavement above the road; 0 for a car park.
        pavement_m: width of the pavement before the buildings.
        curvature_per_m: 1 / radius of the bend, positive to the left; 0 for a straight street.
        buildings: whether there are any.
    """

    lanes_left: int = Field(default=1, ge=0, le=6)
    lanes_right: int = Field(default=0, ge=0, le=6)
    lane_width_m: float = Field(default=3.25, ge=2, le=6)
    kerb_m: float = Field(default=0.12, ge=0, le=0.3)
    pavement_m: float = Field(default=2.5, ge=0.5, le=30)
    curvature_per_m: float = Field(default=0.0, ge=-0.1, le=0.1)
    buildings: bool = True


class ActorSpec(FileModel):
    """A body on the scene; its place is that of its middle on the ground, in the vehicle frame at the first image.

    Attributes:
        name: the track's id.
        kind: a name of `bench.synthesis.actors.BODIES`.
        position_m: x forward and y left of the host's origin.
        heading_deg: direction of travel, to the left of the host's forward direction.
        speed_mps: along the heading; 0 stands.
        yaw_rate_degps: positive to the left.
        floor_m: height of the ground below it, for someone on the pavement.
    """

    name: Name
    kind: Annotated[str, AfterValidator(_known_body)]
    position_m: tuple[float, float]
    heading_deg: float = 0.0
    speed_mps: NotNegative = 0.0
    yaw_rate_degps: float = 0.0
    floor_m: float = Field(default=0.0, ge=0, le=0.3)


class RecordingSpec(FileModel):
    """One recording.

    Attributes:
        name: of its folder.
        about: one line for the reader of the file.
        frames: images of each camera.
        host: how the host drives.
        street: the static world.
        actors: everything that is annotated.
    """

    name: Name
    about: str = ""
    frames: int = Field(default=30, ge=1)
    host: HostSpec
    street: StreetSpec = StreetSpec()
    actors: tuple[ActorSpec, ...] = ()

    @model_validator(mode="after")
    def _names_once(self) -> RecordingSpec:
        _refuse_twice([actor.name for actor in self.actors], "actors")
        return self


class Scenario(FileModel):
    """A whole scenario file.

    Attributes:
        name: of the data set.
        licence: of what is rendered.
        seed: of everything that is random; a recording's random numbers follow from it and its name alone.
        frame_rate_hz: of every camera.
        cameras: on the host.
        lidar: on the host.
        recordings: in any order.
    """

    name: Name
    licence: str
    seed: int = Field(ge=0)
    frame_rate_hz: Positive = 15.0
    cameras: tuple[CameraSpec, ...] = Field(min_length=1)
    lidar: LidarSpec
    recordings: tuple[RecordingSpec, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _names_once(self) -> Scenario:
        _refuse_twice([camera.name for camera in self.cameras], "cameras")
        _refuse_twice([recording.name for recording in self.recordings], "recordings")
        return self


def _refuse_twice(names: list[str], field: str) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{field}: names that occur once; {', '.join(twice)} does not")


def interval_ns(rate_hz: float) -> int:
    """Time between two images or revolutions."""
    return math.floor(1e9 / rate_hz + 0.5)
