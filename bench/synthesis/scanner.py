"""Lidar sweeps: every column of beams at its own time, so that motion smears points as in a real sensor.

All of it is computed in double precision, and rounded where it is stored: to 1/256 m and to 32 intensities. The last
bits of a product or an exponential depend on the processor; those of double precision decide a rounding once in 10^11.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform, dot
from bench.lidar.sweep import LidarSweep
from bench.synthesis.ego import own_body
from bench.synthesis.mesh import COLUMN_OF, Mesh
from bench.synthesis.motion import EgoMotion
from bench.synthesis.rays import RayScene, depths_m
from bench.synthesis.scenario import LidarSpec, RecordingSpec, Scenario, named_rng
from bench.synthesis.scene import FIRST_IMAGE_NS, Actor, Scene
from bench.times import SECOND_NS

FIRINGS_PER_S = 20_833  # of all 64 lasers: 2083 columns, 0.1728 degrees apart, at 10 Hz
# HDL-64E S2, user's manual: an upper block from 2 to -8.33 degrees, a third of a degree apart, and a lower block from
# -8.83 to -24.33 degrees, half a degree apart.
BEAMS_DEG = np.concatenate([2.0 - np.arange(32) / 3, -8.83 - np.arange(32) / 2])
# Where its lasers sit and look, from the calibration of one sensor that the ROS driver ships (ros-drivers/velodyne,
# velodyne_pointcloud/params/64e_s2.1-sztaki.yaml): vert_offset_correction, 0.193 to 0.213 m in the upper and 0.105 to
# 0.122 m in the lower block, by straight lines over vert_correction to within 1 mm; horiz_offset_correction, 26 mm to
# either side in turn; rot_correction, six steps to the right from row to row and back, to within 0.02 rad. The beams of
# KITTI-360's sensor start as high, 0.198 to 0.209 and 0.116 to 0.126 m.
UPPER_M, UPPER_M_PER_RAD, LOWER_M, LOWER_M_PER_RAD = 0.2065, 0.0725, 0.135, 0.069
ASIDE_M = 0.026
TURN_RAD, TURNS = 0.057, 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beams:
    """One revolution: C columns of 64 beams.

    Attributes:
        offsets_ns: (C,) int64, time of each column after the middle of the revolution.
        rays_lidar: (C, 64, 3) float64, unit length, lidar frame.
        starts_lidar: (C, 64, 3) float64, m, where they start, lidar frame.
    """

    offsets_ns: NDArray[np.int64]
    rays_lidar: NDArray[np.float64]
    starts_lidar: NDArray[np.float64]


def revolution(spec: LidarSpec) -> Beams:
    """The beams of a revolution that starts and ends straight behind, turns clockwise and looks ahead in its middle.

    Columns outside of the stored sector are left out.
    """
    columns = max(1, round(FIRINGS_PER_S / spec.rotation_hz))
    fractions = (np.arange(columns) + 0.5) / columns - 0.5
    fractions = fractions[np.abs(fractions) * 360.0 <= spec.sector_deg / 2]
    azimuths, elevations = -2 * np.pi * fractions[:, None], np.radians(BEAMS_DEG)[None, :]
    rows = np.arange(len(BEAMS_DEG))
    heights_m, aside_m = np.zeros((2, len(rows)))
    if spec.beams == "two_blocks":
        azimuths = azimuths + TURN_RAD * ((TURNS - 1) / 2 - (rows + 2) % TURNS)
        upper, lower = UPPER_M + UPPER_M_PER_RAD * elevations[0], LOWER_M + LOWER_M_PER_RAD * elevations[0]
        heights_m = np.where(rows < len(rows) // 2, upper, lower)
        aside_m = np.where(rows % 2, ASIDE_M, -ASIDE_M)
    flat, ahead, left = np.cos(elevations), np.cos(azimuths), np.sin(azimuths)
    shape = len(fractions), len(rows)
    return Beams(
        offsets_ns=np.rint(fractions * SECOND_NS / spec.rotation_hz).astype(np.int64),
        rays_lidar=np.stack([flat * ahead, flat * left, np.broadcast_to(np.sin(elevations), shape)], axis=-1),
        starts_lidar=np.stack([-left * aside_m, ahead * aside_m, np.broadcast_to(heights_m, shape)], axis=-1),
    )


# A surface that mirrors, is itself dark and yet uneven is a pane: what is seen of it lies behind. Black gloss paint is
# dark and mirrors too, but it is even.
PANE_MIRROR, PANE_ALBEDO, PANE_CONTRAST = 0.03, 0.15, 0.2
STEPS = 32  # of stored intensities: the sensor has 256, of which fading leaves no more than these
FADING = 0.5  # standard deviation of the logarithm of a return: speckle and texture finer than the beam's spot


class Echoes:
    """The nearest surface on each of N rays, found scene by scene.

    Args:
        rays: N.
        within_m: surfaces further away are not seen.

    Attributes:
        ranges_m: (N,) float64; infinite where there is none.
        cosines: (N,) float64, of the angle between ray and surface normal.
        albedos: (N,) float64.
        mirrors: (N,) float64, as `Surface.mirror`.
        panes: (N,) bool, whether it is a pane of glass.
    """

    def __init__(self, rays: int, within_m: float) -> None:
        self._within_m = within_m
        self.ranges_m = np.full(rays, np.inf)
        self.cosines, self.albedos, self.mirrors = np.zeros((3, rays))
        self.panes = np.zeros(rays, dtype=bool)

    def add(
        self,
        scene: RayScene,
        surfaces: NDArray[np.float64],
        *,
        rows: NDArray[np.intp],
        rays: NDArray[np.float64],
        origins_m: NDArray[np.float64],
    ) -> None:
        """Cast some of the rays on a further scene and keep what is nearer.

        Args:
            scene: its triangles.
            surfaces: (T, F), of its triangles, as `Mesh.surfaces`.
            rows: (M,) which rays.
            rays: (M, 3), unit length, frame of the scene.
            origins_m: (M, 3), m, frame of the scene.
        """
        hits = scene.cast(rays, origins_m)
        sky = surfaces[:, COLUMN_OF["sky"]] != 0
        nearer = np.flatnonzero(hits.distances_m < np.minimum(self.ranges_m[rows], self._within_m))
        faces = hits.triangles[nearer]
        if sky.any():
            nearer, faces = nearer[~sky[faces]], faces[~sky[faces]]
        into = rows[nearer]
        self.ranges_m[into] = hits.distances_m[nearer]
        self.cosines[into] = np.abs(dot(hits.normals[nearer], rays[nearer]))
        self.albedos[into] = surfaces[faces, COLUMN_OF["albedo"]]
        self.mirrors[into] = surfaces[faces, COLUMN_OF["mirror"]]
        self.panes[into] = _are_panes(surfaces)[faces]

    def reflectances(self) -> NDArray[np.float64]:
        """(N,) float64: the share of the light that is scattered back, before the distance weakens it.

        Lambert's cosine of what the surface scatters; a mirroring coat lets less light in and out the flatter it is
        hit (Schlick's approximation of Fresnel's equations).
        """
        scattered = self.albedos * self.cosines
        coated = np.flatnonzero(self.mirrors)
        passed = (1 - self.mirrors[coated]) * (1 - (1 - self.cosines[coated]) ** 5)
        scattered[coated] *= passed**2
        return scattered


def _are_panes(surfaces: NDArray[np.float64]) -> NDArray[np.bool_]:
    mirror, albedo, contrast = (surfaces[:, COLUMN_OF[name]] for name in ("mirror", "albedo", "contrast"))
    return np.asarray((mirror >= PANE_MIRROR) & (albedo <= PANE_ALBEDO) & (contrast >= PANE_CONTRAST))


def detected(
    echoes: Echoes, spec: LidarSpec, rng: np.random.Generator
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Mask of the pulses that come back strong enough.

    Args:
        echoes: of N rays.
        spec: of the sensor.
        rng: fading, and where panes are dusty.

    Returns:
        returned: (N,) bool.
        intensities: (N,) float32 in [0, 1], the faded reflectance, in 32 steps.
    """
    speckle = rng.standard_normal(len(echoes.ranges_m), dtype=np.float32).astype(np.float64)
    faded = echoes.reflectances() * np.exp(FADING * speckle)
    dusty = rng.random(len(faded), dtype=np.float32) < spec.pane_returns * echoes.cosines
    returned = np.isfinite(echoes.ranges_m)
    weakest = spec.weakest_return_per_m2 * echoes.ranges_m[returned] ** 2
    returned[returned] = faded[returned] >= np.maximum(weakest, spec.weakest_reflectance)
    returned &= dusty | ~echoes.panes
    return returned, (np.rint(np.minimum(faded, 1.0) * (STEPS - 1)) / (STEPS - 1)).astype(np.float32)


