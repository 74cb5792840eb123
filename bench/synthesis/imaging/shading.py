"""Grey values of what is seen: texture, light, shadow and mirror images.

A tile is shaded step by step, see `LANES`: plain arithmetic takes several pixels at once, and where
something is looked up, no pixel waits for what another does with it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.machine_code import compiled, inlined
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
    TextureAtlas,
    atlas_at,
    corner_weights,
    quick_log2,
    rows_of,
    share_below,
)
from bench.synthesis.imaging.lights import (
    BEAM_FOCAL,
    GLOW_BY_NIGHT,
    MIDDLE_COLUMN,
    MIDDLE_ROW,
    WHITE_LUX,
    HeightMap,
    Lamps,
    Sky,
    height_at,
    lit_share,
    mirrored_grey,
    sky_grey,
)
from bench.synthesis.imaging.visibility import NOTHING, TILE_PX

ZERO, HALF, ONE, TWO = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
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
SIXTH, SIXTY_FOURTH = np.float32(1 / 6), np.float32(1 / 64)
# cd; 6 m above the road: 33 lux below it, 10 on average, a residential street
STREET_LAMP = np.float32(1200.0 / WHITE_LUX)
# Low beam after ECE R112: 20,000 cd just below the cut-off a hundredth below the horizon, a tenth of that 6 degrees
# further down, so that the near road does not outshine the far one; to the sides it fades within 20 degrees.
HEADLIGHT, CUT_OFF = np.float32(20_000.0 / WHITE_LUX), np.float32(0.01)
DOWN_RATE, SIDE_RATE = np.float32(1 / 0.05), np.float32(0.5 / 0.35**2)
RISE, RISES_UNTIL, SHARPNESS = np.float32(0.27), np.float32(0.12), np.float32(1 / 0.008)
FOOT = np.float32(0.0008)  # share of the beam that falls right before the bumper
ABOVE = np.float32(0.012)  # share of the beam that strays above the cut-off
FAINTEST = np.float32(20.0)  # exponent of what counts as no light
LEAST_AHEAD_M = np.float32(0.05)
SHADE_BIAS = np.float32(1.02)  # of the distance; nearer street_furniture are the face itself
AT_ONCE = 8  # spots that the compiler takes at once

# Room to shade one tile: for each quantity a lane with its values at the 64 pixels, beside each other. All lanes lie in
# one array, so that the compiler sees that no two of them overlap, and takes several pixels at once.
PIXELS = TILE_PX * TILE_PX
# First the ray, in world axes, and what it meets: normal on the side that is seen, position, cosine between the two.
# Then spots, those pixels whose light of the lamps is found, and what one headlight sends to each.
(
    RAY_X, RAY_Y, RAY_Z, TOWARDS_X, TOWARDS_Y, TOWARDS_Z, PLACE_X, PLACE_Y, PLACE_Z, FACING, DISTANCE,
    TEXTURE_U, TEXTURE_V, LEVEL, NOISE, LIGHT,
    SPOT_X, SPOT_Y, SPOT_Z, SPOT_TOWARDS_X, SPOT_TOWARDS_Y, SPOT_TOWARDS_Z, SPOT_LIGHT,
    BEAM, BEAM_ASIDE, BEAM_DOWN, BEAM_ALONG, BEAM_SQUARE,
) = range(0, 28 * PIXELS, PIXELS)  # fmt: skip
LANES = 28 * PIXELS


class ShadingScene(NamedTuple):
    """Everything that gives a point its grey value.

    Attributes:
        rows: (T, 16) float32, see `faces`.
        world_from_camera: (3, 3) float32, rotation.
        origin_m: (3,) float32, the camera in the world.
        sun: (3,) float32, unit vector.
        sun_light: see `Lighting`.
        sky_light: see `Lighting`.
        near: shadows of the sun close to the camera.
        far: the same, coarser and further.
        cover: heights around every position, smoothed.
        sky: brightness of the sky.
        lamps: by night.
        night: whether lamps are lit.
        atlas: the texture.
    """

    rows: NDArray[np.float32]
    world_from_camera: NDArray[np.float32]
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
    atlas: TextureAtlas


@compiled
def shade(
    triangles: NDArray[np.int32],
    rays: NDArray[np.float32],
    pixel_rad: NDArray[np.float32],
    planes: NDArray[np.float32],
    scene: ShadingScene,
    lanes: NDArray[np.float32],
    spots: NDArray[np.int32],
    grey: NDArray[np.float32],
) -> None:
    """Grey values of what the pixels' centres see.

    Args:
        triangles: (H / 8, W / 8, 64), NOTHING for the sky.
        rays: (H / 8, W / 8, 3, 64), camera frame, unit length; 0 where the lens sees nothing.
        pixel_rad: (H / 8, W / 8, 64), width of each pixel.
        planes: (T, 16), see `planes`.
        scene: what is seen.
        lanes: (LANES,), scratch space.
        spots: (64,), scratch space.
        grey: (H / 8, W / 8, 64), filled; 1 is white, 0 where the lens sees nothing.
    """
    for v in range(triangles.shape[0]):
        for u in range(triangles.shape[1]):
            seen, widths, greys = triangles[v, u], pixel_rad[v, u], grey[v, u]
            _turn(rays[v, u], scene, lanes)
            faces = _meet(seen, rays[v, u], planes, scene, lanes)
            if faces < PIXELS:
                _show_sky(seen, rays[v, u], widths, scene, lanes, greys)
            if faces == 0:
                continue
            _place(widths, scene, lanes)
            _sample_texture(seen, scene, lanes)
            if scene.sun_light > ZERO:
                _add_sun(seen, scene, lanes)
            if scene.night:
                _add_lamps(seen, scene, lanes, spots)
            _show(seen, scene, lanes, greys)


@inlined
def _turn(rays: NDArray[np.float32], scene: ShadingScene, lanes: NDArray[np.float32]) -> None:
    """Rays in world axes."""
    xs, ys, zs = rays[0], rays[1], rays[2]
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rows_of(scene.world_from_camera)
    for n in range(PIXELS):
        x, y, z = xs[n], ys[n], zs[n]
        lanes[RAY_X + n] = xx * x + xy * y + xz * z
        lanes[RAY_Y + n] = yx * x + yy * y + yz * z
        lanes[RAY_Z + n] = zx * x + zy * y + zz * z


@inlined
def _meet(
    seen: NDArray[np.int32],
    rays: NDArray[np.float32],
    planes: NDArray[np.float32],
    scene: ShadingScene,
    lanes: NDArray[np.float32],
) -> int:
    """Distance, texture and normal of what each pixel sees; returns how many see a face."""
    rows, xs, ys, zs = scene.rows, rays[0], rays[1], rays[2]
    faces = 0
    for n in range(PIXELS):
        if seen[n] == NOTHING:
            continue
        faces += 1
        t, x, y, z = np.uintp(seen[n]), xs[n], ys[n], zs[n]
        i, j, k = corner_weights(planes, t, x, y, z)
        distance_m = ONE / (i + j + k)
        j, k = j * distance_m, k * distance_m
        lanes[DISTANCE + n], lanes[LEVEL + n] = distance_m, rows[t, TEXEL_LOG2]
        lanes[TEXTURE_U + n] = rows[t, FIRST_U] + j * rows[t, STEP_U] + k * rows[t, LAST_U]
        lanes[TEXTURE_V + n] = rows[t, FIRST_V] + j * rows[t, STEP_V] + k * rows[t, LAST_V]
        lanes[TOWARDS_X + n] = rows[t, NORMAL_X]
        lanes[TOWARDS_Y + n] = rows[t, NORMAL_Y]
        lanes[TOWARDS_Z + n] = rows[t, NORMAL_Z]
    return faces


@inlined
def _show_sky(
    seen: NDArray[np.int32],
    rays: NDArray[np.float32],
    pixel_rad: NDArray[np.float32],
    scene: ShadingScene,
    lanes: NDArray[np.float32],
    greys: NDArray[np.float32],
) -> None:
    """Grey values of pixels that see no face."""
    for n in range(PIXELS):
        if seen[n] != NOTHING:
            continue
        greys[n] = ZERO
        if rays[0, n] != ZERO or rays[1, n] != ZERO or rays[2, n] != ZERO:
            x, y, z = lanes[RAY_X + n], lanes[RAY_Y + n], lanes[RAY_Z + n]
            greys[n] = sky_grey(x, y, z, pixel_rad[n], scene.sky, scene.atlas)


@inlined
def _place(pixel_rad: NDArray[np.float32], scene: ShadingScene, lanes: NDArray[np.float32]) -> None:
    """Place of what is seen, the side of it that is seen, the level of its texture, and the light of the open sky.

    Pixels without a face are computed too, which avoids branches; their values are not used.
    """
    ox, oy, oz, sky_light = scene.origin_m[0], scene.origin_m[1], scene.origin_m[2], scene.sky_light
    for n in range(PIXELS):
        x, y, z, distance_m = lanes[RAY_X + n], lanes[RAY_Y + n], lanes[RAY_Z + n], lanes[DISTANCE + n]
        nx, ny, nz = lanes[TOWARDS_X + n], lanes[TOWARDS_Y + n], lanes[TOWARDS_Z + n]
        facing = -(nx * x + ny * y + nz * z)
        behind = facing < ZERO  # a thin sheet, seen from behind
        facing, nx = (-facing if behind else facing), (-nx if behind else nx)
        ny, nz = (-ny if behind else ny), (-nz if behind else nz)
        lanes[FACING + n], lanes[TOWARDS_X + n], lanes[TOWARDS_Y + n], lanes[TOWARDS_Z + n] = facing, nx, ny, nz
        lanes[PLACE_X + n], lanes[PLACE_Y + n] = ox + distance_m * x, oy + distance_m * y
        lanes[PLACE_Z + n] = oz + distance_m * z
        level = quick_log2(distance_m * pixel_rad[n]) - STRETCH_POWER * quick_log2(max(facing, LEAST_SLANT))
        lanes[LEVEL + n] = level - lanes[LEVEL + n] - SHARPER
        lanes[LIGHT + n] = sky_light * (UPRIGHT + SLOPED * nz)


@inlined
def _sample_texture(seen: NDArray[np.int32], scene: ShadingScene, lanes: NDArray[np.float32]) -> None:
    """Texture, and how much of the sky's light the surroundings take away."""
    for n in range(PIXELS):
        if seen[n] != NOTHING:
            lanes[NOISE + n] = atlas_at(lanes[TEXTURE_U + n], lanes[TEXTURE_V + n], lanes[LEVEL + n], scene.atlas)
    for n in range(PIXELS):
        distance_m = lanes[DISTANCE + n]
        if seen[n] != NOTHING and distance_m < COVER_REACH_M:
            height_m = height_at(lanes[PLACE_X + n], lanes[PLACE_Y + n], scene.cover)
            hidden = min(max((height_m - lanes[PLACE_Z + n]) * COVERS_PER_M, ZERO), ONE)
            faded = min((COVER_REACH_M - distance_m) * COVER_FADES_PER_M, ONE)
            lanes[LIGHT + n] *= ONE - COVER_SHARE * hidden * faded


