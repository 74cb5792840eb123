"""Agreement over time: what appears once is doubted, what is followed is completed, and nothing depends on notes."""

import pickle
from dataclasses import dataclass

import numpy as np
import pytest

from bench.methods import Method, Segmentation, build_method
from tests.support.board_scene import drive

IMAGES = 4
HERE = f"{__name__}:MarksBoard"
BOARD = {"board_m": (3.0, -0.6, 0.0), "sideways_m": 0.1}


@dataclass(frozen=True, kw_only=True)
class MarksBoard(Method):
    """Marks the board, but for the images in which it marks something else."""

    wrong: tuple[int, ...] = ()
    scores: bool = False
    name = "marks-board"

    def segment(self, given):
        number = round(given.timestamps_ns[-1] / 66_666_667)
        *_, board = drive(range(number - 1, number + 1), **BOARD)[1]
        if number in self.wrong:
            board = np.zeros_like(board)
            board[60:100, 60:120] = True
        if not self.scores:
            return Segmentation(cell_size_px=1, mask=board)
        score = np.where(board, np.float32(0.9), np.float32(0.1))
        return Segmentation(cell_size_px=1, mask=board, likelihood=score, likelihood_is_score=True, threshold=0.4)


def followed(images=3, **parameters):
    return build_method("followed", {"method": HERE, "parameters": parameters, "images": images})


def overlap(one, other):
    return (one & other).sum() / (one | other).sum()


@pytest.mark.parametrize("scores", [False, True])
def test_what_appears_once_is_doubted_and_what_was_there_before_is_completed(scores):
    given, boards = drive(range(IMAGES), **BOARD)
    method = followed(wrong=[IMAGES - 1], scores=scores)
    found = method.segment(given)
    assert not found.mask[60:100, 60:120].any()
    assert overlap(found.mask, boards[-1]) > 0.8
    alone = followed(images=1, wrong=[IMAGES - 1], scores=scores).segment(given)
    assert alone.mask[60:100, 60:120].all()
    assert (found.likelihood is not None) == scores
    assert found.threshold is None
    assert (alone.threshold is not None) == scores
    before = followed(wrong=[IMAGES - 2], scores=scores).segment(given)  # what was marked once before is forgotten
    assert not before.mask[60:100, 60:120].any()
    assert overlap(before.mask, boards[-1]) > 0.9
    # At the start of a drive the images that there are agree.
    start, boards = drive(range(2), **BOARD)
    np.testing.assert_array_equal(followed(scores=scores).segment(start).mask, boards[-1])


def test_one_who_has_seen_the_images_before_answers_as_one_who_has_not():
    method = followed(wrong=[2])
    later, _ = drive(range(1, IMAGES + 1), **BOARD)
    method.segment(drive(range(IMAGES), **BOARD)[0])
    np.testing.assert_array_equal(method.segment(later).mask, followed(wrong=[2]).segment(later).mask)
    travelled = pickle.loads(pickle.dumps(method))
    np.testing.assert_array_equal(travelled.segment(later).mask, method.segment(later).mask)


def test_it_looks_as_far_back_as_the_method_does_on_its_earliest_image():
    assert (followed().history, followed().longest_history) == (1, 3)
    long = build_method("followed", {"method": "rigid-scene", "images": 4})
    assert (long.history, long.longest_history) == (1, 6)
