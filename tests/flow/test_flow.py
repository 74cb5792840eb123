import cv2
import numpy as np
import pytest

from bench.errors import ShapeError, UnknownNameError, UsageError
from bench.flow.dense import DENSE_FLOWS, cell_mean, dense_flow
from bench.flow.tracks import LucasKanadeTracker

GREY = np.zeros((10, 10), np.uint8)


def picture(shift_u=0, shift_v=0, size=(160, 200)):
    """Periodic texture, moved by whole pixels."""
    noise = cv2.GaussianBlur(np.random.default_rng(0).uniform(0, 255, size).astype(np.float32), (0, 0), 2.0)
    start = cv2.normalize(noise, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    return np.roll(start, (shift_v, shift_u), axis=(0, 1))


@pytest.mark.parametrize("name", sorted(DENSE_FLOWS))
def test_flow_points_from_the_first_image_to_the_second_and_does_not_remember_the_last_pair(name):
    flow = dense_flow(name)
    first = flow(picture(), picture(3, -2))
    assert first.shape == (160, 200, 2)
    np.testing.assert_allclose(np.median(first[20:-20, 20:-20], axis=(0, 1)), [3, -2], atol=0.1)
    flow(picture(), picture(-4, 1))
    np.testing.assert_array_equal(first, flow(picture(), picture(3, -2)))


def test_cell_mean_by_hand():
    values = np.arange(20, dtype=np.float32).reshape(4, 5)
    # Cells of 2: the fifth column is repeated to fill the last cell.
    expected = [[(0 + 1 + 5 + 6) / 4, (2 + 3 + 7 + 8) / 4, (4 + 9) / 2], [13, 15, 16.5]]
    np.testing.assert_allclose(cell_mean(values, 2), expected)
    np.testing.assert_allclose(cell_mean(np.dstack([values, -values]), 2)[..., 1], -np.array(expected))


@pytest.mark.parametrize(
    ("call", "error", "told"),
    [
        (lambda: dense_flow("dis")(GREY, GREY[:, :9]), ShapeError, "flow: expected grey uint8 images of one size"),
        (lambda: dense_flow("farnebeck"), UnknownNameError, "farneback"),
        (lambda: dense_flow("dis", preset="slow"), UnknownNameError, "medium"),
        (lambda: dense_flow("dis")(GREY, GREY), UsageError, "at least 12 px a side, got 10 x 10"),
        (lambda: dense_flow("farneback", window=3), UsageError, "window"),
        (lambda: cell_mean(GREY, 10**30), ShapeError, f"from 1 to 10, got {10**30}"),
        (lambda: cell_mean(GREY, 0), ShapeError, "from 1 to 10, got 0"),
        (lambda: LucasKanadeTracker()([GREY]), ShapeError, "at least two images"),
        (lambda: LucasKanadeTracker()([GREY, GREY[:, :9]]), ShapeError, "of one size"),
        (lambda: LucasKanadeTracker()([GREY, GREY.astype(float)]), ShapeError, "grey uint8"),
        (lambda: LucasKanadeTracker(window_px=4), UsageError, "lucas-kanade: expected"),
        (lambda: LucasKanadeTracker(corners=0), UsageError, "lucas-kanade: expected"),
        (lambda: LucasKanadeTracker(quality=0), UsageError, "lucas-kanade: expected"),
        (lambda: LucasKanadeTracker(levels=99), UsageError, "lucas-kanade: expected"),
        (lambda: LucasKanadeTracker(max_return_px=0), UsageError, "lucas-kanade: expected"),
    ],
)
def test_what_cannot_be_done_is_refused(call, error, told):
    with pytest.raises(error, match=told):
        call()


def test_corners_of_the_newest_image_are_followed_back_through_all_images():
    tracks = LucasKanadeTracker()([picture(), picture(3, -2), picture(6, -4)])
    assert tracks.pixels.shape[0] == 3
    inner = (np.abs(tracks.pixels[0] - [100, 80]) < [70, 50]).all(axis=1)
    assert inner.sum() > 50
    assert tracks.followed[:, inner].all()
    for number, shift in ((1, [3, -2]), (2, [6, -4])):
        moved_px = tracks.pixels[number, inner] - tracks.pixels[0, inner]
        np.testing.assert_allclose(moved_px - shift, 0.0, atol=0.1 * number)


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
