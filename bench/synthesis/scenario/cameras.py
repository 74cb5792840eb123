"""Cameras on the host."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from bench.cameras import camera_from_parameters
from bench.errors import BenchError
from bench.recordings.validation import FileModel
from bench.synthesis.scenario.values import Name, NotNegative, Number, Place, Positive

Share = Annotated[float, Field(gt=0, le=1)]
Quality = Annotated[int, Field(ge=1, le=100)]


class SensorSpec(FileModel):
    """How a camera errs; the defaults are those of a car's surround-view camera of one megapixel, binned to VGA.

    Attributes:
        edge_light: light at the lens's widest angle against that in the middle; 1 for no vignetting.
        read_noise_grey: standard deviation of the noise in the dark, grey values of 255 at gain 1; 0 for none.
        full_well_electrons: that white stands for at gain 1, which gives the shot noise; null for none.
        exposure_ms: for how long the shutter is open, which blurs what moves; 0 for a still, null for what the
            recording's light asks for: 2 in the sun, 5 in low sun, 6 under clouds, 20 by night.
        gain: that noise grows with; null for what the light asks for: 1 by day, 1.5 in low sun, 6 by night.
        jpeg_quality: of OpenCV's encoder, with images in JPEG; null for PNG, without loss.
    """

    edge_light: Share = 0.6
    read_noise_grey: NotNegative = 1.0
    full_well_electrons: Positive | None = 10_000.0
    exposure_ms: NotNegative | None = Field(default=None, le=60)
    gain: Positive | None = None
    jpeg_quality: Quality | None = None


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
        sensor: how it errs.
    """

    name: Name
    model: str
    width: int = Field(gt=0, le=8192)
    height: int = Field(gt=0, le=8192)
    parameters: dict[str, Any]
    position_m: Place
    yaw_deg: Number = 0.0
    pitch_down_deg: Number = 0.0
    roll_deg: Number = 0.0
    sensor: SensorSpec = SensorSpec()

    @model_validator(mode="after")
    def _lens_exists(self) -> CameraSpec:
        try:
            camera_from_parameters(self.model, width=self.width, height=self.height, **self.parameters)
        except (BenchError, TypeError) as error:
            raise ValueError(str(error)) from error
        return self
