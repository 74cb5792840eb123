"""Everything of a recording that stands or moves, and when it is looked at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.bodies import Body, make_body
from bench.synthesis.driving.motion import HostMotion, host_motion
from bench.synthesis.driving.path import Path
from bench.synthesis.lighting import Lighting, lighting
from bench.synthesis.mesh import Mesh, PlacedMesh
from bench.synthesis.placement import FIRST_IMAGE_NS, find_ways, swept_ground
from bench.synthesis.scenario import RecordingSpec, ScenarioHead
from bench.synthesis.scenario.draws import named_rng
from bench.synthesis.world import build_world

__all__ = ["FIRST_IMAGE_NS", "Actor", "Stage", "set_stage"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Actor:
    """A body and its way.

    Attributes:
        name: of the track.
        instance_id: in truth images.
        body: its shape.
        path: its way.
    """

    name: str
    instance_id: int
    body: Body
    path: Path

    def placed(self, time_ns: int) -> PlacedMesh:
        """Its posture and place at a time of the scene clock, world frame."""
        poses, (speeds_mps, _) = self.path.at([time_ns]), self.path.signals([time_ns])
        posed = Mesh(
            corners_m=self.body.corners_at(float(poses.distances_m[0]), speed_mps=float(speeds_mps[0])),
            texture_m=self.body.mesh.texture_m,
            surfaces=self.body.mesh.surfaces,
        )
        return PlacedMesh(mesh=posed.moved(poses.transform()), instance_id=self.instance_id)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stage:
    """The scene of a recording.

    Attributes:
        world: the static world, world frame.
        actors: in the scenario's order; the first has instance id 1.
        host: the host's motion, with the sway of its body.
        light: sun, clouds or night.
        image_times_ns: scene clock; 0 is the first image.
        sweep_times_ns: scene clock, reference times.
    """

    world: Mesh
    actors: tuple[Actor, ...]
    host: HostMotion
    light: Lighting
    image_times_ns: NDArray[np.int64]
    sweep_times_ns: NDArray[np.int64]


def set_stage(scenario: ScenarioHead, spec: RecordingSpec) -> Stage:
    """Build the scene of a recording."""
    ways = find_ways(scenario, spec)
    bodies = [make_body(actor.kind, named_rng(scenario.seed, spec.name, "actor", actor.name)) for actor in spec.actors]
    keep_clear = swept_ground(ways, [body.size_m for body in bodies])
    world = build_world(spec.street, named_rng(scenario.seed, spec.name, "world"), keep_clear)
    return Stage(
        world=world.mesh,
        actors=tuple(
            Actor(name=actor.name, instance_id=number, body=body, path=path)
            for number, (actor, body, path) in enumerate(zip(spec.actors, bodies, ways.actors, strict=True), start=1)
        ),
        host=host_motion(
            ways.host,
            scenario.vehicle.suspension,
            bumps=spec.host.bumps,
            rng=named_rng(scenario.seed, spec.name, "road"),
        ),
        light=lighting(spec.light, named_rng(scenario.seed, spec.name, "light")),
        image_times_ns=ways.image_times_ns,
        sweep_times_ns=ways.sweep_times_ns,
    )
