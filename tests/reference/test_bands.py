"""Core and band of a region, how wide it is, and what a nearer band does to a farther object."""

from dataclasses import replace

import numpy as np
import pytest

from bench.geometry.raster import Raster
from bench.records.reference import Limb
from bench.reference import IgnoreReason, OutlineErrors, Status
from bench.reference.bands import pixels_per_radian, uncertain_region
from bench.reference.regions import Region, compose
from bench.reference.scanned import Surface, limb_motion_m, outline_error_m
from tests.reference.drives import LENS, a_region, an_object

NOTHING = OutlineErrors(range_noise_m=0.0, angle_rad=0.0, position_m=0.0, limbs={})
VALID = np.ones((40, 60), dtype=bool)
SQUARE = Raster((slice(10, 20), slice(20, 30)), np.ones((10, 10), dtype=bool))


def surface(**given):
    """What patches leave open, by rasters."""
    return Surface(likely=np.zeros((0, 0), dtype=bool), corner=np.zeros(2, dtype=np.int64), **given)


def uncertain(raster=SQUARE, valid=VALID, *, half_width_px, unseen=None, hidden=(), **given):
    """With returns in the middle of the raster alone."""
    middle = [[(axis.start + axis.stop) // 2 for axis in raster.window[::-1]]]
    widths = {"returns_px": np.array(middle), "half_width_px": np.array([half_width_px])}
    return uncertain_region(a_region(*raster), valid, surface(**given), **widths, unseen=unseen, hidden=hidden)


def whole(region: Region) -> tuple[np.ndarray, np.ndarray]:
    """Core and possible pixels of the image."""
    images = np.zeros((2, *VALID.shape), dtype=bool)
    images[0][region.window], images[1][region.window] = region.core, region.possible
    return images[0], images[1]


def a_box(top: int, bottom: int, left: int, right: int) -> np.ndarray:
    image = np.zeros(VALID.shape, dtype=bool)
    image[top:bottom, left:right] = True
    return image


@pytest.mark.parametrize(
    ("half_width_px", "less", "more"), [(0.0, 0, 0), (0.49, 0, 0), (0.5, 1, 1), (1.0, 1, 1), (2.0, 2, 2), (4.4, 4, 4)]
)
def test_the_band_is_as_wide_on_either_side(half_width_px, less, more):
    """The centre of the first pixel lies half a pixel from the outline, that of the second one and a half."""
    core, possible = whole(uncertain(half_width_px=half_width_px))
    np.testing.assert_array_equal(core, a_box(10 + less, 20 - less, 20 + less, 30 - less))
    grown = a_box(10 - more, 20 + more, 20 - more, 30 + more)
    assert not (possible & ~grown).any()  # its corners are round
    assert (grown & ~possible).sum() <= 4 * more**2
    assert (possible[15] == grown[15]).all()


def test_a_region_that_would_vanish_keeps_its_pixels():
    core, possible = whole(uncertain(half_width_px=6.0))
    np.testing.assert_array_equal(core, a_box(10, 20, 20, 30))
    assert possible.sum() > core.sum()


def test_the_border_of_the_lens_is_no_outline():
    valid = VALID.copy()
    valid[:, :20] = False
    core, possible = whole(uncertain(valid=valid, half_width_px=2.0))
    np.testing.assert_array_equal(core, a_box(12, 18, 20, 28))
    assert not (possible & ~valid).any()


def test_what_the_lidar_cannot_reach_or_tell_is_unknown():
    below = Raster((slice(18, 30), slice(20, 30)), np.ones((12, 10), dtype=bool))
    behind = Raster((slice(8, 14), slice(16, 24)), np.ones((6, 8), dtype=bool))
    certain = Raster((slice(10, 20), slice(20, 28)), np.ones((10, 8), dtype=bool))
    core, possible = whole(uncertain(half_width_px=0.0, certain=certain, unseen=below, hidden=(behind,)))
    np.testing.assert_array_equal(core, a_box(10, 18, 20, 28))  # a shadow lies behind what is certain
    np.testing.assert_array_equal(possible, a_box(10, 30, 20, 30) | a_box(8, 14, 16, 24))


def test_the_band_lies_between_what_the_beams_leave_at_least_and_at_most():
    """Drawn in by 3 px and out by 4 below, where rows are far apart; the rest is as wide on either side."""
    least = Raster((slice(10, 17), slice(20, 30)), np.ones((7, 10), dtype=bool))
    most = Raster((slice(19, 24), slice(20, 30)), np.ones((5, 10), dtype=bool))
    core, possible = whole(uncertain(half_width_px=1.0, least=least, most=most))
    np.testing.assert_array_equal(core, a_box(11, 16, 21, 29))
    assert possible[9:25, 22:28].all()
    assert not possible[25:].any()
    assert not possible[:, 31:].any()


def test_the_band_is_as_wide_as_the_nearest_return_says():
    widths = {"returns_px": np.array([[25, 11], [25, 18]]), "half_width_px": np.array([0.0, 2.0])}
    core, possible = whole(uncertain_region(a_region(*SQUARE), VALID, surface(), **widths, unseen=None, hidden=()))
    assert core[10, 20:30].all()
    assert not core[18:20].any()
    assert possible[21, 22:28].all()
    assert not possible[9].any()


def test_a_farther_core_in_a_nearer_band_is_unknown():
    near = uncertain(half_width_px=1.0)
    far = uncertain(Raster((slice(5, 25), slice(25, 45)), np.ones((20, 20), dtype=bool)), half_width_px=1.0)
    objects = [(replace(an_object(Status.EVALUATED), track_id=name), region)
               for name, region in (("near", near), ("far", far))]  # fmt: skip
    (first, second), labels, ignored, unknown = compose(*zip(*objects, strict=True), VALID)
    near_core, near_possible = whole(near)
    far_core, far_possible = whole(far)
    np.testing.assert_array_equal(labels == 1, near_core)
    np.testing.assert_array_equal(labels == 2, far_core & ~near_possible)
    np.testing.assert_array_equal(ignored, (near_possible | far_possible) & (labels == 0))
    np.testing.assert_array_equal(unknown, ignored)
    assert (first.region_px, first.unknown_px) == (near_core.sum(), (near_possible & ~near_core).sum())
    assert second.unknown_px == (far_possible & ~near_core & (labels != 2)).sum()


def test_an_object_within_a_nearer_band_is_ignored():
    near = replace(a_region(*SQUARE), core=np.zeros((10, 10), dtype=bool))
    near.core[0, 0] = True
    far = a_region((slice(12, 14), slice(22, 24)), np.ones((2, 2), bool))
    statuses = [an_object(Status.STATIC), an_object(Status.EVALUATED)]
    settled, labels, ignored, unknown = compose(statuses, [near, far], VALID)
    assert settled[1].reason is IgnoreReason.OCCLUDED
    assert not labels.any()
    assert not unknown.any()
    np.testing.assert_array_equal(ignored, a_box(12, 14, 22, 24))


def error_m(errors=NOTHING, *, unknown_m=0.0, sensor_m=(0.0, 0.0, 0.0)):
    """Of a return 5 m away."""
    (error,) = outline_error_m(
        np.array([[0.0, 0.0, 5.0]]),
        sensor_camera=np.array(sensor_m),
        variance_m2=np.array([unknown_m**2]),
        errors=errors,
    )
    return error


def test_each_cause_alone():
    assert error_m() == 0
    assert error_m(replace(NOTHING, angle_rad=0.01)) == pytest.approx(0.05)
    assert error_m(replace(NOTHING, position_m=0.05)) == pytest.approx(0.05)
    assert error_m(unknown_m=0.05) == pytest.approx(0.05)
    assert error_m(replace(NOTHING, range_noise_m=0.1), sensor_m=(0, 0, -3.0)) == pytest.approx(0.0)
    # Seen from the side at a right angle, all of the noise; at 30 degrees, half of it.
    assert error_m(replace(NOTHING, range_noise_m=0.05), sensor_m=(9.0, 0, 5.0)) == pytest.approx(0.05)
    aside = 5.0 * np.tan(np.radians(30))
    assert error_m(replace(NOTHING, range_noise_m=0.05), sensor_m=(aside, 0, 0)) == pytest.approx(0.025)


def test_causes_add_up_as_variances():
    both = replace(NOTHING, angle_rad=0.01, position_m=0.05)
    assert error_m(both) == pytest.approx(0.05 * 2**0.5)


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
    assert np.isfinite(scale).all()
    assert 50 < scale.min() < scale.max() < 500
