"""How the host's body sways, what its bus reports, and how well its sensors are calibrated."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from bench.recordings.validation import FileModel
from bench.synthesis.scenario.values import NotNegative, Place, Positive


class SuspensionSpec(FileModel):
    """The body on its springs. Pitch, roll and heave each answer as a mass on a spring with a damper.

    The defaults are those of an everyday family car: Gillespie, Fundamentals of Vehicle Dynamics, gives ride
    frequencies of 1 to 1.5 Hz, damping ratios of 0.2 to 0.4 and roll gradients of 3 to 7 degrees per g; braking at
    3 m/s^2 lets a car's nose dive by nearly a degree. Road classes are those of ISO 8608; town streets are A or B.

    Attributes:
        natural_hz: undamped natural frequency.
        damping_ratio: of critical damping.
        pitch_deg_per_mps2: nose down for each m/s^2 of braking, up for accelerating.
        roll_deg_per_mps2: to the outside of the bend for each m/s^2 of lateral acceleration.
        centre_m: what pitch and roll turn about, in the level vehicle frame.
        wheelbase_m: between the axles, whose bumps come one after the other.
        track_m: between left and right wheels.
        road_class: roughness of the road; null for a smooth one.
    """

    natural_hz: float = Field(default=1.3, gt=0, le=20)
    damping_ratio: float = Field(default=0.35, gt=0, le=2)
    pitch_deg_per_mps2: float = Field(default=0.3, ge=0, le=2)
    roll_deg_per_mps2: float = Field(default=0.45, ge=0, le=2)
    centre_m: Place = (1.35, 0.0, 0.4)
    wheelbase_m: Positive = 2.7
    track_m: Positive = 1.55
    road_class: Literal["A", "B", "C"] | None = "A"


class BusSpec(FileModel):
    """Wheel ticks and a yaw-rate sensor, as the bus of a series car reports them.

    The defaults: an ABS wheel sensor counts 96 edges of 48 teeth; tyre wear and pressure change its radius by up to one
    per cent; an automotive yaw-rate sensor has noise of 0.1 deg/s, a rest of bias of 0.1 deg/s after the zero point
    was taken at standstill, and steps of 0.02 deg/s.

    Attributes:
        rate_hz: messages per second.
        ticks_per_turn: edges of one turn of a wheel; 0 for a speed without ticks.
        tyre_radius_m: that the control unit reckons with.
        standstill_after_s: without a tick for so long, the reported speed is 0. One tick in that time, 0.1 m/s by the
            defaults, is the slowest motion that the bus registers.
        speed_step_kmh: resolution of the reported speed; 0 for none.
        speed_scale_sigma: standard deviation of the factor between reported and true speed, drawn per recording.
        yaw_rate_noise_degps: standard deviation, drawn per message.
        yaw_rate_bias_degps: standard deviation of the bias, drawn per recording.
        yaw_rate_step_degps: resolution of the reported yaw rate; 0 for none.
    """

    rate_hz: float = Field(default=50.0, ge=5, le=1000)
    ticks_per_turn: int = Field(default=96, ge=0, le=10_000)
    tyre_radius_m: Positive = 0.31
    standstill_after_s: Positive = 0.2
    speed_step_kmh: NotNegative = 0.01
    speed_scale_sigma: float = Field(default=0.005, ge=0, le=0.2)
    yaw_rate_noise_degps: NotNegative = 0.1
    yaw_rate_bias_degps: NotNegative = 0.1
    yaw_rate_step_degps: NotNegative = 0.02


class CalibrationSpec(FileModel):
    """How far the sensors sit from where their calibration says; drawn per recording, for each axis on its own.

    The defaults: a tenth of a degree and half a centimetre, what a calibration at the end of the line leaves; the lidar
    was calibrated on purpose and sits twice as well.

    Attributes:
        camera_angle_deg: standard deviation of a camera's turn about each of its axes.
        camera_position_m: standard deviation of its place along each axis.
        lidar_angle_deg: as for the cameras.
        lidar_position_m: as for the cameras.
    """

    camera_angle_deg: float = Field(default=0.1, ge=0, le=5)
    camera_position_m: float = Field(default=0.005, ge=0, le=0.2)
    lidar_angle_deg: float = Field(default=0.05, ge=0, le=5)
    lidar_position_m: float = Field(default=0.005, ge=0, le=0.2)


class VehicleSpec(FileModel):
    """What makes the host a real car; what is left out is ideal. `{}` takes the defaults of a part.

    Attributes:
        suspension: null for a rigid car on a smooth road.
        bus: null for exact signals, 100 times a second.
        calibration: null for sensors that sit exactly where the recording says.
    """

    suspension: SuspensionSpec | None = None
    bus: BusSpec | None = None
    calibration: CalibrationSpec | None = None
