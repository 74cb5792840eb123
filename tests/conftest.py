"""A small rendered data set that the tests of the upper packages share."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from bench.synthesis import synthesize

settings.register_profile(
    "ci", derandomize=True, deadline=None
)  # CI repeats itself; at a desk every run tries new examples
settings.register_profile("desk", deadline=None)  # how long an example takes says more of the machine than of the code
settings.load_profile("ci" if os.environ.get("CI") else "desk")

SCENARIO = """
name: tiny
licence: CC0-1.0
seed: 11
cameras:
  - name: front
    model: radial_polynomial
    width: 320
    height: 240
    parameters: {coefficients: [85.0, -7.5, 12.0, -2.0], principal_point: [159.5, 119.5], max_angle_rad: 1.7}
    position_m: [3.7, 0.0, 0.66]
    pitch_down_deg: 20
lidar: {position_m: [1.2, 0.0, 1.8], rotation_hz: 10, sector_deg: 120, max_range_m: 15}
recordings:
  - name: crossing
    frames: 5
    host: {speed_kmh: [7]}
    actors:
      - {name: walker, kind: adult, position_m: [8.0, 0.8], heading_deg: -90, speed_mps: 1.4}
      - {name: parked, kind: car, position_m: [9.0, -3.6]}
  - name: standing
    frames: 5
    host: {speed_kmh: [0]}
    actors:
      - {name: walker, kind: adult, position_m: [7.5, -1.0], heading_deg: 90, speed_mps: 1.4}
  - name: overtaking
    frames: 5
    host: {speed_kmh: [10]}
    actors:
      - {name: car, kind: car, position_m: [7.0, 3.2], heading_deg: 0, speed_mps: 6}
"""

CARD = """
name: tiny
title: three short drives for the tests
adapter: native
root: data/tiny
scenario: tiny.scenario.yaml
licence: CC0-1.0
splits:
  all: "*"
  moving: [crossing, overtaking]
"""

# A shell starts background jobs with SIGINT ignored, and so would be all processes that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Commands that keep steps for later runs keep them here."""
    before = os.environ.get("FISHEYE_BENCH_CACHE")
    os.environ["FISHEYE_BENCH_CACHE"] = str(tmp_path_factory.mktemp("cache") / "steps")
    yield
    if before is None:
        del os.environ["FISHEYE_BENCH_CACHE"]
    else:
        os.environ["FISHEYE_BENCH_CACHE"] = before


@pytest.fixture(scope="session", autouse=True)
def _one_worker() -> Iterator[None]:
    """Commands that are called in this process start no others unless they are told to: that takes seconds."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("bench.cli.computing.usable_cores", lambda: 1)
        yield


@pytest.fixture(scope="session")
def tiny_card(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The card of a rendered data set; tests that change files copy it first."""
    folder = tmp_path_factory.mktemp("datasets")
    (folder / "tiny.scenario.yaml").write_text(SCENARIO)
    (folder / "tiny.yaml").write_text(CARD)
    synthesize(folder / "tiny.scenario.yaml", folder / "data" / "tiny", workers=1)
    return folder / "tiny.yaml"
