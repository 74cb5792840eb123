"""The scene of a recording: trajectories, the static world, actors, ego motion, light, and the times of its sensors.

Brightness is what the picture shows, 1 is white, after exposure and the camera's tone curve: a day's shadows, a fifth
as bright as the sun in the street, come out half as bright in the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.synthesis.bodies import make_body
from bench.synthesis.bodies.body import Body
from bench.synthesis.ego import OUTLINE_M, own_body
from bench.synthesis.mesh import Mesh, PlacedMesh
from bench.synthesis.motion import EgoMotion, Path, Poses, driven_path, ego_motion
from bench.synthesis.scenario import (
    ActorSpec,
    CameraSpec,
    DrivenSpec,
    LightSpec,
    RecordingSpec,
    ScenarioHead,
    interval_ns,
    named_rng,
)
from bench.synthesis.world import build_world
from bench.times import SECOND_NS

FIRST_IMAGE_NS = SECOND_NS  # the recording's clock at the scene's time 0
MARGIN_NS = 200_000_000  # that paths are known before the first and after the last sensor reading


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectories:
    """Poses of the ego vehicle and the actors at any time, and the times at which the sensors measure.

    Attributes:
        ego: path of the ego vehicle.
        actors: their paths, in the scenario's order.
        image_times_ns: scene clock; 0 is the first image.
        sweep_times_ns: scene clock, reference times.
    """

    ego: Path
    actors: tuple[Path, ...]
    image_times_ns: NDArray[np.int64]
    sweep_times_ns: NDArray[np.int64]


def plan_trajectories(head: ScenarioHead, spec: RecordingSpec) -> Trajectories:
    """The trajectories of a recording."""
    revolution_ns = interval_ns(head.lidar.rotation_hz)
    image_times_ns = np.arange(spec.frames, dtype=np.int64) * interval_ns(head.frame_rate_hz)
    # One revolution before the first image and one after the last, so that every image lies between two sweeps.
    # Camera and lidar keep their own time: where in its revolution the lidar is at the first image is up to chance.
    phase_ns = int(named_rng(head.seed, spec.name, "lidar phase").integers(revolution_ns))
    sweep_times_ns = (
        np.arange(-1, int(image_times_ns[-1]) // revolution_ns + 2, dtype=np.int64) * revolution_ns + phase_ns
    )
    actor_times_ns = [_milliseconds(actor.at_s) for actor in spec.actors]
    first_ns = int(sweep_times_ns[0]) - revolution_ns - MARGIN_NS
    last_ns = max([int(sweep_times_ns[-1]) + revolution_ns + MARGIN_NS, *actor_times_ns])
    speeds_mps = np.array(spec.host.speed_kmh) / 3.6
    ego = _path(spec.host, speeds_mps, first_ns=first_ns, last_ns=last_ns, ramp_s=spec.host.ramp_s)
    return Trajectories(
        ego=ego,
        actors=tuple(_actor_path(actor, ego, first_ns, last_ns) for actor in spec.actors),
        image_times_ns=image_times_ns,
        sweep_times_ns=sweep_times_ns,
    )


def _path(spec: DrivenSpec, speeds_mps: NDArray[np.float64], **place: Any) -> Path:
    """`driven_path` of a profile, `place` its other arguments."""
    sign = -1.0 if spec.gear == "reverse" else 1.0
    yaw_rates_radps = np.radians(spec.yaw_rate_degps)
    return driven_path(times_s=spec.times_s, speeds_mps=sign * speeds_mps, yaw_rates_radps=yaw_rates_radps, **place)


def _actor_path(spec: ActorSpec, ego: Path, first_ns: int, last_ns: int) -> Path:
    at_ns = _milliseconds(spec.at_s)
    world_from_vehicle = ego.at([at_ns]).transform()
    position = world_from_vehicle.apply(np.array([*spec.position_m, 0.0]))
    forward = world_from_vehicle.rotation[:, 0]
    heading_rad = float(np.arctan2(forward[1], forward[0]) + np.radians(spec.heading_deg))
    return _path(
        spec,
        np.array(spec.speed_mps),
        first_ns=first_ns,
        last_ns=last_ns,
        through=(float(position[0]), float(position[1]), heading_rad),
        through_ns=at_ns,
        floor_m=spec.floor_m,
    )


def _milliseconds(seconds: float) -> int:
    """Time in ns, to the millisecond, as paths have their nodes."""
    return round(seconds * 1000) * 1_000_000


KEEP_CLEAR_M = 0.4  # from the paths to whatever stands beside them: 10 cm more than a mirror is wide


def watched_times(trajectories: Trajectories) -> NDArray[np.int64]:
    """(N,) int64, ns: the image times, carried on to where the lidar sees its first and its last point."""
    revolution_ns = int(trajectories.sweep_times_ns[1] - trajectories.sweep_times_ns[0])
    first_ns, last_ns = (
        int(trajectories.sweep_times_ns[0]) - revolution_ns,
        int(trajectories.sweep_times_ns[-1]) + revolution_ns,
    )
    images = trajectories.image_times_ns
    step_ns = int(images[1] - images[0]) if len(images) > 1 else revolution_ns
    return np.arange(-(-first_ns // step_ns), last_ns // step_ns + 1, dtype=np.int64) * step_ns


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MovingOutline:
    """A body from above, at N times.

    Attributes:
        poses: world from body, N rows.
        outline_m: (K, 2), m, in the body's frame, not closed.
    """

    poses: Poses
    outline_m: NDArray[np.float64]

    def footprints(self, rows: NDArray[np.intp] | slice = slice(None)) -> NDArray[np.object_]:
        """The outline at some of the times: shapely polygons, world, m."""
        rotations = self.poses.rotations[rows]
        rings = np.einsum("nij,kj->nki", rotations[:, :2, :2], self.outline_m)
        return np.asarray(shapely.polygons(rings + self.poses.positions_m[rows][:, None, :2]))


def box_outline(size_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 2) float64, m: the box around a body from above, in its own frame."""
    return np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * size_m[:2]


