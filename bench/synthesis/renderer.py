"""Images: one ray per pixel, and four where an edge runs through it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras import ray_grid
from bench.geometry import RigidTransform
from bench.recordings.records import MountedCamera
from bench.synthesis.mesh import Mesh, joined
from bench.synthesis.shading import Shader
from bench.synthesis.textures import TextureAtlas

EDGE_STEP = 0.02  # of white, between neighbours without their texture: an edge worth four rays
QUARTERS = tuple((u, v) for u in (-0.25, 0.25) for v in (-0.25, 0.25))  # px, centres of a pixel's quarters


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacedMesh:
    """A mesh at the time of an image.

    Attributes:
        mesh: world frame.
        instance_id: in truth images; 0 for the static world.
    """

    mesh: Mesh
    instance_id: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RenderedImage:
    """What a camera sees.

    Attributes:
        pixels: (H, W) uint8; 0 where the lens sees nothing.
        instance_ids: (H, W) uint16, of what each pixel's centre sees; 0 for the static world, the host's own body and
            invalid pixels.
        distances_m: (H, W) float32 along each ray; infinite where it meets nothing.
    """

    pixels: NDArray[np.uint8]
    instance_ids: NDArray[np.uint16]
    distances_m: NDArray[np.float32]


class ImageRenderer:
    """Renders one camera.

    Args:
        camera: on the host.
        own_body: what the camera may see of the host, and what throws its shadow, vehicle frame.
        atlas: the texture of every surface.
        sun_world: (3,) unit vector to the sun.
        noise_grey: standard deviation of the sensor noise.
    """

    def __init__(
        self,
        camera: MountedCamera,
        *,
        own_body: Mesh,
        atlas: TextureAtlas,
        sun_world: NDArray[np.float64],
        noise_grey: float,
    ) -> None:
        self._camera, self._own_body = camera, PlacedMesh(mesh=own_body)
        self._atlas, self._sun_world, self._noise_grey = atlas, sun_world, noise_grey
        grid = ray_grid(camera.model)
        self._valid = grid.valid
        self._rays_camera = np.where(grid.valid[..., None], grid.rays_camera, (0.0, 0.0, 1.0)).astype(np.float32)
        self._along_u, self._along_v = _steps(grid.rays_camera, axis=1), _steps(grid.rays_camera, axis=0)
        self._pixel_rad = np.maximum(np.linalg.norm(self._along_u, axis=2), np.float32(1e-6))

    def render(
        self, placed: Sequence[PlacedMesh], *, world_from_vehicle: RigidTransform, rng: np.random.Generator
    ) -> RenderedImage:
        """Render one image.

        Args:
            placed: everything but the host.
            world_from_vehicle: the host at the time of exposure.
            rng: the sensor noise.
        """
        everything = [*placed, PlacedMesh(mesh=self._own_body.mesh.moved(world_from_vehicle))]
        ids = np.repeat([part.instance_id for part in everything], [len(p.mesh.corners_m) for p in everything])
        world_from_camera = world_from_vehicle @ self._camera.vehicle_from_camera
        # Axes of the world, where streets lie along the axes and Embree's boxes fit, with the camera at the origin.
        centred = RigidTransform(np.eye(3), -world_from_camera.translation_m)
        mesh = joined([part.mesh for part in everything]).moved(centred)
        shader = Shader(mesh, atlas=self._atlas, sun=self._sun_world)
        turn = world_from_camera.rotation.T.astype(np.float32)
        seen = shader.shade(self._rays_camera @ turn, self._pixel_rad)
        grey = seen.grey
        edges = np.nonzero(_edges(seen.plain) & self._valid)
        if len(edges[0]):
            grey[edges] = self._quartered(shader, turn, edges)
        noise = rng.standard_normal(grey.shape, dtype=np.float32) * np.float32(self._noise_grey)
        pixels = np.clip(np.rint(np.float32(255.0) * grey + noise), 0, 255)
        met = self._valid & np.isfinite(seen.distances_m)
        return RenderedImage(
            pixels=np.where(met, pixels, 0).astype(np.uint8),
            instance_ids=np.where(met, ids[seen.triangles], 0).astype(np.uint16),
            distances_m=np.where(met, seen.distances_m, np.float32(np.inf)),
        )

    def _quartered(
        self, shader: Shader, turn: NDArray[np.float32], pixels: tuple[NDArray[np.intp], ...]
    ) -> NDArray[np.float32]:
        """Mean grey over the quarters of some pixels."""
        middle, along_u, along_v = (a[pixels] for a in (self._rays_camera, self._along_u, self._along_v))
        rays = np.concatenate([middle + np.float32(u) * along_u + np.float32(v) * along_v for u, v in QUARTERS])
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        pixel_rad = np.tile(self._pixel_rad[pixels], len(QUARTERS))
        width = self._valid.shape[1]
        rows = -(-len(rays) // width)  # as an image, which the texture is sampled for
        spread = np.arange(rows * width) % len(rays)
        grey = shader.shade((rays @ turn)[spread].reshape(rows, width, 3), pixel_rad[spread].reshape(rows, width)).grey
        return np.asarray(grey.ravel()[: len(rays)].reshape(len(QUARTERS), -1).mean(axis=0))


def _edges(plain: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Pixels that differ from a neighbour."""
    edges = np.zeros(plain.shape, dtype=bool)
    across, down = np.abs(np.diff(plain, axis=1)) > EDGE_STEP, np.abs(np.diff(plain, axis=0)) > EDGE_STEP
    edges[:, 1:] |= across
    edges[:, :-1] |= across
    edges[1:] |= down
    edges[:-1] |= down
    return edges


def _steps(rays_camera: NDArray[np.float64], *, axis: int) -> NDArray[np.float32]:
    """Change of the ray from pixel to pixel along an image axis; 0 next to pixels without one."""
    steps = np.gradient(rays_camera, axis=axis)
    return cv2.blur(np.nan_to_num(steps).astype(np.float32), (3, 3)).astype(np.float32)
