"""The sweeps of a recording, written one by one."""

from __future__ import annotations

from bench.geometry import RigidTransform
from bench.recordings import RecordingWriter
from bench.synthesis.driving.host import own_body
from bench.synthesis.scanning.scanner import LidarScanner
from bench.synthesis.scenario import RecordingSpec, Scenario
from bench.synthesis.seeds import named_rng
from bench.synthesis.stage import FIRST_IMAGE_NS, Stage


def scan_all(
    scenario: Scenario,
    spec: RecordingSpec,
    stage: Stage,
    *,
    vehicle_from_lidar: RigidTransform,
    writer: RecordingWriter,
) -> None:
    """Scan and write every revolution."""
    scanner = LidarScanner(
        scenario.lidar,
        vehicle_from_lidar=vehicle_from_lidar,
        world=stage.world,
        own_body=own_body(),
        actors=stage.actors,
        host=stage.host,
    )
    for number, time_ns in enumerate(stage.sweep_times_ns.tolist()):
        rng = named_rng(scenario.seed, spec.name, "lidar", number)
        writer.sweep(scanner.scan(time_ns, timestamp_ns=time_ns + FIRST_IMAGE_NS, rng=rng))
