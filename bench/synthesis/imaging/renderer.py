"""Images: one ray per pixel, and four where an edge runs through it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.recordings.records import MountedCamera
from bench.synthesis.imaging.blur import Shutter, blurred, image_ways
from bench.synthesis.imaging.faces import GLOW, Faces, faces_of
from bench.synthesis.imaging.lamps import NO_LAMPS, Headlights, lamp_faces, street_lamps_m
from bench.synthesis.imaging.lens import lens_of
from bench.synthesis.imaging.sensor import Sensor
from bench.synthesis.imaging.shading import NOTHING, Scene, shade, smooth_edges
from bench.synthesis.imaging.shadows import Shadows
from bench.synthesis.imaging.sky import Sky
from bench.synthesis.imaging.textures import TextureAtlas
from bench.synthesis.imaging.visibility import draw, find_planes
from bench.synthesis.lighting import Lighting
from bench.synthesis.mesh import Mesh, PlacedMesh
from bench.synthesis.scenario import SensorSpec


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RenderedImage:
    """What a camera sees.

    Attributes:
        pixels: (H, W) uint8; 0 where the lens sees nothing.
        instance_ids: (H, W) uint16, of what each pixel's centre sees in the middle of the exposure; 0 for the static
            world, the sky, the host's own body and invalid pixels.
        distances_m: (H, W) float32 along each ray; infinite in the sky.
    """

    pixels: NDArray[np.uint8]
    instance_ids: NDArray[np.uint16]
    distances_m: NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moment:
    """Where everything is at some time.

    Attributes:
        placed: everything that moves, but the host; the same bodies at every time.
        world_from_vehicle: the host.
    """

    placed: Sequence[PlacedMesh]
    world_from_vehicle: RigidTransform


class ImageRenderer:
    """Renders one camera.

    Args:
        camera: on the host.
        own_body: what the camera may see of the host, and what throws its shadow, vehicle frame.
        world: the static world, world frame.
        atlas: the texture of every surface.
        light: sun, clouds or night.
        sensor: how the camera errs.
    """

    def __init__(
        self,
        camera: MountedCamera,
        *,
        own_body: Mesh,
        world: Mesh,
        atlas: TextureAtlas,
        light: Lighting,
        sensor: SensorSpec,
    ) -> None:
        self._camera, self._own_body, self._atlas, self._light = camera, own_body, atlas, light
        self._lens = lens_of(camera.model)
        self._world = faces_of(world)
        self._sensor = Sensor(sensor, self._lens, gain=light.gain)
        self._shadows = Shadows(self._world.corners_m, light)
        self._sky = Sky(light.horizon, light.zenith, light.cloud, light.sun_glow, light.towards_sun)
        self._headlights = Headlights() if light.night else None
        self._street_lamps_m = street_lamps_m(self._world)
        if not light.night:
            self._world.rows[lamp_faces(self._world), GLOW] = 0.0  # switched off

    def render(
        self,
        middle: Moment,
        *,
        rng: np.random.Generator,
        shutter: tuple[Moment, Moment] | None = None,
    ) -> RenderedImage:
        """Render one image.

        Args:
            middle: the scene in the middle of the exposure.
            rng: the sensor noise.
            shutter: the scene when the shutter opens and closes; None for a still.
        """
        lens = self._lens
        shape = lens.valid.shape[0], lens.valid.shape[1]
        bodies = [faces_of(mesh) for mesh in self._meshes(middle)]
        corners = np.concatenate([self._world.corners_m, *(body.corners_m for body in bodies)])
        rows = np.concatenate([self._world.rows, *(body.rows for body in bodies)])
        world_from_camera = middle.world_from_vehicle @ self._camera.vehicle_from_camera
        turn, origin_m = np.ascontiguousarray(world_from_camera.rotation), world_from_camera.translation_m
        planes = np.zeros((len(corners), 9), dtype=np.float32)
        boxes = np.zeros((len(corners), 4), dtype=np.int16)
        nearness, triangles = np.zeros(shape, dtype=np.float32), np.full(shape, NOTHING, dtype=np.int32)
        find_planes(
            corners, turn.T.copy(), origin_m, lens.chart, lens.px_per_rad, lens.widest_rad, shape, planes, boxes
        )
        farthest = np.zeros(lens.tiles.shape[:2], dtype=np.float32)
        draw(planes, boxes, lens.rays, lens.regions, lens.blocks, lens.tiles, nearness, triangles, farthest)
        grey = self._shaded(triangles, planes, rows, corners, bodies, middle, turn, origin_m)
        if shutter is not None:
            ways = np.empty((*shape, 2), dtype=np.float32)
            moving = self._shutter(shutter)
            place, moved = np.empty((2, 3)), np.empty((2, 3))
            image_ways(
                triangles, lens.valid, lens.rays, lens.across, planes, turn, origin_m, moving, ways, place, moved
            )
            grey = blurred(grey, ways, lens.valid)
        ids = np.repeat(
            np.array([0, *(part.instance_id for part in middle.placed), 0], dtype=np.uint16),
            [len(self._world.corners_m), *(len(body.corners_m) for body in bodies)],
        )
        return RenderedImage(
            pixels=self._sensor.expose(grey, rng),
            instance_ids=np.where(triangles == NOTHING, np.uint16(0), ids[triangles]),
            distances_m=np.divide(
                np.float32(1.0), nearness, out=np.full(shape, np.inf, np.float32), where=nearness > 0
            ),
        )

    def _shaded(
        self,
        triangles: NDArray[np.int32],
        planes: NDArray[np.float32],
        rows: NDArray[np.float32],
        corners: NDArray[np.float64],
        bodies: Sequence[Faces],
        middle: Moment,
        turn: NDArray[np.float64],
        origin_m: NDArray[np.float64],
    ) -> NDArray[np.float32]:
        """Grey values, 1 is white, with smooth edges."""
        lens, light, lamps = self._lens, self._light, NO_LAMPS
        if self._headlights is not None:
            others = corners[: len(corners) - len(bodies[-1].corners_m)]
            lamps = self._headlights.lamps(others, self._street_lamps_m, middle.world_from_vehicle)
        with self._shadows.around(origin_m, [body.corners_m for body in bodies]) as (near, far, cover):
            scene = Scene(
                rows, turn, origin_m, light.towards_sun, light.sun_light, light.sky_light, near, far, cover, self._sky,
                lamps, light.night, self._atlas.image, self._atlas.layout,
            )  # fmt: skip
            centre = np.zeros(triangles.shape, dtype=np.float32)
            shade(triangles, lens.valid, lens.rays, lens.pixel_rad, planes, scene, centre)
            grey = centre.copy()
            known, weights, seen = np.empty(9, np.int32), np.empty(9, np.float32), np.empty((9, 3), np.float32)
            steps = lens.along_u, lens.along_v
            smooth_edges(
                triangles,
                lens.valid,
                lens.rays,
                *steps,
                lens.pixel_rad,
                planes,
                scene,
                centre,
                grey,
                known,
                weights,
                seen,
            )
        return grey

    def _shutter(self, shutter: tuple[Moment, Moment]) -> Shutter:
        cameras = [moment.world_from_vehicle @ self._camera.vehicle_from_camera for moment in shutter]
        return Shutter(
            np.stack([camera.rotation.T for camera in cameras]),
            np.stack([camera.translation_m for camera in cameras]),
            len(self._world.corners_m),
            np.stack([np.concatenate([mesh.corners_m for mesh in self._meshes(moment)]) for moment in shutter]),
        )

    def _meshes(self, moment: Moment) -> list[Mesh]:
        """Everything that moves, the host last."""
        return [*(part.mesh for part in moment.placed), self._own_body.moved(moment.world_from_vehicle)]
