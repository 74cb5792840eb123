"""Lidar sweeps: every column of beams at its own time, so that motion smears points as in a real sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.lidar import LidarSweep
from bench.synthesis.body import Body
from bench.synthesis.motion import SECOND_NS, ActorPath, HostPath, PlanarPoses
from bench.synthesis.ray_scene import RayScene
from bench.synthesis.scenario import LidarSpec

COLUMNS = 2083  # per revolution: 0.1728 degrees
# Velodyne's HDL-64E: an upper block a third of a degree apart and a lower block half a degree apart.
BEAMS_DEG = np.concatenate([np.linspace(2.0, -8.33, 32), np.linspace(-8.83, -24.8, 32)])
RESOLUTION_M = 1 / 512  # of stored coordinates, that of the real sensor's ranges; a power of two packs well
POSTURE_NS = 5_000_000  # an actor holds its posture this long; its place follows every column exactly


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Actor:
    """A body and its way.

    Attributes:
        name: of the track.
        instance_id: in truth images.
        body: its shape.
        path: its way.
        floor_m: height of the ground below it.
    """

    name: str
    instance_id: int
    body: Body
    path: ActorPath
    floor_m: float


class LidarScanner:
    """Scans the scene of one recording.

    The sweep's reference time is the middle of the revolution, when the beams look straight ahead; it starts and ends
    straight behind and turns clockwise.

    Args:
        spec: the sensor.
        vehicle_from_lidar: its mounting.
        static_scene: the static world, world frame.
        actors: everything else.
        host: the host's way.
    """

    def __init__(
        self,
        spec: LidarSpec,
        *,
        vehicle_from_lidar: RigidTransform,
        static_scene: RayScene,
        actors: Sequence[Actor],
        host: HostPath,
    ) -> None:
        self._spec, self._static, self._actors, self._host = spec, static_scene, actors, host
        self._vehicle_from_lidar = vehicle_from_lidar
        fractions = (np.arange(COLUMNS) + 0.5) / COLUMNS - 0.5
        fractions = fractions[np.abs(fractions) * 360.0 <= spec.sector_deg / 2]
        self._offsets_ns = np.rint(fractions * SECOND_NS / spec.rotation_hz).astype(np.int64)
        azimuths, elevations = -2 * np.pi * fractions[:, None], np.radians(BEAMS_DEG)[None, :]
        flat = np.cos(elevations)
        lifts = np.broadcast_to(np.sin(elevations), (len(fractions), len(BEAMS_DEG)))
        self._rays_lidar = np.stack([flat * np.cos(azimuths), flat * np.sin(azimuths), lifts], axis=-1)

    def scan(self, time_ns: int, *, timestamp_ns: int, rng: np.random.Generator) -> LidarSweep:
        """One revolution.

        Args:
            time_ns: its reference time, scene clock.
            timestamp_ns: the same on the recording's clock.
            rng: the range noise.
        """
        times_ns = time_ns + self._offsets_ns
        host = self._host.at(times_ns)
        rays_vehicle = self._vehicle_from_lidar.rotate(self._rays_lidar)
        rays_world = _turned(rays_vehicle, host.yaws_rad)
        mounting_m = np.tile(self._vehicle_from_lidar.translation_m, (len(times_ns), 1, 1))
        origins_m = _turned(mounting_m, host.yaws_rad)[:, 0]
        origins_m[:, :2] += host.positions_m
        ranges_m = _cast(self._static, origins_m, rays_world)
        for actor in self._actors:
            np.minimum(ranges_m, self._actor_ranges(actor, times_ns, origins_m, rays_world), out=ranges_m)
        ranges_m += rng.standard_normal(ranges_m.shape) * self._spec.range_noise_m
        columns, rings = np.nonzero(ranges_m <= self._spec.max_range_m)
        points = self._rays_lidar[columns, rings] * ranges_m[columns, rings, None]
        return LidarSweep(
            timestamp_ns=timestamp_ns,
            points_lidar=(np.rint(points / RESOLUTION_M) * RESOLUTION_M).astype(np.float32),
            time_offset_ns=self._offsets_ns[columns],
            ring=rings.astype(np.uint8),
        )

    def _actor_ranges(
        self,
        actor: Actor,
        times_ns: NDArray[np.int64],
        origins_m: NDArray[np.float64],
        rays_world: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Range of each ray to one actor, the ray taken into the actor's frame at its own time."""
        ranges_m = np.full(rays_world.shape[:2], np.inf)
        poses = actor.path.at(times_ns)
        offsets_m = (origins_m - np.column_stack([poses.positions_m, np.full(len(times_ns), actor.floor_m)]))[:, None]
        origins_object = _turned(offsets_m, -poses.yaws_rad)[:, 0]
        rays_object = _turned(rays_world, -poses.yaws_rad)
        near = np.flatnonzero(_may_meet(origins_object, rays_object[:, 0], float(np.hypot(*actor.body.size_m[:2])) / 2))
        for block in _blocks(times_ns[near]):
            columns = near[block]
            scene = RayScene(actor.body.corners_at(_middle_way_m(poses, columns)))
            ranges_m[columns] = _cast(scene, origins_object[columns], rays_object[columns])
        return ranges_m


def _turned(vectors: NDArray[np.float64], yaws_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """(C, B, 3) vectors turned about z by one angle for each column."""
    cosine, sine = np.cos(yaws_rad)[:, None], np.sin(yaws_rad)[:, None]
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, vectors[..., 2]], axis=-1)


def _cast(scene: RayScene, origins_m: NDArray[np.float64], rays: NDArray[np.float64]) -> NDArray[np.float64]:
    starts = np.repeat(origins_m, rays.shape[1], axis=0)
    return scene.cast(rays.reshape(-1, 3), starts).distances_m.reshape(rays.shape[:2]).astype(np.float64)


def _may_meet(origins_m: NDArray[np.float64], rays: NDArray[np.float64], radius_m: float) -> NDArray[np.bool_]:
    """Columns whose vertical plane passes a circle about the object's origin, ahead of the sensor."""
    flat = rays[:, :2] / np.linalg.norm(rays[:, :2], axis=1, keepdims=True)
    aside = flat[:, 0] * origins_m[:, 1] - flat[:, 1] * origins_m[:, 0]
    ahead = -(flat * origins_m[:, :2]).sum(axis=1)
    return np.asarray((np.abs(aside) <= radius_m) & (ahead >= -radius_m))


def _blocks(times_ns: NDArray[np.int64]) -> list[NDArray[np.intp]]:
    """Rows of the times that share a posture."""
    if not times_ns.size:
        return []
    cuts = np.flatnonzero(np.diff(times_ns // POSTURE_NS)) + 1
    return list(np.split(np.arange(len(times_ns)), cuts))


def _middle_way_m(poses: PlanarPoses, columns: NDArray[np.intp]) -> float:
    return float(poses.distances_m[columns].mean())