RESOLUTION_M = 1 / 256  # of stored coordinates: 1 mm rms beside 20 mm of range noise; a power of two packs well
POSTURE_NS = 5_000_000  # an actor holds its posture this long; its position follows every column exactly


class LidarScanner:
    """Scans the scene of one recording.

    The sweep's reference time is the middle of the revolution, when the beams look straight ahead; it starts and ends
    straight behind and turns clockwise. Beams that hit the ego vehicle itself give no points, as drivers of such
    sensors are set up.

    Args:
        spec: the sensor.
        vehicle_from_lidar: its mounting.
        world: the static world, world frame.
        own_body: the ego vehicle, vehicle frame.
        actors: everything else.
        ego: the ego vehicle's motion.
    """

    def __init__(
        self,
        spec: LidarSpec,
        *,
        vehicle_from_lidar: RigidTransform,
        world: Mesh,
        own_body: Mesh,
        actors: Sequence[Actor],
        ego: EgoMotion,
    ) -> None:
        self._spec, self._actors, self._ego = spec, actors, ego
        self._world, self._static = world, RayScene(world.corners_m, depths_m(world))
        self._depths_m = [depths_m(actor.body.mesh) for actor in actors]
        self._vehicle_from_lidar = vehicle_from_lidar
        self._beams = revolution(spec)
        own = RayScene(own_body.moved(vehicle_from_lidar.inverse()).corners_m)
        rays_lidar, starts_lidar = self._beams.rays_lidar.reshape(-1, 3), self._beams.starts_lidar.reshape(-1, 3)
        self._free = ~np.isfinite(own.cast(rays_lidar, starts_lidar).distances_m)

    def scan(self, time_ns: int, *, timestamp_ns: int, rng: np.random.Generator) -> LidarSweep:
        """One revolution.

        Args:
            time_ns: its reference time, scene clock.
            timestamp_ns: the same on the recording's clock.
            rng: lost pulses and range noise.
        """
        offsets_ns, rays_lidar = self._beams.offsets_ns, self._beams.rays_lidar
        times_ns = time_ns + offsets_ns
        ego = self._ego.at(times_ns)
        lidar_from_world = (ego.rotations @ self._vehicle_from_lidar.rotation).transpose(0, 2, 1)
        rays_world, starts_world = rays_lidar @ lidar_from_world, self._beams.starts_lidar @ lidar_from_world
        origins_m = ego.rotations @ self._vehicle_from_lidar.translation_m + ego.positions_m
        rays = rays_world.reshape(-1, 3)
        echoes = Echoes(len(rays), self._spec.max_range_m)
        ray_origins_m = (origins_m[:, None] + starts_world).reshape(-1, 3)
        everything = np.arange(len(rays))
        echoes.add(self._static, self._world.surfaces, rows=everything, rays=rays, origins_m=ray_origins_m)
        for actor, actor_depths_m in zip(self._actors, self._depths_m, strict=True):
            _add_actor(echoes, actor, actor_depths_m, times_ns, rays_world, origins_m, starts_world)
        returned, intensities = detected(echoes, self._spec, rng)
        noise_m = rng.standard_normal(len(returned), dtype=np.float32) * self._spec.range_noise_m
        rows = np.flatnonzero(returned & self._free)
        points = rays_lidar.reshape(-1, 3)[rows] * (echoes.ranges_m + noise_m)[rows, None]
        if self._spec.beams != "one_origin":  # where it is, -0.0 + 0.0 would be another byte
            points += self._beams.starts_lidar.reshape(-1, 3)[rows]
        columns, rings = np.divmod(rows, rays_lidar.shape[1])
        rounded = (np.rint(points / RESOLUTION_M) * RESOLUTION_M).astype(np.float32)
        return LidarSweep(
            timestamp_ns=timestamp_ns,
            points_lidar=np.asfortranarray(rounded),  # x, y and z apart take a fifth less on disk
            time_offset_ns=offsets_ns[columns],
            intensity=intensities[rows],
            ring=rings.astype(np.uint8),
        )


