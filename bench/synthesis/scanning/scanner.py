"""Lidar sweeps: every column of beams at its own time, so that motion smears points as in a real sensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.lidar import LidarSweep
from bench.synthesis.driving.motion import HostMotion
from bench.synthesis.mesh import Mesh
from bench.synthesis.ray_scene import RayScene
from bench.synthesis.scanning.beams import revolution
from bench.synthesis.scanning.echoes import Echoes, detected
from bench.synthesis.scenario import LidarSpec
from bench.synthesis.stage import Actor

RESOLUTION_M = 1 / 256  # of stored coordinates: 1 mm rms beside 20 mm of range noise; a power of two packs well
POSTURE_NS = 5_000_000  # an actor holds its posture this long; its place follows every column exactly


class LidarScanner:
    """Scans the scene of one recording.

    The sweep's reference time is the middle of the revolution, when the beams look straight ahead; it starts and ends
    straight behind and turns clockwise. Beams that meet the host itself give no points, as drivers of such sensors
    are set up.

    Args:
        spec: the sensor.
        vehicle_from_lidar: its mounting.
        world: the static world, world frame.
        own_body: the host, vehicle frame.
        actors: everything else.
        host: the host's motion.
    """

    def __init__(
        self,
        spec: LidarSpec,
        *,
        vehicle_from_lidar: RigidTransform,
        world: Mesh,
        own_body: Mesh,
        actors: Sequence[Actor],
        host: HostMotion,
    ) -> None:
        self._spec, self._actors, self._host = spec, actors, host
        self._world, self._static = world, RayScene(world.corners_m)
        self._vehicle_from_lidar = vehicle_from_lidar
        self._beams = revolution(spec)
        own = RayScene(own_body.moved(vehicle_from_lidar.inverse()).corners_m)
        self._free = ~np.isfinite(own.cast(self._beams.rays_lidar.reshape(-1, 3)).distances_m)

    def scan(self, time_ns: int, *, timestamp_ns: int, rng: np.random.Generator) -> LidarSweep:
        """One revolution.

        Args:
            time_ns: its reference time, scene clock.
            timestamp_ns: the same on the recording's clock.
            rng: lost pulses and range noise.
        """
        offsets_ns, rays_lidar = self._beams.offsets_ns, self._beams.rays_lidar
        times_ns = time_ns + offsets_ns
        host = self._host.at(times_ns)
        rotations = (host.rotations @ self._vehicle_from_lidar.rotation).astype(np.float32)
        rays_world = rays_lidar @ rotations.transpose(0, 2, 1)
        origins_m = host.rotations @ self._vehicle_from_lidar.translation_m + host.positions_m
        echoes = Echoes(rays_world.shape[0] * rays_world.shape[1], self._spec.max_range_m)
        self._add_world(echoes, rays_world, origins_m)
        for actor in self._actors:
            _add_actor(echoes, actor, times_ns, rays_world, origins_m)
        found, intensities = detected(echoes, self._spec, rng)
        noise_m = rng.standard_normal(len(found), dtype=np.float32) * np.float32(self._spec.range_noise_m)
        rows = np.flatnonzero(found & self._free)
        points = rays_lidar.reshape(-1, 3)[rows] * (echoes.ranges_m + noise_m)[rows, None]
        columns, rings = np.divmod(rows, rays_lidar.shape[1])
        rounded = np.rint(points / np.float32(RESOLUTION_M)) * np.float32(RESOLUTION_M)
        return LidarSweep(
            timestamp_ns=timestamp_ns,
            points_lidar=np.asfortranarray(rounded),  # x, y and z apart take a fifth less on disk
            time_offset_ns=offsets_ns[columns],
            intensity=intensities[rows],
            ring=rings.astype(np.uint8),
        )

    def _add_world(self, echoes: Echoes, rays_world: NDArray[np.float32], origins_m: NDArray[np.float64]) -> None:
        rays = rays_world.reshape(-1, 3)
        origins = np.repeat(origins_m.astype(np.float32), rays_world.shape[1], axis=0)
        echoes.add(self._static, self._world.surfaces, rows=np.arange(len(rays)), rays=rays, origins_m=origins)


def _add_actor(
    echoes: Echoes,
    actor: Actor,
    times_ns: NDArray[np.int64],
    rays_world: NDArray[np.float32],
    origins_m: NDArray[np.float64],
) -> None:
    """Cast the rays that may meet an actor, each taken into the actor's frame at its own time."""
    poses, (speeds_mps, _) = actor.path.at(times_ns), actor.path.signals(times_ns)
    origins_object = np.einsum("cji,cj->ci", poses.rotations, origins_m - poses.positions_m)
    middle_m = np.array([0.0, 0.0, actor.body.size_m[2] / 2])
    near = _may_meet(origins_object - middle_m, rays_world @ poses.rotations.astype(np.float32), actor.body.size_m)
    columns, _ = np.divmod(rows := np.flatnonzero(near), rays_world.shape[1])
    rays = np.einsum("nji,nj->ni", poses.rotations[columns], rays_world.reshape(-1, 3)[rows]).astype(np.float32)
    for block in _blocks(times_ns[columns]):
        way_m, speed_mps = (float(values[columns[block]].mean()) for values in (poses.distances_m, speeds_mps))
        echoes.add(
            RayScene(actor.body.corners_at(way_m, speed_mps=speed_mps)),
            actor.body.mesh.surfaces,
            rows=rows[block],
            rays=rays[block],
            origins_m=origins_object[columns[block]].astype(np.float32),
        )


def _may_meet(
    origins_m: NDArray[np.float64], rays: NDArray[np.float32], size_m: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Rays, (C, 64), that pass the ball around the box of a body, seen from its middle."""
    along = (rays @ origins_m.astype(np.float32)[:, :, None])[..., 0]
    away = np.asarray((origins_m**2).sum(axis=1) - (size_m**2).sum() / 4, dtype=np.float32)[:, None]
    return np.asarray((away <= along**2) & ((along <= 0) | (away <= 0)))


def _blocks(times_ns: NDArray[np.int64]) -> list[NDArray[np.intp]]:
    """Rows of the times, which increase, that share a posture."""
    if not times_ns.size:
        return []
    cuts = np.flatnonzero(np.diff(times_ns // POSTURE_NS)) + 1
    return list(np.split(np.arange(len(times_ns)), cuts))
