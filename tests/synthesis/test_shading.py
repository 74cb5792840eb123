"""Motion blur, the light of lamps, and texture, by numbers done by hand."""

from itertools import pairwise

import numba
import numpy as np
import pytest

from bench.synthesis.imaging import shading
from bench.synthesis.imaging.exposure import blur
from bench.synthesis.imaging.faces import LEVELS, SIZE, atlas_at, texture_atlas
from bench.synthesis.imaging.lights import BEAM_HEIGHT, BEAM_WIDTH, NO_LAMPS

SHAPE = (20, 33)


def blurred(grey, motion_vectors, inverse_depth, valid):
    out = np.full(grey.shape, np.nan, dtype=np.float32)
    contiguous = np.ascontiguousarray
    blur(contiguous(grey), contiguous(motion_vectors), contiguous(inverse_depth), contiguous(valid), out)
    return out


def ways_px(u, v):
    return np.stack([np.full(SHAPE, u, np.float32), np.full(SHAPE, v, np.float32)])


def test_blur_down_is_blur_across_of_the_turned_picture():
    rng = np.random.default_rng(1)
    grey, inverse_depth = (rng.random(SHAPE, dtype=np.float32) for _ in range(2))
    motion_vectors, valid = rng.normal(0.0, 6.0, (2, *SHAPE)).astype(np.float32), rng.random(SHAPE) < 0.9
    upright = blurred(grey, motion_vectors, inverse_depth, valid)
    turned = blurred(grey.T, motion_vectors[::-1].transpose(0, 2, 1), inverse_depth.T, valid.T)
    assert np.array_equal(upright, turned.T)
    assert not np.allclose(upright, grey, atol=0.01)


def test_a_way_of_three_pixels_is_the_mean_over_three_pixels():
    grey = np.zeros(SHAPE, dtype=np.float32)
    grey[10, 16] = 1.0
    picture = blurred(grey, ways_px(3.0, 0.0), np.ones(SHAPE, np.float32), np.ones(SHAPE, np.bool_))
    # The straight lines between the pixels, from 1.5 px before to 1.5 px after; a third of their integral.
    expected = np.array([0.0, 0.125, 0.875, 1.0, 0.875, 0.125, 0.0]) / 3.0
    assert np.allclose(picture[10, 13:20], expected, atol=1e-6)
    assert not picture[:10].any()


def test_what_the_lens_does_not_see_stays_out():
    grey, valid = np.full(SHAPE, 0.5, dtype=np.float32), np.ones(SHAPE, dtype=np.bool_)
    grey[:, 20:], valid[:, 20:] = 100.0, False
    picture = blurred(grey, ways_px(9.0, 4.0), np.zeros(SHAPE, np.float32), valid)
    assert (picture[:, :20] == 0.5).all()


def test_what_stands_nearer_stays_out_and_what_moves_nearer_does_not():
    grey, inverse_depth = np.zeros(SHAPE, dtype=np.float32), np.full(SHAPE, 0.1, dtype=np.float32)
    grey[:, 20:], inverse_depth[:, 20:] = 1.0, 0.5
    valid, motion_vectors = np.ones(SHAPE, dtype=np.bool_), ways_px(10.0, 0.0)
    assert (blurred(grey, motion_vectors, inverse_depth, valid)[:-1, 18] > 0.2).all()
    motion_vectors[:, :, 20:] = 0.0
    assert (blurred(grey, motion_vectors, inverse_depth, valid)[:, :20] == 0.0).all()


AHEAD = np.eye(3, dtype=np.float32)  # the headlight looks along z, y is down
UP, TOWARDS = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)


def lit(spots_m, normal, lamps):
    lanes = np.full(shading.LANES, np.nan, dtype=np.float32)
    starts = [getattr(shading, f"SPOT_{name}") for name in ("X", "Y", "Z", "TOWARDS_X", "TOWARDS_Y", "TOWARDS_Z")]
    for start, values in zip(starts, (*np.reshape(spots_m, (-1, 3)).T, *normal), strict=True):
        lanes[start : start + len(spots_m)] = values
    shading.light_spots(len(spots_m), lamps, lanes)
    return lanes[shading.SPOT_LIGHT : shading.SPOT_LIGHT + len(spots_m)]


def street(*places_m):
    return NO_LAMPS._replace(street_m=np.array(places_m, dtype=np.float32))


def headlight(inverse_depth):
    """One at the origin, that meets something at 1 / `inverse_depth` everywhere."""
    pictures = np.full((2, BEAM_HEIGHT, BEAM_WIDTH), inverse_depth, dtype=np.float32)
    return NO_LAMPS._replace(lamp_from_world=np.stack([AHEAD, AHEAD]), inverse_depth=pictures, headlights=1)


