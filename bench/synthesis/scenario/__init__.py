"""What a scenario file says: sensors, light, streets, how the host drives and who is on the scene."""

from bench.synthesis.scenario.draws import DrawError
from bench.synthesis.scenario.file import LARGEST_BYTES, ScenarioText, read_text
from bench.synthesis.scenario.recording import (
    ActorSpec,
    BumpSpec,
    BusSpec,
    CalibrationSpec,
    CameraSpec,
    HostSpec,
    LidarSpec,
    LightSpec,
    RecordingSpec,
    Scenario,
    ScenarioFile,
    ScenarioHead,
    SensorSpec,
    SeriesSpec,
    StreetSpec,
    SuspensionSpec,
    VehicleSpec,
    interval_ns,
)

__all__ = [
    "LARGEST_BYTES",
    "ActorSpec",
    "BumpSpec",
    "BusSpec",
    "CalibrationSpec",
    "CameraSpec",
    "DrawError",
    "HostSpec",
    "LidarSpec",
    "LightSpec",
    "RecordingSpec",
    "Scenario",
    "ScenarioFile",
    "ScenarioHead",
    "ScenarioText",
    "SensorSpec",
    "SeriesSpec",
    "StreetSpec",
    "SuspensionSpec",
    "VehicleSpec",
    "interval_ns",
    "read_text",
]
