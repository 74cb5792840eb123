import cv2
import numpy as np
import pytest

from bench.errors import ShapeError, UsageError
from bench.flow import LucasKanadeTracker


def picture(shift_u=0, shift_v=0, size=(160, 200)):
    """Periodic texture, moved by whole pixels."""
    noise = cv2.GaussianBlur(np.random.default_rng(0).uniform(0, 255, size).astype(np.float32), (0, 0), 2.0)
    start = cv2.normalize(noise, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    return np.roll(start, (shift_v, shift_u), axis=(0, 1))


def test_corners_of_the_newest_image_are_followed_back_through_all_images():
    tracks = LucasKanadeTracker()([picture(), picture(3, -2), picture(6, -4)])
    assert tracks.pixels.shape[0] == 3
    inner = (np.abs(tracks.pixels[0] - [100, 80]) < [70, 50]).all(axis=1)
    assert inner.sum() > 50
    assert tracks.followed[:, inner].all()
    np.testing.assert_allclose(tracks.pixels[1, inner] - tracks.pixels[0, inner], [[3, -2]] * inner.sum(), atol=0.1)
    np.testing.assert_allclose(tracks.pixels[2, inner] - tracks.pixels[0, inner], [[6, -4]] * inner.sum(), atol=0.2)


def test_what_is_gone_is_not_followed_and_stays_lost():
    previous = picture()
    previous[:, 100:] = 128  # the right half was not there before, and is again in the oldest image
    tracks = LucasKanadeTracker()([picture(), previous, picture()])
    gone, there = tracks.pixels[0, :, 0] > 110, tracks.pixels[0, :, 0] < 85
    assert gone.sum() > 50
    assert tracks.followed[0].all()
    assert not tracks.followed[1:, gone].any()
    assert np.isnan(tracks.pixels[1:, gone]).all()
    assert tracks.followed[:, there].mean() > 0.95
    assert (np.isfinite(tracks.pixels).all(axis=-1) == tracks.followed).all()


def test_the_way_back_must_lead_home():
    images = [picture(), picture(40, 0)]  # further than the pyramid without levels can follow
    plain = LucasKanadeTracker(levels=0, max_return_px=1e6)(images)
    checked = LucasKanadeTracker(levels=0)(images)
    assert plain.followed[1].sum() > 2 * checked.followed[1].sum()


def test_corners_lie_in_the_mask_and_apart():
    valid = np.zeros((160, 200), bool)
    valid[40:120, 50:150] = True
    tracks = LucasKanadeTracker(min_distance_px=9)([picture(), picture()], valid=valid)
    u, v = tracks.pixels[0].astype(int).T
    assert len(u) > 20
    assert valid[v, u].all()
    gaps = np.linalg.norm(tracks.pixels[0][:, None] - tracks.pixels[0], axis=-1) + 1e9 * np.eye(len(u))
    assert gaps.min() >= 9
    assert LucasKanadeTracker(corners=7)([picture(), picture()]).pixels.shape == (2, 7, 2)


def test_an_image_without_corners_has_no_tracks():
    flat = np.full((40, 50), 90, np.uint8)
    tracks = LucasKanadeTracker()([flat, flat, flat])
    assert tracks.pixels.shape == (3, 0, 2)
    assert tracks.followed.shape == (3, 0)


def test_bad_calls_are_refused():
    grey = np.zeros((10, 10), np.uint8)
    with pytest.raises(ShapeError, match="at least two images"):
        LucasKanadeTracker()([grey])
    with pytest.raises(ShapeError, match="of one size"):
        LucasKanadeTracker()([grey, grey[:, :9]])
    with pytest.raises(ShapeError, match="grey uint8"):
        LucasKanadeTracker()([grey, grey.astype(float)])
    for bad in ({"window_px": 4}, {"corners": 0}, {"quality": 0}, {"levels": 99}, {"max_return_px": 0}):
        with pytest.raises(UsageError, match="lucas-kanade: expected"):
            LucasKanadeTracker(**bad)
