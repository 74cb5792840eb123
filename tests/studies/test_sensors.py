"""The reference by other lidars: a drive is scanned again, and the table holds every sensor."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.audit.sources import OpenedSource, audit_sources, instance_ids
from bench.recordings import load_card
from bench.synthesis.scene import build_scene
from benchmarks.sensors import SENSORS, scanned_by, score_recording, table


def test_a_drive_is_scanned_again_and_scored_by_every_sensor(tiny_card: Path) -> None:
    (source,) = audit_sources(load_card(tiny_card), split="overtaking", recordings=None)
    assert source.scene is not None
    recording, (scenario, spec) = source.recorded.open(), source.scene
    again = scanned_by(recording, build_scene(scenario, spec), scenario, spec, scenario.lidar)
    for stored, scanned in zip(recording.sweeps, again.sweeps, strict=True):
        np.testing.assert_array_equal(stored.read().points_lidar, scanned.read().points_lidar)
    opened = OpenedSource(source=source, recording=recording, instance_of=instance_ids(recording))
    lines = table(score_recording(opened)).splitlines()
    assert {line.split(" | ")[0].strip("| ") for line in lines[2:]} == set(SENSORS)
    assert all(line.count("|") == lines[0].count("|") for line in lines)