def moving_outlines(trajectories: Trajectories, sizes_m: Sequence[NDArray[np.float64]]) -> list[MovingOutline]:
    """The ego vehicle, then the boxes of these sizes around the actors, at the watched times."""
    times_ns = watched_times(trajectories)
    outlines_m = [OUTLINE_M, *map(box_outline, sizes_m)]
    paths = (trajectories.ego, *trajectories.actors)
    return [MovingOutline(poses=p.at(times_ns), outline_m=o) for p, o in zip(paths, outlines_m, strict=True)]


def swept_ground(trajectories: Trajectories, sizes_m: Sequence[NDArray[np.float64]]) -> tuple[shapely.Polygon, ...]:
    """Areas that the ego vehicle and each actor cover during a recording, with a margin; nothing else may stand there.

    Args:
        trajectories: of the recording.
        sizes_m: (3,) each, m, the boxes around the actors' bodies.
    """
    return tuple(_swept(mover.footprints()) for mover in moving_outlines(trajectories, sizes_m))


def _swept(row: NDArray[np.object_]) -> shapely.Polygon:
    """One polygon around a row of footprints: hulls of neighbours leave no gaps, however fast the body is."""
    pairs = shapely.convex_hull(shapely.union(row[:-1], row[1:]))
    swept = shapely.buffer(shapely.union_all(pairs), KEEP_CLEAR_M, join_style="mitre")
    return swept if isinstance(swept, shapely.Polygon) else shapely.convex_hull(swept)


TOUCH_M2 = 0.01  # boxes that overlap by less only touch


