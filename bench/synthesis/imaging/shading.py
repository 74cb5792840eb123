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
    PLAIN,
    STEP_U,
    STEP_V,
    TEXEL_LOG2,
)  # fmt: skip
from bench.synthesis.imaging.lamps import GLOW_BY_NIGHT, Lamps, lamp_light
from bench.synthesis.imaging.shadow_maps import HeightMap, height_at, lit_share
from bench.synthesis.imaging.sky import Sky, mirrored_grey, sky_grey
from bench.synthesis.imaging.textures import atlas_at

NOTHING = -1  # triangle of a pixel that sees the sky
# A pixel's patch on a slanted face is long and narrow; the texture is smoothed to this power of the stretch: 1 would
# smooth across the patch's length and blur the far road to nothing, 0 would flicker.
STRETCH_POWER = 0.6
SHARPER = 0.5  # levels; the interpolation between texels smooths once more
DARKEST = 0.05  # of the albedo, where the texture is at its darkest
SHADOW_BIAS_M, SHADOW_CELLS = 0.015, 1.5  # up, and away from the face: a nearer surface is the face itself
COVER_M, COVER_FADE_M = (
    1.2,
    (20.0, 28.0),
)  # surroundings this much higher than a point hide all the sky there is to hide
COVER_SHARE = 0.75  # of the sky's light, that they can take away
UPRIGHT, SLOPED = 0.72, 0.28  # sky light on an upright face, and what facing up adds
EDGE_STEP = 0.03  # of white, between neighbours without texture: an edge worth four rays
QUARTER = np.float32(0.25)


class Scene(NamedTuple):
    """Everything that gives a point its grey value.

    Attributes:
        rows: (T, 16) float32, see `faces`.
        turn: (3, 3) float64, world from camera.
        origin_m: (3,) float64, the camera in the world.
        sun: (3,) float64, unit vector.
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
    turn: NDArray[np.float64]
    origin_m: NDArray[np.float64]
    sun: NDArray[np.float64]
    sun_light: float
    sky_light: float
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
    t: int, j: float, k: float, distance_m: float, x: float, y: float, z: float, pixel_rad: float, scene: Scene
) -> float:
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
    """
    rows = scene.rows
    nx, ny, nz = rows[t, NORMAL_X], rows[t, NORMAL_Y], rows[t, NORMAL_Z]
    facing = -(nx * x + ny * y + nz * z)
    if facing < 0:  # a thin sheet, seen from behind
        facing, nx, ny, nz = -facing, -nx, -ny, -nz
    px, py, pz = (
        scene.origin_m[0] + distance_m * x,
        scene.origin_m[1] + distance_m * y,
        scene.origin_m[2] + distance_m * z,
    )
    slant = max(facing, 0.01)
    level = np.log2(distance_m * pixel_rad) - STRETCH_POWER * np.log2(slant) - rows[t, TEXEL_LOG2] - SHARPER
    noise = atlas_at(
        rows[t, FIRST_U] + j * rows[t, STEP_U] + k * rows[t, LAST_U],
        rows[t, FIRST_V] + j * rows[t, STEP_V] + k * rows[t, LAST_V],
        level, scene.atlas, scene.layout,
    )  # fmt: skip
    light = scene.sky_light * (UPRIGHT + SLOPED * nz)
    if distance_m < COVER_FADE_M[1]:
        hidden = min(max((height_at(px, py, scene.cover) - pz) / COVER_M, 0.0), 1.0)
        faded = min((COVER_FADE_M[1] - distance_m) / (COVER_FADE_M[1] - COVER_FADE_M[0]), 1.0)
        light *= 1.0 - COVER_SHARE * hidden * faded
    if scene.sun_light > 0:
        sunny = nx * scene.sun[0] + ny * scene.sun[1] + nz * scene.sun[2]
        if sunny > 0:
            light += scene.sun_light * sunny * _sun_share(px, py, pz, nx, ny, scene)
    glow = rows[t, GLOW]
    if scene.night:
        light += lamp_light(px, py, pz, nx, ny, nz, scene.lamps)
        glow *= GLOW_BY_NIGHT
    grey = (rows[t, ALBEDO] * light + glow) * max(1.0 + rows[t, CONTRAST] * noise, DARKEST)
    mirror = rows[t, MIRROR]
    if mirror > 0:
        # Schlick 1994, a cheap model of how much a surface mirrors at an angle.
        away = 1.0 - facing
        square = away * away
        share = mirror + (1.0 - mirror) * square * square * away
        grey += share * (
            mirrored_grey(
                x + 2 * facing * nx, y + 2 * facing * ny, z + 2 * facing * nz, scene.sky, scene.atlas, scene.layout
            )
            - grey
        )
    return float(grey)