POST, BEAM = street((0.0, 0.0, 6.0)), headlight(0.0)


@pytest.mark.parametrize(
    ("spot_m", "normal", "lamps", "expected"),
    [
        # Below a street lamp: 1200 cd / (6 m)^2 = 33.3 lux, and 15 lux are white.
        ((0.0, 0.0, 0.0), UP, POST, 33.333 / 15),
        # 6 m aside, too, the square of the distance is 72 m^2; the cosine of 45 degrees counts on the ground, and once
        # more below the lamp.
        ((6.0, 0.0, 0.0), UP, POST, 1200 / 72 / 2 / 15),
        # Above it, and turned away.
        ((1.0, 0.0, 7.0), TOWARDS, POST, 0.0),
        ((1.0, 0.0, 0.0), TOWARDS, POST, 0.0),
        # Straight ahead at the cut-off the whole 20,000 cd of a headlight arrive, at 10 m of them 200 lux.
        ((0.0, 10.0 * float(shading.CUT_OFF), 10.0), TOWARDS, BEAM, 20_000 / 100 / 15),
        # They light what the headlight meets there, too.
        ((0.0, 10.0 * float(shading.CUT_OFF), 10.0), TOWARDS, headlight(1 / 10), 20_000 / 100 / 15),
        ((0.0, -1.0, 10.0), TOWARDS, BEAM, float(shading.HEADLIGHT * shading.ABOVE) * 10 / 101**1.5),
        # Behind it, and hidden.
        ((0.0, 0.1, -10.0), UP, BEAM, 0.0),
        ((0.0, 0.1, 10.0), TOWARDS, headlight(1 / 5), 0.0),
    ],
)
def test_light_of_a_lamp(spot_m, normal, lamps, expected):
    assert lit([spot_m], normal, lamps)[0] == pytest.approx(expected, rel=2e-3)


def test_light_of_several_lamps_adds_up():
    places = [(0.0, 0.0, 6.0), (10.0, 3.0, 5.0), (-4.0, -8.0, 7.0)]
    alone = [lit([(1.0, 2.0, 0.0)], UP, street(place))[0] for place in places]
    assert lit([(1.0, 2.0, 0.0)], UP, street(*places))[0] == pytest.approx(sum(alone), rel=1e-6)


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 33, shading.PIXELS])
def test_a_spot_has_its_light_whatever_spots_are_beside_it(count):
    rng = np.random.default_rng(0)
    spots = [(float(x), float(y), float(z)) for x, y, z in rng.uniform((-6, 0.1, -2), (6, 2, 30), (count, 3))]
    lamps = headlight(1 / 12)._replace(street_m=np.array([[0, -5, 9], [4, -2, 20]], dtype=np.float32))
    together = lit(spots, TOWARDS, lamps)
    assert np.array_equal(together, [lit([spot], TOWARDS, lamps)[0] for spot in spots])


@numba.njit(error_model="numpy")
def fill(u, v, level, atlas, found):
    for k in range(len(u)):
        found[k] = atlas_at(u[k], v[k], level[k], atlas)


def sample(atlas, u, v, level):
    """The texture at places (N,), in periods, smoothed to levels."""
    found = np.empty(len(u), dtype=np.float32)
    fill(u, v, level, atlas, found)
    return found


def test_levels_lie_on_each_other():
    # A shift between levels would make surfaces creep as the camera comes nearer, and flow would see it.
    atlas = texture_atlas(3)
    for level in range(4):
        texels = SIZE >> level
        v, u = np.meshgrid(*2 * [((np.arange(200) + 0.5) / texels).astype(np.float32)], indexing="ij")
        fine, coarse = (
            sample(atlas, u.ravel(), v.ravel(), np.full(u.size, k, np.float32)).reshape(u.shape)
            for k in (level, level + 1)
        )
        slopes = np.stack([part.ravel() for part in np.gradient(fine)], axis=1)
        shift_texels, *_ = np.linalg.lstsq(slopes, (coarse - fine).ravel(), rcond=None)
        assert np.abs(shift_texels).max() < 0.05


def test_texture_has_no_seam_and_turns_smooth_with_distance():
    atlas = texture_atlas(3)
    seam = np.array([-1e-5, 1e-5, 1 - 1e-5, 2 + 1e-5], dtype=np.float32)
    for level in range(LEVELS - 1):
        assert np.ptp(sample(atlas, seam, np.full_like(seam, 0.3), np.full_like(seam, level))) < 0.05
    u, v = np.random.default_rng(0).random((2, 10_000), dtype=np.float32)
    spreads = [sample(atlas, u, v, np.full_like(u, level)).std() for level in range(LEVELS)]
    assert spreads[0] == pytest.approx(1.0, abs=0.15)
    assert all(b < a for a, b in pairwise(spreads))
