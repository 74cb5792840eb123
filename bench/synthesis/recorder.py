"""A recording, from its scene to its files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.geometry import RigidTransform
from bench.recordings import Cuboid, ObjectState, RecordingWriter, Track
from bench.synthesis.bus_log import write_motion
from bench.synthesis.driving.host import OUTLINE_M
from bench.synthesis.driving.rig import mounted_rig
from bench.synthesis.imaging.film import film
from bench.synthesis.scanning.sweeps import scan_all
from bench.synthesis.scenario import RecordingSpec, Scenario, interval_ns
from bench.synthesis.stage import FIRST_IMAGE_NS, Actor, Stage, set_stage


def render_recording(scenario: Scenario, spec: RecordingSpec, root: Path) -> None:
    """Render a recording into a folder.

    Args:
        scenario: the file that it stands in.
        spec: the recording.
        root: its folder, whose name is free; nothing of an older recording may lie in it.
    """
    stage, writer, rig = set_stage(scenario, spec), RecordingWriter(root), mounted_rig(scenario, spec)
    for camera in rig.cameras.values():
        film(scenario, spec, stage, camera=camera, writer=writer)
    scan_all(scenario, spec, stage, vehicle_from_lidar=rig.vehicle_from_lidar, writer=writer)
    write_motion(scenario, spec, stage, writer)
    times_ns = (stage.sweep_times_ns + FIRST_IMAGE_NS).tolist()
    writer.annotations([_track(actor, stage) for actor in stage.actors], timestamps_ns=times_ns)
    writer.true_calibration(cameras=rig.cameras, vehicle_from_lidar=rig.vehicle_from_lidar)
    writer.header(
        name=spec.name,
        licence=scenario.licence,
        frame_interval_ns=interval_ns(scenario.frame_rate_hz),
        cameras=rig.recorded_cameras,
        vehicle_from_lidar=rig.recorded_vehicle_from_lidar,
        vehicle_outline_m=OUTLINE_M,
    )


def _track(actor: Actor, stage: Stage) -> Track:
    """A cuboid at the reference time of every sweep, in the frame of the host's body as it is at that time."""
    middle = RigidTransform(np.eye(3), np.array([0.0, 0.0, actor.body.size_m[2] / 2]))
    states = []
    for time_ns in stage.sweep_times_ns.tolist():
        vehicle_from_world = stage.host.at([time_ns]).transform().inverse()
        world_from_centre = actor.path.at([time_ns]).transform() @ middle
        _, yaw_rates_radps = actor.path.signals([time_ns])
        shape = Cuboid(vehicle_from_object=vehicle_from_world @ world_from_centre, size_m=actor.body.size_m)
        states.append(
            ObjectState(
                timestamp_ns=time_ns + FIRST_IMAGE_NS,
                shape=shape,
                velocity_mps=vehicle_from_world.rotate(actor.path.velocity_mps(time_ns)),
                yaw_rate_radps=float(yaw_rates_radps[0]),
            )
        )
    return Track(
        track_id=actor.name, object_class=actor.body.object_class, states=tuple(states), instance_id=actor.instance_id
    )