@inlined
def _add_sun(seen: NDArray[np.int32], scene: ShadingScene, lanes: NDArray[np.float32]) -> None:
    for n in range(PIXELS):
        if seen[n] == NOTHING:
            continue
        nx, ny, nz = lanes[TOWARDS_X + n], lanes[TOWARDS_Y + n], lanes[TOWARDS_Z + n]
        sunny = nx * scene.sun[0] + ny * scene.sun[1] + nz * scene.sun[2]
        if sunny > ZERO:
            share = _sun_share(lanes[PLACE_X + n], lanes[PLACE_Y + n], lanes[PLACE_Z + n], nx, ny, scene)
            lanes[LIGHT + n] += scene.sun_light * sunny * share


@inlined
def _sun_share(
    px: np.float32, py: np.float32, pz: np.float32, nx: np.float32, ny: np.float32, scene: ShadingScene
) -> np.float32:
    """Share of the sun that reaches a point."""
    away = SHADOW_CELLS / scene.near.per_m
    lit = lit_share(px + away * nx, py + away * ny, pz, SHADOW_BIAS_M, scene.near)
    if lit < ZERO:
        away = SHADOW_CELLS / scene.far.per_m
        lit = lit_share(px + away * nx, py + away * ny, pz, FAR_SHADOW_BIAS_M, scene.far)
    return ONE if lit < ZERO else lit