@inlined
def _sun_share(px: float, py: float, pz: float, nx: float, ny: float, scene: Scene) -> float:
    """Share of the sun that reaches a point."""
    away = SHADOW_CELLS * scene.near.texel_m
    lit = lit_share(px + away * nx, py + away * ny, pz, SHADOW_BIAS_M, scene.near)
    if lit < 0:
        away = SHADOW_CELLS * scene.far.texel_m
        lit = lit_share(px + away * nx, py + away * ny, pz, 4 * SHADOW_BIAS_M, scene.far)
    return 1.0 if lit < 0 else lit


@inlined
def _ray_grey(
    t: int, x: float, y: float, z: float, pixel_rad: float, planes: NDArray[np.float32], scene: Scene
) -> float:
    """Grey value along a ray of the camera frame, unit length, that sees a triangle or NOTHING."""
    turn = scene.turn
    wx = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z
    wy = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z
    wz = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
    if t == NOTHING:
        return sky_grey(wx, wy, wz, pixel_rad, scene.sky, scene.atlas, scene.layout)
    i = planes[t, 0] * x + planes[t, 1] * y + planes[t, 2] * z
    j = planes[t, 3] * x + planes[t, 4] * y + planes[t, 5] * z
    k = planes[t, 6] * x + planes[t, 7] * y + planes[t, 8] * z
    near = i + j + k
    return _face_grey(t, j / near, k / near, 1.0 / near, wx, wy, wz, pixel_rad, scene)


@looped
def shade(
    triangles: NDArray[np.int32],
    valid: NDArray[np.bool_],
    rays: NDArray[np.float32],
    pixel_rad: NDArray[np.float32],
    planes: NDArray[np.float32],
    scene: Scene,
    grey: NDArray[np.float32],
) -> None:
    """Grey values of what the pixels' centres see.

    Args:
        triangles: (H, W), NOTHING for the sky.
        valid: (H, W), where the lens sees anything.
        rays: (3, H, W), camera frame, unit length.
        pixel_rad: (H, W), width of each pixel.
        planes: (T, 9), see `visibility`.
        scene: what is seen.
        grey: (H, W), filled; 1 is white.
    """
    height, width = grey.shape
    for v in range(height):
        for u in range(width):
            if valid[v, u]:
                grey[v, u] = _ray_grey(
                    triangles[v, u], rays[0, v, u], rays[1, v, u], rays[2, v, u], pixel_rad[v, u], planes, scene
                )


