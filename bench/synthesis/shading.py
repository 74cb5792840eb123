"""Grey values along rays: albedo, texture, sun and sky light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.mesh import Mesh, face_normals
from bench.synthesis.ray_scene import Hits, RayScene
from bench.synthesis.textures import SIZE, TextureAtlas

SKY_LIGHT, SUN_LIGHT = 0.65, 0.75  # a bright day with thin clouds: shadows are half as bright as the sun
SHADOW_FROM_M, SHADOW_REACH_M = 0.005, 60.0  # nearer things are the face itself
# A pixel's patch on a slanted face is long and narrow; the texture is smoothed to this power of the stretch: 1 would
# smooth across the patch's length and blur the far road to nothing, 0 would flicker.
STRETCH_POWER = 0.6
SHARPER = 0.5  # levels; the interpolation between texels smooths once more
DARKEST = 0.05  # of the albedo, where the texture is at its darkest
BEYOND_M = 1e4  # stands in for the distance of what is not hit


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shaded:
    """What rays see.

    Attributes:
        grey: (H, W) float32, 1 is white; 0 where nothing is met.
        plain: (H, W) float32, the same without the texture.
        triangles: (H, W) int64, row of the mesh; 0 where nothing is met.
        distances_m: (H, W) float32; infinite where nothing is met.
    """

    grey: NDArray[np.float32]
    plain: NDArray[np.float32]
    triangles: NDArray[np.int64]
    distances_m: NDArray[np.float32]


class Shader:
    """A scene at one time, to be looked at from its origin.

    Args:
        mesh: everything, along the axes of the world, with the camera at the origin.
        atlas: the texture of every surface.
        sun: (3,) unit vector to the sun.
    """

    def __init__(self, mesh: Mesh, *, atlas: TextureAtlas, sun: NDArray[np.float64]) -> None:
        self._scene, self._atlas = RayScene(mesh.corners_m), atlas
        self._sun = sun.astype(np.float32)
        albedo, contrast, texel_m, lit = mesh.surfaces.T
        facing = np.maximum(face_normals(mesh.corners_m) @ sun, 0.0)
        texture = mesh.texture_m / (texel_m * SIZE)[:, None, None]
        first = texture[:, 0] - np.floor(texture[:, 0])
        steps = [texture[:, 1] - texture[:, 0], texture[:, 2] - texture[:, 0]]
        ambient = albedo * np.where(lit > 0, SKY_LIGHT, 1.0)
        sunny = albedo * np.where(lit > 0, SUN_LIGHT * facing, 0.0)
        self._faces = np.column_stack([first, *steps, contrast, texel_m, ambient, sunny]).astype(np.float32)

    def shade(self, rays: NDArray[np.float32], pixel_rad: NDArray[np.float32]) -> Shaded:
        """Look along rays.

        Args:
            rays: (H, W, 3) float32, unit length; H and W below 32,768.
            pixel_rad: (H, W) float32, angle that each ray stands for.
        """
        shape, flat = rays.shape[:2], rays.reshape(-1, 3)
        hits = self._scene.cast(flat)
        met = np.isfinite(hits.distances_m)
        triangles = np.where(met, hits.triangles, 0)
        faces = np.take(self._faces, triangles, axis=0)
        plain = np.where(met, self._plain(flat, hits, faces), np.float32(0.0)).reshape(shape)
        second, third = hits.barycentric[:, 0], hits.barycentric[:, 1]
        u, v = (faces[:, k] + second * faces[:, k + 2] + third * faces[:, k + 4] for k in (0, 1))
        level = _level(flat, hits, pixel_rad.ravel(), faces[:, 7])
        noise = self._atlas.sample(u.reshape(shape), v.reshape(shape), level.reshape(shape))
        texture = np.maximum(1.0 + faces[:, 6].reshape(shape) * noise, np.float32(DARKEST))
        return Shaded(
            grey=plain * texture,
            plain=plain,
            triangles=triangles.reshape(shape),
            distances_m=hits.distances_m.reshape(shape),
        )

    def _plain(self, rays: NDArray[np.float32], hits: Hits, faces: NDArray[np.float32]) -> NDArray[np.float32]:
        """Light of the sky, and that of the sun where nothing stands between."""
        plain = faces[:, 8].copy()
        sunny = np.flatnonzero((faces[:, 9] > 0) & np.isfinite(hits.distances_m))
        places = rays[sunny] * hits.distances_m[sunny, None]
        to_sun = np.broadcast_to(self._sun, places.shape)
        blocked = self._scene.blocked(to_sun, places, beyond_m=SHADOW_FROM_M, within_m=SHADOW_REACH_M)
        plain[sunny] += np.where(blocked, np.float32(0.0), faces[sunny, 9])
        return plain


def _level(
    rays: NDArray[np.float32], hits: Hits, pixel_rad: NDArray[np.float32], texel_m: NDArray[np.float32]
) -> NDArray[np.float32]:
    """log2 of a pixel's size on its face, in texels."""
    slant = np.maximum(np.abs(np.einsum("ni,ni->n", hits.normals, rays)), np.float32(0.01))
    patch_m = np.minimum(hits.distances_m, np.float32(BEYOND_M)) * pixel_rad * slant ** np.float32(-STRETCH_POWER)
    return np.asarray(np.log2(patch_m / texel_m) - np.float32(SHARPER))