@inlined
def _add_lamps(
    seen: NDArray[np.int32], scene: ShadingScene, lanes: NDArray[np.float32], spots: NDArray[np.int32]
) -> None:
    """The light of lamps changes little within a face: each four pixels look it up once, at a spot."""
    count = 0
    for n in range(PIXELS):
        t = seen[n]
        if t == NOTHING:
            continue
        if n & TILE_PX and seen[n - TILE_PX] == t:
            spots[n] = spots[n - TILE_PX]
        elif n & 1 and seen[n - 1] == t:
            spots[n] = spots[n - 1]
        else:
            spots[n] = count
            lanes[SPOT_X + count], lanes[SPOT_Y + count] = lanes[PLACE_X + n], lanes[PLACE_Y + n]
            lanes[SPOT_Z + count], lanes[SPOT_TOWARDS_X + count] = lanes[PLACE_Z + n], lanes[TOWARDS_X + n]
            lanes[SPOT_TOWARDS_Y + count], lanes[SPOT_TOWARDS_Z + count] = lanes[TOWARDS_Y + n], lanes[TOWARDS_Z + n]
            count += 1
    light_spots(count, scene.lamps, lanes)
    for n in range(PIXELS):
        if seen[n] != NOTHING:
            lanes[LIGHT + n] += lanes[SPOT_LIGHT + np.uintp(spots[n])]