@looped
def smooth_edges(
    triangles: NDArray[np.int32],
    valid: NDArray[np.bool_],
    rays: NDArray[np.float32],
    along_u: NDArray[np.float32],
    along_v: NDArray[np.float32],
    pixel_rad: NDArray[np.float32],
    planes: NDArray[np.float32],
    scene: Scene,
    centre: NDArray[np.float32],
    grey: NDArray[np.float32],
    known: NDArray[np.int32],
    weights: NDArray[np.float32],
    seen: NDArray[np.float32],
) -> int:
    """Mean over a pixel's quarters, where its neighbours see something else.

    Each quarter sees the nearest of the triangles that the pixel or its neighbours see.

    Args:
        triangles: (H, W).
        valid: (H, W).
        rays: (3, H, W).
        along_u: (H, W, 3), change of the ray to the right.
        along_v: (H, W, 3), downwards.
        pixel_rad: (H, W).
        planes: (T, 9).
        scene: what is seen.
        centre: (H, W), what the centres see.
        grey: (H, W), changed where there are edges.
        known: (9,), room to work in.
        weights: (9,), room to work in.
        seen: (9, 3), room to work in.

    Returns:
        How many pixels have an edge.
    """
    height, width = grey.shape
    edges = 0
    for v in range(1, height - 1):
        for u in range(1, width - 1):
            if not valid[v, u] or not _on_edge(v, u, triangles, scene.rows):
                continue
            edges += 1
            count = 0
            for row in range(v - 1, v + 2):
                for column in range(u - 1, u + 2):
                    t = triangles[row, column] if valid[row, column] else triangles[v, u]
                    new = True
                    for n in range(count):
                        new = new and known[n] != t
                    if new:
                        known[count], weights[count] = t, np.float32(0.0)
                        count += 1
            for quarter in range(4):
                du, dv = (QUARTER if quarter & 1 else -QUARTER), (QUARTER if quarter & 2 else -QUARTER)
                x = rays[0, v, u] + du * along_u[v, u, 0] + dv * along_v[v, u, 0]
                y = rays[1, v, u] + du * along_u[v, u, 1] + dv * along_v[v, u, 1]
                z = rays[2, v, u] + du * along_u[v, u, 2] + dv * along_v[v, u, 2]
                nearest, found = np.float32(0.0), -1
                for n in range(count):
                    t = known[n]
                    if t == NOTHING:
                        if found < 0:
                            found = n
                        continue
                    i = planes[t, 0] * x + planes[t, 1] * y + planes[t, 2] * z
                    j = planes[t, 3] * x + planes[t, 4] * y + planes[t, 5] * z
                    k = planes[t, 6] * x + planes[t, 7] * y + planes[t, 8] * z
                    if i >= 0 and j >= 0 and k >= 0 and i + j + k > nearest:
                        nearest, found = i + j + k, n
                if found < 0:  # between triangles that no centre sees
                    continue
                if weights[found] == 0:
                    seen[found, 0], seen[found, 1], seen[found, 2] = x, y, z
                weights[found] += QUARTER
            total, whole = np.float32(0.0), np.float32(0.0)
            for n in range(count):
                if weights[n] > 0:
                    if known[n] == triangles[v, u]:
                        value = centre[v, u]
                    else:
                        x, y, z = seen[n, 0], seen[n, 1], seen[n, 2]
                        size = np.float32(1.0) / np.sqrt(x * x + y * y + z * z)
                        value = np.float32(
                            _ray_grey(known[n], x * size, y * size, z * size, pixel_rad[v, u], planes, scene)
                        )
                    total += weights[n] * value
                    whole += weights[n]
            if whole > 0:
                grey[v, u] = total / whole
    return edges


@inlined
def _on_edge(v: int, u: int, triangles: NDArray[np.int32], rows: NDArray[np.float32]) -> bool:
    """Whether a pixel and one of its four neighbours see faces of different brightness."""
    t = triangles[v, u]
    if triangles[v - 1, u] == t and triangles[v + 1, u] == t and triangles[v, u - 1] == t and triangles[v, u + 1] == t:
        return False
    plain = _plain(t, rows)
    return (
        abs(_plain(triangles[v - 1, u], rows) - plain) > EDGE_STEP
        or abs(_plain(triangles[v + 1, u], rows) - plain) > EDGE_STEP
        or abs(_plain(triangles[v, u - 1], rows) - plain) > EDGE_STEP
        or abs(_plain(triangles[v, u + 1], rows) - plain) > EDGE_STEP
    )


@inlined
def _plain(t: int, rows: NDArray[np.float32]) -> float:
    return 2.0 if t == NOTHING else rows[t, PLAIN]