def first_clash(head: ScenarioHead, spec: RecordingSpec) -> tuple[int, str] | None:
    """The first pair of bodies that overlap at any time of a recording, or a camera inside a body.

    Args:
        head: of the scenario: times and cameras.
        spec: the recording.

    Returns:
        Row of the actor to report, and who is inside whom and when; None if nothing overlaps.
    """
    trajectories = plan_trajectories(head, spec)
    times_ns = watched_times(trajectories)
    sizes_m = [box_size(actor.kind) for actor in spec.actors]
    ego, *movers = moving_outlines(trajectories, sizes_m)
    for number, actor in enumerate(spec.actors):
        if (at := _first_overlap(movers[number], ego)) is not None:
            return number, f"{actor.name!r} inside the ego vehicle at {_seconds(times_ns[at])}"
        for camera in head.cameras_of(spec):
            if (at := _first_inside(camera, ego, movers[number], sizes_m[number])) is not None:
                return number, f"the camera {camera.name!r} inside {actor.name!r} at {_seconds(times_ns[at])}"
    for one, other in combinations(range(len(movers)), 2):
        if (at := _first_overlap(movers[one], movers[other])) is not None:
            names = f"{spec.actors[other].name!r} inside {spec.actors[one].name!r}"
            return other, f"{names} at {_seconds(times_ns[at])}"
    return None


def camera_fault(camera: CameraSpec) -> str | None:
    """Fault in the position of a camera on the ego vehicle; None without one."""
    if camera.position_m[2] <= 0:
        return f"a camera {abs(camera.position_m[2]):g} m under the road"
    if _winding(own_body().corners_m, np.array(camera.position_m)) > 0.5:
        return "a camera inside the ego vehicle's own body"
    return None


@cache
def box_size(kind: str) -> NDArray[np.float64]:
    """(3,) float64, m: the box around a body of a kind; individual bodies differ by a centimetre or two."""
    return make_body(kind, named_rng(0, "box", kind)).size_m


def _first_overlap(one: MovingOutline, other: MovingOutline) -> int | None:
    """Row of the first time at which two footprints overlap by more than a touch."""
    apart_m = (one.poses.positions_m - other.poses.positions_m)[:, :2]
    reach_m = sum(float(np.linalg.norm(outline, axis=1).max()) for outline in (one.outline_m, other.outline_m))
    rows = np.flatnonzero(np.hypot(*apart_m.T) <= reach_m)  # elsewhere not even the circles around the outlines meet
    if rows.size == 0:
        return None
    shared = shapely.intersection(one.footprints(rows), other.footprints(rows))
    inside = rows[shapely.area(shared) > TOUCH_M2]
    return int(inside[0]) if inside.size else None


def _first_inside(
    camera: CameraSpec, ego: MovingOutline, other: MovingOutline, size_m: NDArray[np.float64]
) -> int | None:
    """Row of the first time at which a camera is inside the box around an actor."""
    cameras_world = ego.poses.rotations @ np.array(camera.position_m) + ego.poses.positions_m
    local_m = np.einsum("nji,nj->ni", other.poses.rotations, cameras_world - other.poses.positions_m)
    middle_m = np.array([0.0, 0.0, size_m[2] / 2])
    inside = np.flatnonzero((np.abs(local_m - middle_m) < size_m / 2).all(axis=1))
    return int(inside[0]) if inside.size else None


def _winding(corners_m: NDArray[np.float64], point_m: NDArray[np.float64]) -> float:
    """Winding number of closed surfaces around a point: about 0 outside all of them.

    Source:
        Van Oosterom and Strackee 1983, the solid angle of a plane triangle.
    """
    a, b, c = np.moveaxis(corners_m - point_m, 1, 0)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    triple = np.einsum("ni,ni->n", a, np.cross(b, c))
    dots = (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    return float(np.arctan2(triple, la * lb * lc + dots).sum() / (2 * np.pi))


def _seconds(time_ns: np.int64) -> str:
    return f"{time_ns / 1e9:.2f} s"


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
    """The light that a recording asks for; where the sun stands is drawn."""
    kind = KINDS[spec.kind]
    azimuth, elevation = np.radians(rng.uniform(0, 360)), np.radians(rng.uniform(*kind.elevations_deg))
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
        ego=ego_motion(trajectories.ego, scenario.vehicle.suspension, rng=named_rng(scenario.seed, spec.name, "road")),
        light=lighting(spec.light, named_rng(scenario.seed, spec.name, "light")),
        image_times_ns=trajectories.image_times_ns,
        sweep_times_ns=trajectories.sweep_times_ns,
    )
