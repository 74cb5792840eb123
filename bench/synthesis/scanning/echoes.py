"""What the beams of a revolution meet first, and how much of their light comes back."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.mesh import Surface
from bench.synthesis.ray_scene import RayScene
from bench.synthesis.scenario import LidarSpec

COLUMN_OF = {field.name: column for column, field in enumerate(fields(Surface))}
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
        ranges_m: (N,) float32; infinite where there is none.
        cosines: (N,) float32, of the angle between ray and surface normal.
        albedos: (N,) float32.
        mirrors: (N,) float32, as `Surface.mirror`.
        panes: (N,) bool, whether it is a pane of glass.
    """

    def __init__(self, rays: int, within_m: float) -> None:
        self._within_m = np.float32(within_m)
        self.ranges_m = np.full(rays, np.inf, dtype=np.float32)
        self.cosines, self.albedos, self.mirrors = np.zeros((3, rays), dtype=np.float32)
        self.panes = np.zeros(rays, dtype=bool)

    def add(
        self,
        scene: RayScene,
        surfaces: NDArray[np.float64],
        *,
        rows: NDArray[np.intp],
        rays: NDArray[np.float32],
        origins_m: NDArray[np.float32],
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
        self.cosines[into] = np.abs(np.einsum("ni,ni->n", hits.normals[nearer], rays[nearer]))
        self.albedos[into] = surfaces[faces, COLUMN_OF["albedo"]]
        self.mirrors[into] = surfaces[faces, COLUMN_OF["mirror"]]
        self.panes[into] = _are_panes(surfaces)[faces]

    def reflectances(self) -> NDArray[np.float32]:
        """(N,) float32: the share of the light that is scattered back, before the distance weakens it.

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
    """Which pulses come back strong enough.

    Args:
        echoes: of N rays.
        spec: of the sensor.
        rng: fading, and where panes are dusty.

    Returns:
        found: (N,) bool.
        intensities: (N,) float32 in [0, 1], the faded reflectance, in 32 steps.
    """
    faded = echoes.reflectances() * np.exp(
        np.float32(FADING) * rng.standard_normal(len(echoes.ranges_m), dtype=np.float32)
    )
    dusty = rng.random(len(faded), dtype=np.float32) < np.float32(spec.pane_returns) * echoes.cosines
    found = np.isfinite(echoes.ranges_m)
    found[found] = faded[found] >= np.float32(spec.weakest_return_per_m2) * echoes.ranges_m[found] ** 2
    found &= dusty | ~echoes.panes
    return found, np.rint(np.minimum(faded, 1.0) * np.float32(STEPS - 1)) / np.float32(STEPS - 1)
