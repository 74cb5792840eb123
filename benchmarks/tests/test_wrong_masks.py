"""Masks that are wrong by construction are wrong in the way that their name says."""

import numpy as np
import pytest

from bench.harness.frames import FramePipeline, InputOnly
from bench.recordings import load_card, open_dataset, read_truth
from benchmarks.ranking.wrong_masks import WrongMasks, merged, with_ghost
from tests.evaluation.frames import picture
from tests.support.runs import PAPER


def wrong_mask(tiny_card, index=2, **settings):
    """The mask of an image of a simulated drive."""
    handle = next(h for h in open_dataset(load_card(str(tiny_card))) if h.name == "crossing")
    recording = handle.open()
    pipeline = FramePipeline(recording, "front", method=InputOnly(), protocol=PAPER)
    ids = read_truth(pipeline.images[index], pipeline.camera)
    return WrongMasks(**settings).of_truth(ids, recording, pipeline.reference(index)).mask


def filled_box(mask: np.ndarray) -> np.ndarray:
    return mask.any(axis=1)[:, None] & mask.any(axis=0)


def lowest_row(mask: np.ndarray) -> int:
    return int(np.flatnonzero(mask.any(axis=1))[-1])


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"grow_px": 3}, lambda wrong, exact: (wrong[exact].all(), wrong.sum() > exact.sum())),
        ({"grow_px": -2}, lambda wrong, exact: (exact[wrong].all(), wrong.sum() < exact.sum())),
        ({"shape": "hull"}, lambda wrong, exact: (wrong[exact].all(), wrong.sum() > exact.sum())),
        ({"shape": "upper_half"}, lambda wrong, exact: (exact[wrong].all(), 0 < wrong.sum() < 0.9 * exact.sum())),
        ({"shift_px": 4}, lambda wrong, exact: (np.array_equal(wrong[:, 4:], exact[:, :-4]), not wrong[:, :4].any())),
        ({"shape": "box"}, lambda wrong, exact: (wrong[exact].all(), np.array_equal(wrong, filled_box(exact)))),
        ({"shape": "feet"}, lambda wrong, exact: (exact[wrong].all(), 0 < wrong.sum() < 0.4 * exact.sum())),
        ({"drop_share": 1}, lambda wrong, exact: (exact.any(), not wrong.any())),
        ({"drop_share": 0.0}, lambda wrong, exact: (np.array_equal(wrong, exact),)),
        ({"shadow": 0.5}, lambda wrong, exact: (wrong[exact].all(), lowest_row(wrong) > lowest_row(exact))),
        ({"merge_px": 50}, lambda wrong, exact: (np.array_equal(wrong, exact),)),  # one object has no neighbour
    ],
)
def test_masks_that_are_wrong_in_a_known_way(tiny_card, settings, expected):
    exact = wrong_mask(tiny_card)
    assert all(expected(wrong_mask(tiny_card, **settings), exact))


def test_a_late_mask_is_that_of_an_earlier_image(tiny_card):
    late, earlier = wrong_mask(tiny_card, index=3, lag_images=2), wrong_mask(tiny_card, index=1)
    assert np.array_equal(late, earlier)


def test_a_ghost_is_a_copy_beside_the_object():
    two_wide = picture("11......\n.1......") > 0
    assert np.array_equal(with_ghost(two_wide, 1), picture("1111....\n.1.1....") > 0)
    assert np.array_equal(with_ghost(two_wide, 2.5), picture("11...11.\n.1....1.") > 0)


def test_neighbours_are_one_with_their_common_hull():
    left, right, far = (picture("11.22...3") == number for number in (1, 2, 3))
    assert np.array_equal(np.logical_or.reduce(merged([left, right, far], 2)), picture("11111...1") > 0)
    assert np.array_equal(np.logical_or.reduce(merged([left, right, far], 1)), picture("11.11...1") > 0)
