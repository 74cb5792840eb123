"""One recording of a scenario, from its world to its files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.geometry import RigidTransform
from bench.recordings import Cuboid, MountedCamera, ObjectState, RecordingWriter, Track
from bench.synthesis.actors import make_body
from bench.synthesis.host import OUTLINE_M, mounted_camera, own_body, vehicle_from_lidar
from bench.synthesis.mesh import Mesh
from bench.synthesis.motion import SECOND_NS, ActorPath, HostPath, host_path
from bench.synthesis.ray_scene import RayScene
from bench.synthesis.renderer import ImageRenderer, PlacedMesh
from bench.synthesis.scanner import Actor, LidarScanner
from bench.synthesis.scenario import ActorSpec, HostSpec, RecordingSpec, Scenario, interval_ns
from bench.synthesis.seeds import named_rng
from bench.synthesis.textures import texture_atlas
from bench.synthesis.world import street

FIRST_IMAGE_NS = SECOND_NS  # the recording's clock at the scene's time 0
BUS_INTERVAL_NS = 10_000_000
MARGIN_NS = 200_000_000  # of bus signals before the first and after the last sensor reading


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stage:
    """Everything of a recording that stands or moves.

    Attributes:
        world: the static world, world frame.
        actors: in the scenario's order; the first has instance id 1.
        host: the host's way.
        image_times_ns: scene clock; 0 is the first image.
        sweep_times_ns: scene clock, reference times.
        sun_world: (3,) float64, unit vector to the sun.
    """

    world: Mesh
    actors: tuple[Actor, ...]
    host: HostPath
    image_times_ns: NDArray[np.int64]
    sweep_times_ns: NDArray[np.int64]
    sun_world: NDArray[np.float64]


def set_stage(scenario: Scenario, spec: RecordingSpec) -> Stage:
    """Build the world of a recording."""
    rng = named_rng(scenario.seed, spec.name, "world")
    turn_ns = interval_ns(scenario.lidar.rotation_hz)
    image_times_ns = np.arange(spec.frames, dtype=np.int64) * interval_ns(scenario.frame_rate_hz)
    # One revolution before the first image and one after the last, so that every image lies between two sweeps.
    sweep_times_ns = np.arange(-1, int(image_times_ns[-1]) // turn_ns + 2, dtype=np.int64) * turn_ns + turn_ns // 4
    azimuth, elevation = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(40, 65))
    sun_world = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    return Stage(
        world=street(spec.street, rng),
        actors=tuple(_actor(scenario, spec.name, entry, k + 1) for k, entry in enumerate(spec.actors)),
        host=_host(
            spec.host, int(sweep_times_ns[0]) - turn_ns - MARGIN_NS, int(sweep_times_ns[-1]) + turn_ns + MARGIN_NS
        ),
        image_times_ns=image_times_ns,
        sweep_times_ns=sweep_times_ns,
        sun_world=sun_world,
    )


def render_recording(scenario: Scenario, spec: RecordingSpec, root: Path) -> None:
    """Render a recording into a folder.

    Args:
        scenario: the file that it stands in.
        spec: the recording.
        root: its folder, whose name is free; nothing of an older recording may lie in it.
    """
    stage, writer = set_stage(scenario, spec), RecordingWriter(root)
    cameras = {camera.name: mounted_camera(camera) for camera in scenario.cameras}
    mounting = vehicle_from_lidar(scenario.lidar)
    for name, camera in cameras.items():
        _write_images(scenario, spec, stage, camera=camera, name=name, writer=writer)
    _write_sweeps(scenario, spec, stage, mounting=mounting, writer=writer)
    _write_motion(stage, spec, writer)
    times_ns = (stage.sweep_times_ns + FIRST_IMAGE_NS).tolist()
    writer.annotations([_track(actor, stage) for actor in stage.actors], timestamps_ns=times_ns)
    writer.header(
        name=spec.name,
        licence=scenario.licence,
        frame_interval_ns=interval_ns(scenario.frame_rate_hz),
        cameras=cameras,
        vehicle_from_lidar=mounting,
        vehicle_outline_m=OUTLINE_M,
    )


def place(stage: Stage, time_ns: int) -> list[PlacedMesh]:
    """Everything but the host at a time of the scene clock, world frame."""
    placed = [PlacedMesh(mesh=stage.world)]
    for actor in stage.actors:
        poses = actor.path.at([time_ns])
        body = actor.body.mesh
        posed = Mesh(
            corners_m=actor.body.corners_at(float(poses.distances_m[0])),
            texture_m=body.texture_m,
            surfaces=body.surfaces,
        )
        world_from_object = poses.transform(height_m=actor.floor_m)
        placed.append(PlacedMesh(mesh=posed.moved(world_from_object), instance_id=actor.instance_id))
    return placed


def _actor(scenario: Scenario, recording: str, spec: ActorSpec, instance_id: int) -> Actor:
    path = ActorPath(
        start_m=np.array(spec.position_m),
        heading_rad=float(np.radians(spec.heading_deg)),
        speed_mps=spec.speed_mps,
        yaw_rate_radps=float(np.radians(spec.yaw_rate_degps)),
    )
    body = make_body(spec.kind, named_rng(scenario.seed, recording, "actor", spec.name))
    return Actor(name=spec.name, instance_id=instance_id, body=body, path=path, floor_m=spec.floor_m)


def _host(spec: HostSpec, first_ns: int, last_ns: int) -> HostPath:
    sign, count = (-1.0 if spec.gear == "reverse" else 1.0), len(spec.times_s)
    return host_path(
        times_s=spec.times_s,
        speeds_mps=np.broadcast_to(sign * np.array(spec.speed_kmh) / 3.6, count),
        yaw_rates_radps=np.broadcast_to(np.radians(spec.yaw_rate_degps), count),
        first_ns=first_ns,
        last_ns=last_ns,
    )


def _write_images(
    scenario: Scenario, spec: RecordingSpec, stage: Stage, *, camera: MountedCamera, name: str, writer: RecordingWriter
) -> None:
    noise_grey = next(entry.noise_grey for entry in scenario.cameras if entry.name == name)
    atlas = texture_atlas(scenario.seed)
    renderer = ImageRenderer(camera, own_body=own_body(), atlas=atlas, sun_world=stage.sun_world, noise_grey=noise_grey)
    for frame, time_ns in enumerate(stage.image_times_ns.tolist()):
        rng = named_rng(scenario.seed, spec.name, name, frame)
        world_from_vehicle = stage.host.at([time_ns]).transform()
        image = renderer.render(place(stage, time_ns), world_from_vehicle=world_from_vehicle, rng=rng)
        writer.image(name, time_ns + FIRST_IMAGE_NS, image.pixels)
        writer.truth(name, time_ns + FIRST_IMAGE_NS, image.instance_ids)


def _write_sweeps(
    scenario: Scenario, spec: RecordingSpec, stage: Stage, *, mounting: RigidTransform, writer: RecordingWriter
) -> None:
    scanner = LidarScanner(
        scenario.lidar,
        vehicle_from_lidar=mounting,
        static_scene=RayScene(stage.world.corners_m),
        actors=stage.actors,
        host=stage.host,
    )
    for number, time_ns in enumerate(stage.sweep_times_ns.tolist()):
        rng = named_rng(scenario.seed, spec.name, "lidar", number)
        writer.sweep(scanner.scan(time_ns, timestamp_ns=time_ns + FIRST_IMAGE_NS, rng=rng))


def _write_motion(stage: Stage, spec: RecordingSpec, writer: RecordingWriter) -> None:
    """What the bus would report, and the truth apart from it."""
    nodes_ns = stage.host.nodes_ns
    times_ns = (
        np.arange(-(-int(nodes_ns[0]) // BUS_INTERVAL_NS), int(nodes_ns[-1]) // BUS_INTERVAL_NS + 1) * BUS_INTERVAL_NS
    )
    speeds_mps, yaw_rates_radps = stage.host.signals(times_ns)
    writer.bus_signals(
        timestamps_ns=times_ns + FIRST_IMAGE_NS,
        speed_mps=np.abs(speeds_mps),
        yaw_rate_radps=yaw_rates_radps,
        gear=["R" if spec.host.gear == "reverse" else "D"] * len(times_ns),
    )
    poses = stage.host.at(times_ns)
    rotations = Rotation.from_rotvec(poses.yaws_rad[:, None] * np.array([0.0, 0.0, 1.0]))
    positions_m = np.column_stack([poses.positions_m, np.zeros(len(times_ns))])
    writer.poses(times_ns + FIRST_IMAGE_NS, rotations, positions_m, truth=True)


def _track(actor: Actor, stage: Stage) -> Track:
    """A cuboid at the reference time of every sweep."""
    states = []
    for time_ns in stage.sweep_times_ns.tolist():
        vehicle_from_world = stage.host.at([time_ns]).transform().inverse()
        world_from_object = actor.path.at([time_ns]).transform(height_m=actor.floor_m)
        world_from_centre = world_from_object @ RigidTransform(
            np.eye(3), np.array([0.0, 0.0, actor.body.size_m[2] / 2])
        )
        shape = Cuboid(vehicle_from_object=vehicle_from_world @ world_from_centre, size_m=actor.body.size_m)
        states.append(
            ObjectState(
                timestamp_ns=time_ns + FIRST_IMAGE_NS,
                shape=shape,
                velocity_mps=vehicle_from_world.rotate(actor.path.velocity_mps(time_ns)),
                yaw_rate_radps=actor.path.yaw_rate_radps,
            )
        )
    return Track(
        track_id=actor.name, object_class=actor.body.object_class, states=tuple(states), instance_id=actor.instance_id
    )
