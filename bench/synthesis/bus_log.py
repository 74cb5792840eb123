"""What the car's bus reports of its motion, and the truth apart from it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from bench.recordings import RecordingWriter
from bench.synthesis.driving.bus import bus_report
from bench.synthesis.scenario import RecordingSpec, Scenario
from bench.synthesis.seeds import named_rng
from bench.synthesis.stage import FIRST_IMAGE_NS, Stage

# Between true poses a reader moves with constant twist. Measured over hard braking, bends and a bump of 5 cm at up to
# 50 km/h, that is off by at most 2e-5 rad (0.004 px) and 0.06 mm at 200 Hz, four times as much at 100 Hz.
TRUTH_INTERVAL_NS = 5_000_000


def write_motion(scenario: Scenario, spec: RecordingSpec, stage: Stage, writer: RecordingWriter) -> None:
    """Write the bus signals and the exact poses."""
    rng = named_rng(scenario.seed, spec.name, "bus")
    report = bus_report(stage.host.ground, scenario.vehicle.bus, rng)
    writer.bus_signals(
        timestamps_ns=report.times_ns + FIRST_IMAGE_NS,
        speed_mps=report.speeds_mps,
        yaw_rate_radps=report.yaw_rates_radps,
        gear=["R" if spec.host.gear == "reverse" else "D"] * len(report.times_ns),
    )
    nodes_ns = stage.host.nodes_ns
    first, last = -(-int(nodes_ns[0]) // TRUTH_INTERVAL_NS), int(nodes_ns[-1]) // TRUTH_INTERVAL_NS
    times_ns = np.arange(first, last + 1, dtype=np.int64) * TRUTH_INTERVAL_NS
    poses = stage.host.at(times_ns)
    writer.poses(times_ns + FIRST_IMAGE_NS, Rotation.from_matrix(poses.rotations), poses.positions_m, truth=True)