def _add_actor(
    echoes: Echoes,
    actor: Actor,
    body_depths_m: NDArray[np.float64],
    times_ns: NDArray[np.int64],
    rays_world: NDArray[np.float64],
    origins_m: NDArray[np.float64],
    starts_world: NDArray[np.float64],
) -> None:
    """Cast the rays that may meet an actor, each taken into the actor's frame at its own time."""
    poses, (speeds_mps, _) = actor.path.at(times_ns), actor.path.signals(times_ns)
    origins_object = np.einsum("cji,cj->ci", poses.rotations, origins_m - poses.positions_m)
    middle_m = np.array([0.0, 0.0, actor.body.size_m[2] / 2])
    apart_m = float(np.sqrt(dot(starts_world, starts_world).max()))
    near = _may_meet(origins_object - middle_m, rays_world @ poses.rotations, actor.body.size_m, apart_m)
    columns, _ = np.divmod(rows := np.flatnonzero(near), rays_world.shape[1])
    rays, starts = (
        np.einsum("nji,nj->ni", poses.rotations[columns], vectors.reshape(-1, 3)[rows])
        for vectors in (rays_world, starts_world)
    )
    for block in _blocks(times_ns[columns]):
        distance_m, speed_mps = (float(values[columns[block]].mean()) for values in (poses.distances_m, speeds_mps))
        echoes.add(
            RayScene(actor.body.corners_at(distance_m, speed_mps=speed_mps), body_depths_m),
            actor.body.mesh.surfaces,
            rows=rows[block],
            rays=rays[block],
            origins_m=origins_object[columns[block]] + starts[block],
        )


