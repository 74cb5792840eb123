"""The scene of a recording: the static world, actors, ego motion, light, and the times of its sensors.

Brightness is what the picture shows, 1 is white, after exposure and the camera's tone curve: a day's shadows, a fifth
as bright as the sun in the street, come out half as bright in the picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.bodies import make_body
from bench.synthesis.bodies.body import Body
from bench.synthesis.draws import named_rng
from bench.synthesis.mesh import Mesh, PlacedMesh
from bench.synthesis.motion import EgoMotion, Path, ego_motion
from bench.synthesis.placement import plan_trajectories, swept_ground
from bench.synthesis.scenario import LightSpec, RecordingSpec, ScenarioHead
from bench.synthesis.world import build_world


@dataclass(frozen=True, slots=True, kw_only=True)
class LightKind:
    """The numbers of a kind of light.

    Attributes:
        elevations_deg: of the sun, from, to.
        sun_light: brightness of white paper that faces the sun, by the sun alone.
        sky_light: brightness of white paper that lies on the ground, by the sky alone.
        horizon: brightness of the sky at the horizon.
        zenith: brightness of the sky at its top.
        cloud: standard deviation of the clouds, relative to the sky.
        sun_glow: brightness of the sky around the sun, added.
        shutter_ms: how long cameras expose by themselves.
        gain: how much cameras amplify by themselves; noise grows with it.
        night: whether lamps are lit.
    """

    elevations_deg: tuple[float, float]
    sun_light: float
    sky_light: float
    horizon: float
    zenith: float
    cloud: float
    sun_glow: float
    shutter_ms: float
    gain: float
    night: bool = False


# Sun and sky light: an automatic exposure puts a road of albedo 0.3 at about 110 of 255, so that a level
# white sheet by day gets about 1.4. Under low sun the road, lit at a grazing angle, is mostly lit by the sky, and what
# stands upright and faces the sun is bright. Clouds send the same from everywhere.
# Shutter: a car camera of f/2 in 50,000 lux needs 2 ms at its lowest gain, under clouds (10,000 lux) 6 ms; by night it
# exposes for as long as 15 images per second and moving objects allow, and then turns up the gain.
KINDS = {
    "sunny": LightKind(
        elevations_deg=(35.0, 65.0), sun_light=0.90, sky_light=0.72, horizon=0.92, zenith=0.62, cloud=0.06,
        sun_glow=0.3, shutter_ms=2.0, gain=1.0,
    ),
    "overcast": LightKind(
        elevations_deg=(35.0, 65.0), sun_light=0.0, sky_light=1.25, horizon=0.88, zenith=0.95, cloud=0.035,
        sun_glow=0.0, shutter_ms=6.0, gain=1.0,
    ),
    "low_sun": LightKind(
        elevations_deg=(10.0, 22.0), sun_light=1.10, sky_light=0.65, horizon=0.95, zenith=0.48, cloud=0.08,
        sun_glow=0.8, shutter_ms=5.0, gain=1.5,
    ),
    "night": LightKind(
        elevations_deg=(35.0, 65.0), sun_light=0.0, sky_light=0.045, horizon=0.07, zenith=0.02, cloud=0.1,
        sun_glow=0.0, shutter_ms=20.0, gain=6.0, night=True,
    ),
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lighting:
    """The light of a recording.

    Attributes:
        kind: one of `KINDS`.
        towards_sun: (3,) float64, unit vector, world.
    """

    kind: LightKind
    towards_sun: NDArray[np.float64]


def lighting(spec: LightSpec, rng: np.random.Generator) -> Lighting:
    """The light that a recording asks for; what it leaves open is drawn."""
    kind = KINDS[spec.kind]
    azimuth_deg, elevation_deg = rng.uniform(0, 360), rng.uniform(*kind.elevations_deg)
    azimuth = np.radians(azimuth_deg if spec.azimuth_deg is None else spec.azimuth_deg)
    elevation = np.radians(elevation_deg if spec.elevation_deg is None else spec.elevation_deg)
    flat = np.cos(elevation)
    towards_sun = np.array([np.cos(azimuth) * flat, np.sin(azimuth) * flat, np.sin(elevation)])
    return Lighting(kind=kind, towards_sun=towards_sun)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Actor:
    """A body and its path.

    Attributes:
        name: of the track.
        instance_id: in truth images.
        body: its shape.
        path: over the ground.
    """

    name: str
    instance_id: int
    body: Body
    path: Path

    def placed(self, time_ns: int) -> PlacedMesh:
        """Its posture and position at a time of the scene clock, world frame."""
        poses, (speeds_mps, _) = self.path.at([time_ns]), self.path.signals([time_ns])
        posed = Mesh(
            corners_m=self.body.corners_at(float(poses.distances_m[0]), speed_mps=float(speeds_mps[0])),
            texture_m=self.body.mesh.texture_m,
            surfaces=self.body.mesh.surfaces,
        )
        return PlacedMesh(mesh=posed.moved(poses.transform()), instance_id=self.instance_id)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """The scene of a recording.

    Attributes:
        world: the static world, world frame.
        actors: in the scenario's order; the first has instance id 1.
        ego: motion of the ego vehicle, with pitch, roll and heave of its body.
        light: sun, clouds or night.
        image_times_ns: scene clock; 0 is the first image.
        sweep_times_ns: scene clock, reference times.
    """

    world: Mesh
    actors: tuple[Actor, ...]
    ego: EgoMotion
    light: Lighting
    image_times_ns: NDArray[np.int64]
    sweep_times_ns: NDArray[np.int64]


def build_scene(scenario: ScenarioHead, spec: RecordingSpec) -> Scene:
    """Build the scene of a recording."""
    trajectories = plan_trajectories(scenario, spec)
    bodies = [make_body(actor.kind, named_rng(scenario.seed, spec.name, "actor", actor.name)) for actor in spec.actors]
    keep_clear = swept_ground(trajectories, [body.size_m for body in bodies])
    world = build_world(spec.street, named_rng(scenario.seed, spec.name, "world"), keep_clear)
    return Scene(
        world=world.mesh,
        actors=tuple(
            Actor(name=actor.name, instance_id=number, body=body, path=path)
            for number, (actor, body, path) in enumerate(
                zip(spec.actors, bodies, trajectories.actors, strict=True), start=1
            )
        ),
        ego=ego_motion(
            trajectories.ego,
            scenario.vehicle.suspension,
            bumps=spec.host.bumps,
            rng=named_rng(scenario.seed, spec.name, "road"),
        ),
        light=lighting(spec.light, named_rng(scenario.seed, spec.name, "light")),
        image_times_ns=trajectories.image_times_ns,
        sweep_times_ns=trajectories.sweep_times_ns,
    )