@inlined
def _show(seen: NDArray[np.int32], scene: ShadingScene, lanes: NDArray[np.float32], greys: NDArray[np.float32]) -> None:
    """Grey values of pixels that see a face."""
    rows = scene.rows
    lit = GLOW_BY_NIGHT if scene.night else ONE
    for n in range(PIXELS):
        if seen[n] == NOTHING:
            continue
        t, facing = np.uintp(seen[n]), lanes[FACING + n]
        grey = rows[t, ALBEDO] * lanes[LIGHT + n] + rows[t, GLOW] * lit
        grey *= max(ONE + rows[t, CONTRAST] * lanes[NOISE + n], DARKEST)
        mirror = rows[t, MIRROR]
        if mirror > ZERO:
            # Schlick 1994, a cheap model of how much a surface mirrors at an angle.
            away = ONE - facing
            square = away * away
            share = mirror + (ONE - mirror) * square * square * away
            stretch = TWO * facing
            mirrored = mirrored_grey(
                lanes[RAY_X + n] + stretch * lanes[TOWARDS_X + n], lanes[RAY_Y + n] + stretch * lanes[TOWARDS_Y + n],
                lanes[RAY_Z + n] + stretch * lanes[TOWARDS_Z + n], scene.sky, scene.atlas,
            )  # fmt: skip
            grey += share * (mirrored - grey)
        greys[n] = grey


