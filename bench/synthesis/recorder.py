"""A recording, from its scene to its files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from bench.geometry import RigidTransform
from bench.recordings import Cuboid, ObjectState, RecordingWriter, Track
from bench.synthesis.draws import named_rng
from bench.synthesis.driving.bus import bus_report
from bench.synthesis.driving.ego import OUTLINE_M, mounted_rig
from bench.synthesis.imaging.renderer import write_images
from bench.synthesis.placement import FIRST_IMAGE_NS
from bench.synthesis.scanner import scans
from bench.synthesis.scenario import RecordingSpec, Scenario, interval_ns
from bench.synthesis.scene import Actor, Scene, build_scene

# Between true poses a reader moves with constant twist. Measured over hard braking, bends and a bump of 5 cm at up to
# 50 km/h, that is off by at most 2e-5 rad (0.004 px) and 0.06 mm at 200 Hz, four times as much at 100 Hz.
TRUTH_INTERVAL_NS = 5_000_000
DECIMALS = 7  # of m, rad and quaternions that are written: beyond any sensor, before what depends on the processor


def write_motion(scenario: Scenario, spec: RecordingSpec, scene: Scene, writer: RecordingWriter) -> None:
    """Write the bus signals and the exact poses."""
    rng = named_rng(scenario.seed, spec.name, "bus")
    report = bus_report(scene.ego.ground, scenario.vehicle.bus, rng)
    writer.bus_signals(
        timestamps_ns=report.times_ns + FIRST_IMAGE_NS,
        speed_mps=report.speeds_mps,
        yaw_rate_radps=report.yaw_rates_radps,
        gear=["R" if spec.host.gear == "reverse" else "D"] * len(report.times_ns),
    )
    nodes_ns = scene.ego.nodes_ns
    first, last = -(-int(nodes_ns[0]) // TRUTH_INTERVAL_NS), int(nodes_ns[-1]) // TRUTH_INTERVAL_NS
    times_ns = np.arange(first, last + 1, dtype=np.int64) * TRUTH_INTERVAL_NS
    poses = scene.ego.at(times_ns)
    writer.poses(times_ns + FIRST_IMAGE_NS, Rotation.from_matrix(poses.rotations), poses.positions_m, truth=True)


def render_recording(scenario: Scenario, spec: RecordingSpec, root: Path) -> None:
    """Render a recording into a folder.

    Args:
        scenario: the file that it belongs to.
        spec: the recording.
        root: its folder, whose name is free; nothing of an older recording may lie in it.
    """
    scene, rig = build_scene(scenario, spec), mounted_rig(scenario, spec)
    writer = RecordingWriter(root, decimals=DECIMALS)
    for camera in rig.cameras.values():
        write_images(scenario, spec, scene, camera=camera, writer=writer)
    for sweep in scans(scenario, spec, scene, vehicle_from_lidar=rig.vehicle_from_lidar):
        writer.sweep(sweep)
    write_motion(scenario, spec, scene, writer)
    times_ns = (scene.sweep_times_ns + FIRST_IMAGE_NS).tolist()
    writer.annotations([_track(actor, scene) for actor in scene.actors], timestamps_ns=times_ns)
    writer.true_calibration(cameras=rig.cameras, vehicle_from_lidar=rig.vehicle_from_lidar)
    writer.header(
        name=spec.name,
        licence=scenario.licence,
        frame_interval_ns=interval_ns(scenario.frame_rate_hz),
        cameras=rig.recorded_cameras,
        vehicle_from_lidar=rig.recorded_vehicle_from_lidar,
        vehicle_outline_m=OUTLINE_M,
    )


def _track(actor: Actor, scene: Scene) -> Track:
    """A cuboid at the reference time of every sweep, in the frame of the ego vehicle's body as it is at that time."""
    middle = RigidTransform(np.eye(3), np.array([0.0, 0.0, actor.body.size_m[2] / 2]))
    states = []
    for time_ns in scene.sweep_times_ns.tolist():
        vehicle_from_world = scene.ego.at([time_ns]).transform().inverse()
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
