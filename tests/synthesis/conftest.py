from functools import cache

import pytest

from bench.synthesis import synthesize
from bench.synthesis.motion import driven_path
from bench.times import SECOND_NS

MINIATURE = """
name: miniature
licence: CC0-1.0
seed: 7
cameras:
  - name: front
    model: radial_polynomial
    width: 80
    height: 60
    parameters: {coefficients: [21.0, -2.0, 3.0, -0.5], principal_point: [39.5, 29.5], max_angle_rad: 1.7}
    position_m: [3.7, 0.0, 0.66]
    pitch_down_deg: 20
lidar: {position_m: [1.2, 0.0, 1.8], sector_deg: 120, max_range_m: 20}
recordings:
  - name: crossing
    frames: 2
    host: {times_s: [0, 0.1], speed_kmh: [18, 14], yaw_rate_degps: [10, -5]}
    actors:
      - {name: walker, kind: adult, position_m: [8, -1], heading_deg: 90, speed_mps: 1.4}
      - {name: car, kind: car, position_m: [10, 3.2], heading_deg: 180, speed_mps: 5, yaw_rate_degps: 12}
  - name: reversing
    frames: 2
    host: {speed_kmh: [5], gear: reverse}
    street: {buildings: false}
    actors:
      - {name: rider, kind: cyclist, position_m: [7, 1.5], heading_deg: 0, speed_mps: 4}
"""

REAL = "vehicle: {suspension: {road_class: B}, bus: {}, calibration: {}}\n"
IDEAL = ""


def drive(times_s, speeds_mps, yaw_rates_radps=0.0, *, from_s=-1, to_s=8, **more):
    """A path of a profile, known between two times."""
    profile = {"times_s": times_s, "speeds_mps": speeds_mps, "yaw_rates_radps": yaw_rates_radps}
    return driven_path(**profile, first_ns=from_s * SECOND_NS, last_ns=to_s * SECOND_NS, **more)


def contents(folder):
    """All files of the recordings below a folder."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


@pytest.fixture(scope="session")
def rendered(tmp_path_factory):
    """The folder of the miniature's recordings by an ideal car or a real one; rendered once, and only read."""

    @cache
    def of(vehicle):
        folder = tmp_path_factory.mktemp("miniature")
        (folder / "scenario.yaml").write_text(vehicle + MINIATURE)
        synthesize(folder / "scenario.yaml", folder / "out", workers=1)
        return folder

    return of


@pytest.fixture
def scenario_file(tmp_path):
    path = tmp_path / "miniature.scenario.yaml"
    path.write_text(MINIATURE)
    return path