@inlined
def light_spots(count: int, lamps: Lamps, lanes: NDArray[np.float32]) -> None:
    """Find the brightness of white paper at spots of one tile.

    Args:
        count: how many spots there are.
        lamps: that light them.
        lanes: see `LANES`: position and normal, world, of each spot; those of light are filled.
    """
    whole = -(-count // AT_ONCE) * AT_ONCE  # values beyond the last spot are computed, but not looked at
    for n in range(whole):
        lanes[SPOT_LIGHT + n] = ZERO
    for k in range(len(lamps.street_m)):
        _add_street_lamp(k, whole, lamps, lanes)
    for k in range(lamps.headlights):
        _aim_headlight(k, whole, lamps, lanes)
        for n in range(count):
            along, square = lanes[BEAM_ALONG + n], lanes[BEAM_SQUARE + n]
            if along > ZERO:
                distance_m = np.sqrt(square)
                lit = _lit(lanes[BEAM_ASIDE + n], lanes[BEAM_DOWN + n], distance_m, lamps.inverse_depth[k])
                lanes[SPOT_LIGHT + n] += lanes[BEAM + n] * lit * along / (square * distance_m)


@inlined
def _add_street_lamp(k: int, count: int, lamps: Lamps, lanes: NDArray[np.float32]) -> None:
    x, y, z = lamps.street_m[k, 0], lamps.street_m[k, 1], lamps.street_m[k, 2]
    for n in range(count):
        dx, dy, dz = x - lanes[SPOT_X + n], y - lanes[SPOT_Y + n], z - lanes[SPOT_Z + n]
        along = dx * lanes[SPOT_TOWARDS_X + n] + dy * lanes[SPOT_TOWARDS_Y + n] + dz * lanes[SPOT_TOWARDS_Z + n]
        square = dx * dx + dy * dy + dz * dz
        # Its light fades with the cosine from straight down.
        lanes[SPOT_LIGHT + n] += STREET_LAMP * max(along, ZERO) * max(dz, ZERO) / (square * square)


@inlined
def _aim_headlight(k: int, count: int, lamps: Lamps, lanes: NDArray[np.float32]) -> None:
    """Coordinates of each spot in a headlight's beam, and the beam's brightness there; `BEAM_ALONG` is 0 behind it."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rows_of(lamps.lamp_from_world[k])
    x, y, z = lamps.positions_m[k, 0], lamps.positions_m[k, 1], lamps.positions_m[k, 2]
    for n in range(count):
        dx, dy, dz = lanes[SPOT_X + n] - x, lanes[SPOT_Y + n] - y, lanes[SPOT_Z + n] - z
        along = -(dx * lanes[SPOT_TOWARDS_X + n] + dy * lanes[SPOT_TOWARDS_Y + n] + dz * lanes[SPOT_TOWARDS_Z + n])
        ahead = zx * dx + zy * dy + zz * dz
        per_m = ONE / ahead
        aside, down = (xx * dx + xy * dy + xz * dz) * per_m, (yx * dx + yy * dy + yz * dz) * per_m
        # On the right the cut-off rises, to light the pavement.
        below = down - CUT_OFF + RISE * min(max(aside, ZERO), RISES_UNTIL)
        beam = HEADLIGHT * quick_exp(-min(aside * aside * SIDE_RATE, FAINTEST))
        lower = max(quick_exp(-min(below * DOWN_RATE, FAINTEST)), FOOT)
        upper = max(ABOVE, ONE + below * SHARPNESS)
        lanes[BEAM + n] = beam * (lower if below >= ZERO else upper)
        lanes[BEAM_ASIDE + n], lanes[BEAM_DOWN + n] = aside, down
        lanes[BEAM_ALONG + n] = along if ahead > LEAST_AHEAD_M else ZERO
        lanes[BEAM_SQUARE + n] = dx * dx + dy * dy + dz * dz


@inlined
def quick_exp(power: np.float32) -> np.float32:
    """Exponential of a number between -FAINTEST and 0, within a hundredth of its value.

    Source:
        exp(x) = exp(x / 64) ** 64, with a Taylor series of third order inside.
    """
    part = power * SIXTY_FOURTH
    value = ONE + part * (ONE + part * (HALF + part * SIXTH))
    for _ in range(6):
        value *= value
    return value


@inlined
def _lit(aside: np.float32, down: np.float32, distance_m: np.float32, inverse_depth: NDArray[np.float32]) -> np.float32:
    """Share of four rays of a headlight that come as far as a point."""
    column, row = BEAM_FOCAL * aside + MIDDLE_COLUMN, BEAM_FOCAL * down + MIDDLE_ROW
    if not (ZERO <= column < MIDDLE_COLUMN + MIDDLE_COLUMN and ZERO <= row < MIDDLE_ROW + MIDDLE_ROW):
        return ONE
    return share_below(row, column, SHADE_BIAS / distance_m, inverse_depth)
