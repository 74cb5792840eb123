"""Core and band of a region, how wide it is, and what a nearer band does to a farther object."""

import numpy as np
import pytest

from bench.records.rules import Limb, OutlineErrors
from bench.reference.bands import beyond_beam, pixels_per_radian, uncertain_region
from bench.reference.grid import Beam
from bench.reference.raster import Raster
from bench.reference.regions import Region
from bench.reference.scanned import Surface, limb_motion_m, outline_error_m
from bench.reference.silhouette import Prism
from tests.reference.drives import LENS, a_region

NOTHING = OutlineErrors(range_noise_m=0.0, angle_deg=0.0, position_m=0.0, limbs={})
VALID = np.ones((40, 60), dtype=bool)


def box_at(top: int, bottom: int, left: int, right: int) -> Raster:
    return Raster((slice(top, bottom), slice(left, right)), np.ones((bottom - top, right - left), dtype=bool))


def image_of(*rasters: Raster) -> np.ndarray:
    image = np.zeros(VALID.shape, dtype=bool)
    for raster in rasters:
        image[raster.window] |= raster.covered
    return image


SQUARE = box_at(10, 20, 20, 30)


def uncertain(raster=SQUARE, valid=VALID, *, half_width_px, returns_px=None, unseen=None, hidden=(), **given):
    """With one return in the middle of the raster, unless others are named."""
    middle = [[(axis.start + axis.stop) // 2 for axis in raster.window[::-1]]]
    widths = np.array(returns_px or middle), np.atleast_1d(half_width_px)
    surface = Surface(likely=np.zeros((0, 0), dtype=bool), corner=np.zeros(2, dtype=np.int64), **given)
    return uncertain_region(a_region(*raster), valid, surface, widths, unseen=unseen, hidden=hidden)


def parts(region: Region) -> tuple[np.ndarray, np.ndarray]:
    """Core and possible pixels of the image."""
    return image_of(Raster(region.window, region.core)), image_of(Raster(region.window, region.possible))


@pytest.mark.parametrize(("half_width_px", "by"), [(0.0, 0), (0.49, 0), (0.5, 1), (1.0, 1), (2.0, 2), (4.4, 4)])
def test_the_band_is_as_wide_on_either_side(half_width_px, by):
    """The centre of the first pixel lies half a pixel from the outline, that of the second one and a half."""
    core, possible = parts(uncertain(half_width_px=half_width_px))
    np.testing.assert_array_equal(core, image_of(box_at(10 + by, 20 - by, 20 + by, 30 - by)))
    grown = image_of(box_at(10 - by, 20 + by, 20 - by, 30 + by))
    assert not (possible & ~grown).any()  # its corners are round
    assert (grown & ~possible).sum() <= 4 * by**2
    assert (possible[15] == grown[15]).all()


def test_a_region_that_would_vanish_keeps_its_pixels():
    core, possible = parts(uncertain(half_width_px=6.0))
    np.testing.assert_array_equal(core, image_of(SQUARE))
    assert possible.sum() > core.sum()


def test_the_border_of_the_lens_is_no_outline():
    valid = VALID.copy()
    valid[:, :20] = False
    core, possible = parts(uncertain(valid=valid, half_width_px=2.0))
    np.testing.assert_array_equal(core, image_of(box_at(12, 18, 20, 28)))
    assert not (possible & ~valid).any()


def test_what_the_lidar_cannot_reach_or_tell_is_unknown():
    below, behind, certain = box_at(18, 30, 20, 30), box_at(8, 14, 16, 24), box_at(10, 20, 20, 28)
    core, possible = parts(uncertain(half_width_px=0.0, certain=certain, unseen=below, hidden=(behind, None)))
    np.testing.assert_array_equal(core, image_of(box_at(10, 18, 20, 28)))  # a shadow lies behind what is certain
    np.testing.assert_array_equal(possible, image_of(SQUARE, below, behind))


def test_the_band_lies_between_what_the_beams_leave_at_least_and_at_most():
    """Drawn in by 3 px and out by 4 below, where rows are far apart; the rest is as wide on either side."""
    core, possible = parts(uncertain(half_width_px=1.0, least=box_at(10, 17, 20, 30), most=box_at(19, 24, 20, 30)))
    np.testing.assert_array_equal(core, image_of(box_at(11, 16, 21, 29)))
    assert possible[9:25, 22:28].all()
    assert not possible[25:].any()
    assert not possible[:, 31:].any()


def test_the_band_is_as_wide_as_the_nearest_return_says():
    core, possible = parts(uncertain(half_width_px=[0.0, 2.0], returns_px=[[25, 11], [25, 18]]))
    assert core[10, 20:30].all()
    assert not core[18:20].any()
    assert possible[21, 22:28].all()
    assert not possible[9].any()


@pytest.mark.parametrize(
    ("causes", "unknown_m", "sensor_m", "expected_m"),
    [
        ({}, 0.0, (0, 0, 0), 0.0),
        ({"angle_deg": np.degrees(0.01)}, 0.0, (0, 0, 0), 0.05),
        ({"position_m": 0.05}, 0.0, (0, 0, 0), 0.05),
        ({}, 0.05, (0, 0, 0), 0.05),
        ({"range_noise_m": 0.1}, 0.0, (0, 0, -3.0), 0.0),  # from behind the camera none of the noise is seen,
        ({"range_noise_m": 0.05}, 0.0, (9.0, 0, 5.0), 0.05),  # from the side at a right angle all of it,
        ({"range_noise_m": 0.05}, 0.0, (5.0 * np.tan(np.radians(30)), 0, 0), 0.025),  # at 30 degrees half of it
        ({"angle_deg": np.degrees(0.01), "position_m": 0.05}, 0.0, (0, 0, 0), 0.05 * 2**0.5),  # variances add up
    ],
)
def test_causes_of_uncertainty_of_a_return_5_m_away(causes, unknown_m, sensor_m, expected_m):
    variance_m2, errors = np.array([unknown_m**2]), NOTHING.model_copy(update=causes)
    points = np.array([[0.0, 0.0, 5.0]])
    error_m = outline_error_m(points, sensor_camera=np.array(sensor_m), variance_m2=variance_m2, errors=errors)
    np.testing.assert_allclose(error_m, [expected_m], atol=1e-9)


def test_limbs_move_the_faster_the_farther_from_their_joint():
    """A leg and an arm; over 0.1 s, at a peak of sqrt(2) m/s, by 0.1 m."""
    limbs = (Limb(joint=0.5, end=0.0, speed=2.0), Limb(joint=0.8, end=0.4, speed=1.0))
    heights, times_ns = np.array([0.0, 0.25, 0.4, 0.6, 0.8, 1.0]), np.full(6, -100_000_000, dtype=np.int64)
    moved_m = limb_motion_m(limbs, heights, speed_mps=2**0.5, times_ns=times_ns)
    assert moved_m == pytest.approx([0.2, 0.1, 0.1, 0.05, 0.0, 0.0])
    assert limb_motion_m(limbs, heights, speed_mps=1.0, times_ns=0 * times_ns) == pytest.approx(np.zeros(6))


def test_a_radian_is_as_many_pixels_as_the_lens_says():
    scale = pixels_per_radian(LENS)
    assert scale[240, 320] == pytest.approx(170.0, rel=0.01)
    assert 50 < scale.min() < scale.max() < 500


def test_a_beam_that_meets_the_ends_of_a_side_at_the_bottom_passes_above_its_middle():
    """A beam that falls by a half: 1 m down at 2 m, where the side is nearest, and 1.25 m down at its ends at 2.5 m."""
    side = np.array([[x, y, z] for x in (-1.5, 1.5) for y in (2.0, 3.0) for z in (-1.25, 0.0)])
    part = beyond_beam(side, Beam(0.0, -0.5), end_m=-1.25)
    x, y, z = part.T
    assert part[z == z.max()].tolist() == [[pytest.approx(0.0), 2.0, pytest.approx(-1.0)]]
    assert np.abs(x).max() < 1.5
    assert (np.hypot(x, y)[z > -1.25] < 2.5).all()
    assert not len(beyond_beam(side, Beam(0.0, -1.0), end_m=-1.25))


def test_how_far_a_beam_runs_through_a_box():
    box = np.array([[[x, y, z] for x in (0.0, 4.0) for y in (-1.0, 1.0) for z in (0.0, 2.0)]])
    points = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 1.0], [5.0, 0.0, 1.0], [-3.0, 0.0, 1.0]])
    beams = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.6, 0.0, -0.8], [1.0, 0.0, 0.0], [0.6, 0.0, -0.8]])
    enter_m, leave_m = Prism.around(box).ways_m(points, beams)
    assert leave_m == pytest.approx([4.0, 1.25, 1.25, -1.0, 1.25])
    assert enter_m[[0, 4]] == pytest.approx([0.0, 5.0])  # the last meets the ground before it meets the box
    assert Prism.around(box, clearance_m=0.5).ways_m(points, beams)[1][2] == pytest.approx(0.625)
    assert Prism.around(np.empty((0, 8, 3))) is None
