"""Grey values of what is seen: texture, light, shadow and mirror images."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.imaging.compiled import inlined, looped
from bench.synthesis.imaging.faces import (
    ALBEDO,
    CONTRAST,
    FIRST_U,
    FIRST_V,
    GLOW,
    LAST_U,
    LAST_V,
    MIRROR,
    NORMAL_X,
    NORMAL_Y,
    NORMAL_Z,
    STEP_U,
    STEP_V,
    TEXEL_LOG2,
)  # fmt: skip
from bench.synthesis.imaging.lamps import GLOW_BY_NIGHT, Lamps, lamp_light
from bench.synthesis.imaging.shadow_maps import HeightMap, height_at, lit_share
from bench.synthesis.imaging.sky import Sky, mirrored_grey, sky_grey
from bench.synthesis.imaging.textures import atlas_at, quick_log2
from bench.synthesis.imaging.visibility import NOTHING

ZERO, ONE, TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)
# A pixel's patch on a slanted face is long and narrow; the texture is smoothed to this power of the stretch: 1 would
# smooth across the patch's length and blur the far road to nothing, 0 would flicker.
STRETCH_POWER, LEAST_SLANT = np.float32(0.6), np.float32(0.01)
SHARPER = np.float32(0.5)  # levels; the interpolation between texels smooths once more
DARKEST = np.float32(0.05)  # of the albedo, where the texture is at its darkest
# Up, and away from the face: a nearer surface is the face itself.
SHADOW_BIAS_M, FAR_SHADOW_BIAS_M, SHADOW_CELLS = np.float32(0.015), np.float32(0.06), np.float32(1.5)
COVERS_PER_M = np.float32(1 / 1.2)  # surroundings 1.2 m higher than a point hide all the sky there is to hide
COVER_REACH_M, COVER_FADES_PER_M = np.float32(28.0), np.float32(1 / 8.0)  # they fade out between 20 m and this
COVER_SHARE = np.float32(0.75)  # of the sky's light, that they can take away
UPRIGHT, SLOPED = np.float32(0.72), np.float32(0.28)  # sky light on an upright face, and what facing up adds


class Scene(NamedTuple):
    """Everything that gives a point its grey value.

    Attributes:
        rows: (T, 16) float32, see `faces`.
        turn: (3, 3) float32, world from camera.
        origin_m: (3,) float32, the camera in the world.
        sun: (3,) float32, unit vector.
        sun_light: see `Lighting`.
        sky_light: see `Lighting`.
        near: shadows of the sun close to the camera.
        far: the same, coarser and further.
        cover: heights around every place, smoothed.
        sky: brightness of the sky.
        lamps: by night.
        night: whether lamps are lit.
        atlas: the texture.
        layout: of the texture's levels.
    """

    rows: NDArray[np.float32]
    turn: NDArray[np.float32]
    origin_m: NDArray[np.float32]
    sun: NDArray[np.float32]
    sun_light: np.float32
    sky_light: np.float32
    near: HeightMap
    far: HeightMap
    cover: HeightMap
    sky: Sky
    lamps: Lamps
    night: bool
    atlas: NDArray[np.float32]
    layout: NDArray[np.float32]


@inlined
def _face_grey(
    t: np.uintp,
    j: np.float32,
    k: np.float32,
    distance_m: np.float32,
    x: np.float32,
    y: np.float32,
    z: np.float32,
    pixel_rad: np.float32,
    scene: Scene,
    u: int,
    lamps_from: int,
    lamp_row: NDArray[np.float32],
) -> np.float32:
    """Grey value of a point.

    Args:
        t: its triangle.
        j: weight of the second corner.
        k: weight of the third corner.
        distance_m: to the camera.
        x: of the ray that sees it, unit length, world axes.
        y: of the ray.
        z: of the ray.
        pixel_rad: width of the pixel.
        scene: everything else.
        u: column of the pixel.
        lamps_from: column whose light of the lamps is good enough; -1 for none.
        lamp_row: (W,), light of the lamps at each column; changed.
    """
    rows = scene.rows
    nx, ny, nz = rows[t, NORMAL_X], rows[t, NORMAL_Y], rows[t, NORMAL_Z]
    facing = -(nx * x + ny * y + nz * z)
    if facing < ZERO:  # a thin sheet, seen from behind
        facing, nx, ny, nz = -facing, -nx, -ny, -nz
    px = scene.origin_m[0] + distance_m * x
    py = scene.origin_m[1] + distance_m * y
    pz = scene.origin_m[2] + distance_m * z
    level = quick_log2(distance_m * pixel_rad) - STRETCH_POWER * quick_log2(max(facing, LEAST_SLANT))
    noise = atlas_at(
        rows[t, FIRST_U] + j * rows[t, STEP_U] + k * rows[t, LAST_U],
        rows[t, FIRST_V] + j * rows[t, STEP_V] + k * rows[t, LAST_V],
        level - rows[t, TEXEL_LOG2] - SHARPER, scene.atlas, scene.layout,
    )  # fmt: skip
    light = scene.sky_light * (UPRIGHT + SLOPED * nz)
    if distance_m < COVER_REACH_M:
        hidden = min(max((height_at(px, py, scene.cover) - pz) * COVERS_PER_M, ZERO), ONE)
        faded = min((COVER_REACH_M - distance_m) * COVER_FADES_PER_M, ONE)
        light *= ONE - COVER_SHARE * hidden * faded
    if scene.sun_light > ZERO:
        sunny = nx * scene.sun[0] + ny * scene.sun[1] + nz * scene.sun[2]
        if sunny > ZERO:
            light += scene.sun_light * sunny * _sun_share(px, py, pz, nx, ny, scene)
    glow = rows[t, GLOW]
    if scene.night:
        if lamps_from < 0:
            lamp_row[u] = lamp_light(px, py, pz, nx, ny, nz, scene.lamps)
        else:
            lamp_row[u] = lamp_row[lamps_from]
        light += lamp_row[u]
        glow *= GLOW_BY_NIGHT
    grey = (rows[t, ALBEDO] * light + glow) * max(ONE + rows[t, CONTRAST] * noise, DARKEST)
    mirror = rows[t, MIRROR]
    if mirror > ZERO:
        # Schlick 1994, a cheap model of how much a surface mirrors at an angle.
        away = ONE - facing
        square = away * away
        share = mirror + (ONE - mirror) * square * square * away
        stretch = TWO * facing
        mirrored = mirrored_grey(
            x + stretch * nx, y + stretch * ny, z + stretch * nz, scene.sky, scene.atlas, scene.layout
        )
        grey += share * (mirrored - grey)
    return np.float32(grey)


@inlined
def _sun_share(
    px: np.float32, py: np.float32, pz: np.float32, nx: np.float32, ny: np.float32, scene: Scene
) -> np.float32:
    """Share of the sun that reaches a point."""
    away = SHADOW_CELLS / scene.near.per_m
    lit = lit_share(px + away * nx, py + away * ny, pz, SHADOW_BIAS_M, scene.near)
    if lit < ZERO:
        away = SHADOW_CELLS / scene.far.per_m
        lit = lit_share(px + away * nx, py + away * ny, pz, FAR_SHADOW_BIAS_M, scene.far)
    return ONE if lit < ZERO else lit


@inlined
def _ray_grey(
    seen: int,
    x: np.float32,
    y: np.float32,
    z: np.float32,
    pixel_rad: np.float32,
    planes: NDArray[np.float32],
    scene: Scene,
    u: int,
    lamps_from: int,
    lamp_row: NDArray[np.float32],
) -> np.float32:
    """Grey value along a ray of the camera frame, unit length, that sees a triangle or NOTHING."""
    turn = scene.turn
    wx = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z
    wy = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z
    wz = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
    if seen == NOTHING:
        return sky_grey(wx, wy, wz, pixel_rad, scene.sky, scene.atlas, scene.layout)
    t = np.uintp(seen)
    i = planes[t, 0] * x + planes[t, 1] * y + planes[t, 2] * z
    j = planes[t, 3] * x + planes[t, 4] * y + planes[t, 5] * z
    k = planes[t, 6] * x + planes[t, 7] * y + planes[t, 8] * z
    distance = ONE / (i + j + k)
    return _face_grey(t, j * distance, k * distance, distance, wx, wy, wz, pixel_rad, scene, u, lamps_from, lamp_row)


@looped
def shade(
    triangles: NDArray[np.int32],
    valid: NDArray[np.bool_],
    rays: NDArray[np.float32],
    pixel_rad: NDArray[np.float32],
    planes: NDArray[np.float32],
    scene: Scene,
    lamp_row: NDArray[np.float32],
    grey: NDArray[np.float32],
) -> None:
    """Grey values of what the pixels' centres see.

    Args:
        triangles: (H, W), NOTHING for the sky.
        valid: (H, W), where the lens sees anything.
        rays: (3, H, W), camera frame, unit length.
        pixel_rad: (H, W), width of each pixel.
        planes: (T, 16), see `visibility`.
        scene: what is seen.
        lamp_row: (W,), room to work in.
        grey: (H, W), filled; 1 is white.
    """
    height, width = grey.shape
    for v in range(height):
        for u in range(width):
            grey[v, u] = ZERO
            if not valid[v, u]:
                continue
            t = triangles[v, u]
            # The light of lamps changes little within a face: each four pixels look it up once.
            lamps_from = -1
            if v & 1 and triangles[v - 1, u] == t:
                lamps_from = u
            elif u & 1 and triangles[v, u - 1] == t:
                lamps_from = u - 1
            grey[v, u] = _ray_grey(
                t, rays[0, v, u], rays[1, v, u], rays[2, v, u], pixel_rad[v, u], planes, scene, u, lamps_from, lamp_row
            )