def _may_meet(
    origins_m: NDArray[np.float64], rays: NDArray[np.float64], size_m: NDArray[np.float64], apart_m: float
) -> NDArray[np.bool_]:
    """Rays, (C, 64), that pass the ball around the box of a body, seen from its middle, no farther than they start from
    their origins."""
    along = (rays @ origins_m[:, :, None])[..., 0]
    away = ((origins_m**2).sum(axis=1) - (np.sqrt((size_m**2).sum() / 4) + apart_m) ** 2)[:, None]
    return np.asarray((away <= along**2) & ((along <= 0) | (away <= 0)))


def _blocks(times_ns: NDArray[np.int64]) -> list[NDArray[np.intp]]:
    """Rows of the times, which increase, that share a posture."""
    if not times_ns.size:
        return []
    cuts = np.flatnonzero(np.diff(times_ns // POSTURE_NS)) + 1
    return list(np.split(np.arange(len(times_ns)), cuts))


def scans(
    scenario: Scenario, spec: RecordingSpec, scene: Scene, *, vehicle_from_lidar: RigidTransform
) -> Iterator[LidarSweep]:
    """Every revolution of a recording, by the recording's clock."""
    scanner = LidarScanner(
        scenario.lidar,
        vehicle_from_lidar=vehicle_from_lidar,
        world=scene.world,
        own_body=own_body(),
        actors=scene.actors,
        ego=scene.ego,
    )
    for number, time_ns in enumerate(scene.sweep_times_ns.tolist()):
        rng = named_rng(scenario.seed, spec.name, "lidar", number)
        yield scanner.scan(time_ns, timestamp_ns=time_ns + FIRST_IMAGE_NS, rng=rng)
