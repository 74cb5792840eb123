"""Lamps light spots by hand-checked amounts, however many spots there are."""

from __future__ import annotations

import numpy as np
import pytest

from bench.synthesis.imaging.lights import BEAM_HEIGHT, BEAM_WIDTH, NO_LAMPS, Lamps
from bench.synthesis.imaging.shading import (
    ABOVE,
    CUT_OFF,
    HEADLIGHT,
    LANES,
    PIXELS,
    SPOT_LIGHT,
    SPOT_TOWARDS_X,
    SPOT_TOWARDS_Y,
    SPOT_TOWARDS_Z,
    SPOT_X,
    SPOT_Y,
    SPOT_Z,
    light_spots,
)  # fmt: skip

AHEAD = np.eye(3, dtype=np.float32)  # the headlight looks along z, y is down
UP, TOWARDS = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)


def lit(spots_m: list[tuple[float, float, float]], normal: tuple[float, float, float], lamps: Lamps) -> np.ndarray:
    lanes = np.full(LANES, np.nan, dtype=np.float32)
    for start, axis in ((SPOT_X, 0), (SPOT_Y, 1), (SPOT_Z, 2)):
        lanes[start : start + len(spots_m)] = [spot[axis] for spot in spots_m]
    for start, value in zip((SPOT_TOWARDS_X, SPOT_TOWARDS_Y, SPOT_TOWARDS_Z), normal, strict=True):
        lanes[start : start + len(spots_m)] = value
    light_spots(len(spots_m), lamps, lanes)
    return lanes[SPOT_LIGHT : SPOT_LIGHT + len(spots_m)]


def street(*places_m: tuple[float, float, float]) -> Lamps:
    return NO_LAMPS._replace(street_m=np.array(places_m, dtype=np.float32))


def headlight(inverse_depth: float) -> Lamps:
    """One at the origin, that meets something at 1 / `inverse_depth` everywhere."""
    pictures = np.full((2, BEAM_HEIGHT, BEAM_WIDTH), inverse_depth, dtype=np.float32)
    return NO_LAMPS._replace(lamp_from_world=np.stack([AHEAD, AHEAD]), inverse_depth=pictures, headlights=1)


def test_below_a_street_lamp_six_metres_up() -> None:
    # 1200 cd / (6 m)^2 = 33.3 lux, and 15 lux are white.
    assert lit([(0.0, 0.0, 0.0)], UP, street((0.0, 0.0, 6.0)))[0] == pytest.approx(33.333 / 15, rel=1e-4)


def test_beside_a_street_lamp() -> None:
    # 6 m aside and 6 m below, the square of the distance is 72 m^2; the cosine of 45 degrees counts on the ground, and
    # once more below the lamp.
    light = lit([(6.0, 0.0, 0.0)], UP, street((0.0, 0.0, 6.0)))[0]
    assert light == pytest.approx(1200 / 72 / 2 / 15, rel=1e-4)


def test_light_of_several_lamps_adds_up() -> None:
    places = [(0.0, 0.0, 6.0), (10.0, 3.0, 5.0), (-4.0, -8.0, 7.0)]
    alone = [lit([(1.0, 2.0, 0.0)], UP, street(place))[0] for place in places]
    assert lit([(1.0, 2.0, 0.0)], UP, street(*places))[0] == pytest.approx(sum(alone), rel=1e-6)


def test_a_lamp_lights_nothing_above_it_or_turned_away() -> None:
    assert lit([(1.0, 0.0, 7.0)], (0.0, 0.0, -1.0), street((0.0, 0.0, 6.0)))[0] == 0.0
    assert lit([(1.0, 0.0, 0.0)], (0.0, 0.0, -1.0), street((0.0, 0.0, 6.0)))[0] == 0.0


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 33, PIXELS])
def test_a_spot_has_its_light_whatever_spots_are_beside_it(count: int) -> None:
    rng = np.random.default_rng(0)
    spots = [(float(x), float(y), float(z)) for x, y, z in rng.uniform((-6, 0.1, -2), (6, 2, 30), (count, 3))]
    lamps = headlight(1 / 12)._replace(street_m=np.array([[0, -5, 9], [4, -2, 20]], dtype=np.float32))
    together = lit(spots, TOWARDS, lamps)
    assert np.array_equal(together, [lit([spot], TOWARDS, lamps)[0] for spot in spots])


def test_at_the_cut_off_of_a_headlight() -> None:
    # Straight ahead at the cut-off the whole 20,000 cd arrive, at 10 m of them 200 lux.
    down = 10.0 * float(CUT_OFF)
    light = lit([(0.0, down, 10.0)], TOWARDS, headlight(0.0))[0]
    assert light == pytest.approx(20_000 / 100 / 15, rel=2e-3)
    assert light == pytest.approx(float(HEADLIGHT) / 100, rel=2e-3)


def test_above_the_cut_off_little_is_left() -> None:
    light = lit([(0.0, -1.0, 10.0)], TOWARDS, headlight(0.0))[0]
    assert light == pytest.approx(float(HEADLIGHT * ABOVE) * 10 / 101**1.5, rel=1e-2)


def test_a_headlight_lights_neither_what_is_behind_it_nor_what_is_hidden() -> None:
    assert lit([(0.0, 0.1, -10.0)], UP, headlight(0.0))[0] == 0.0
    assert lit([(0.0, 0.1, 10.0)], TOWARDS, headlight(1 / 5))[0] == 0.0
    assert lit([(0.0, 0.1, 10.0)], TOWARDS, headlight(1 / 10))[0] > 1.0
