"""A recording, and the scenario that it stands in."""

from __future__ import annotations

from pydantic import Field, model_validator

from bench.recordings.validation import FileModel
from bench.synthesis.scenario.cameras import CameraSpec
from bench.synthesis.scenario.cast import ActorSpec
from bench.synthesis.scenario.drive import HostSpec
from bench.synthesis.scenario.lidar import LidarSpec
from bench.synthesis.scenario.light import LightSpec
from bench.synthesis.scenario.series import SeriesSpec
from bench.synthesis.scenario.street import StreetSpec
from bench.synthesis.scenario.values import Name, refuse_twice
from bench.synthesis.scenario.vehicle import VehicleSpec


class RecordingSpec(FileModel):
    """One recording.

    Attributes:
        name: of its folder.
        about: one line for the reader of the file.
        frames: images of each camera.
        host: how the host drives.
        street: the static world.
        light: sun, clouds or night.
        actors: everything that is annotated.
    """

    name: Name
    about: str = ""
    frames: int = Field(default=30, ge=1)
    host: HostSpec
    street: StreetSpec = StreetSpec()
    light: LightSpec = LightSpec()
    actors: tuple[ActorSpec, ...] = ()

    @model_validator(mode="after")
    def _names_once(self) -> RecordingSpec:
        refuse_twice([actor.name for actor in self.actors], "actors")
        return self


class ScenarioHead(FileModel):
    """What all recordings of a scenario share.

    Attributes:
        name: of the data set.
        licence: of what is rendered.
        seed: of everything that is random; a recording's random numbers follow from it and its name alone.
        frame_rate_hz: of every camera.
        cameras: on the host.
        lidar: on the host.
        vehicle: how the host sways, what its bus reports, how well it is calibrated; ideal where nothing is said.
    """

    name: Name
    licence: str
    seed: int = Field(ge=0)
    frame_rate_hz: float = Field(default=15.0, ge=0.1, le=1000)
    cameras: tuple[CameraSpec, ...] = Field(min_length=1)
    lidar: LidarSpec
    vehicle: VehicleSpec = VehicleSpec()

    @model_validator(mode="after")
    def _cameras_once(self) -> ScenarioHead:
        refuse_twice([camera.name for camera in self.cameras], "cameras")
        return self


class Scenario(ScenarioHead):
    """A scenario whose recordings are all spelled out.

    Attributes:
        recordings: in any order.
    """

    recordings: tuple[RecordingSpec, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _recordings_once(self) -> Scenario:
        refuse_twice([recording.name for recording in self.recordings], "recordings")
        return self


class ScenarioFile(ScenarioHead):
    """A scenario as its file has it.

    Attributes:
        recordings: spelled out one by one.
        series: each stands for many recordings.
    """

    recordings: tuple[RecordingSpec, ...] = ()
    series: tuple[SeriesSpec, ...] = ()

    @model_validator(mode="after")
    def _something_once(self) -> ScenarioFile:
        if not self.recordings and not self.series:
            raise ValueError("at least one recording, under recordings or series")
        refuse_twice([recording.name for recording in self.recordings], "recordings")
        refuse_twice([series.name for series in self.series], "series")
        return self
