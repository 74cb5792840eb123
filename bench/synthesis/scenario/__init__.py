"""What a scenario file says: sensors, light, streets, how the host drives and who is on the scene."""

from bench.synthesis.scenario.cameras import CameraSpec, SensorSpec
from bench.synthesis.scenario.cast import ActorSpec
from bench.synthesis.scenario.draws import DrawError
from bench.synthesis.scenario.drive import BumpSpec, HostSpec
from bench.synthesis.scenario.file import LARGEST_BYTES, ScenarioText, read_text
from bench.synthesis.scenario.lidar import LidarSpec
from bench.synthesis.scenario.light import LightSpec
from bench.synthesis.scenario.recording import RecordingSpec, Scenario, ScenarioFile, ScenarioHead
from bench.synthesis.scenario.series import SeriesSpec
from bench.synthesis.scenario.street import StreetSpec
from bench.synthesis.scenario.values import interval_ns
from bench.synthesis.scenario.vehicle import BusSpec, CalibrationSpec, SuspensionSpec, VehicleSpec

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
