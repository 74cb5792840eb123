"""How far a network goes by looks."""

import numpy as np
import pytest

from bench.methods.learned.inputs import FINE, ZERO
from bench.methods.learned.method import LearnedMethod
from bench.training.pairs import prepare
from benchmarks.looks import iou_by_looks, table


@pytest.fixture(scope="module")
def drive(tiny_card, tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    return prepare(tiny_card, "all", folder, disturbed=False, workers=1, progress=lambda *_: None)[0]


def test_what_geometry_knows_stays_and_looks_change(drive, monkeypatch):
    fine, shown = drive.fine()[0], []

    def bright(_, channels):  # goes by looks alone
        shown.append(channels)
        return (channels.fine[FINE.index("fine_current")] > ZERO + 40).astype(np.float32)

    monkeypatch.setattr(LearnedMethod, "scores", bright)
    found = iou_by_looks(LearnedMethod(), drive)
    grey = FINE.index("fine_current")
    as_is, negative, weak, none = (channels.fine[grey].astype(int) - ZERO for channels in shown)
    np.testing.assert_array_equal(as_is, fine[grey].astype(int) - ZERO)
    assert np.abs(negative + as_is).max() <= 1  # bytes have one value more below 0 than above
    assert np.abs(3 * weak - as_is).max() <= 2
    assert not none.any()
    for channels in shown[1:]:
        np.testing.assert_array_equal(np.delete(channels.fine, grey, 0), np.delete(shown[0].fine, grey, 0))
    assert found[3] == 0
    assert found[0] != found[1]


def test_points_lost_stand_beside_the_iou_of_images_in_which_something_moves():
    assert table({"a": np.array([[0.6, 0.4, 0.5, 0.3], [np.nan] * 4, [0.8, 0.6, 0.9, 0.1]])}).splitlines()[-1] == (
        "| a | 70.0 | -20.0 | +0.0 | -50.0 |"
    )
