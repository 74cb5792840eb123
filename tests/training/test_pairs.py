"""Pairs of images with exact masks, and the inputs that are prepared from them."""

import shutil

import numpy as np
import pytest

from bench.errors import DataError, UnknownNameError
from bench.methods.learned.inputs import COARSE, FINE, ZERO
from bench.training import training_pairs
from bench.training.pairs import prepare


@pytest.fixture(scope="module")
def card(tiny_card, tmp_path_factory):
    """The tiny data set with one drive held out."""
    card = tmp_path_factory.mktemp("cards") / "tiny.yaml"
    text = tiny_card.read_text().replace("data/tiny", str(tiny_card.parent / "data" / "tiny"))
    text = text.replace("scenario: tiny.scenario.yaml", "")
    card.write_text(text.replace('all: "*"', 'all: "*"\n  validation: [standing]'))
    return card


def test_pairs_hold_what_a_network_learns_from(card):
    pairs = list(training_pairs(card))
    assert {pair.recording for pair in pairs} == {"crossing", "overtaking"}
    assert len(pairs) == 8
    first = pairs[0]
    assert [image.shape for image in first.input.images] == [(240, 320)] * 2
    assert first.exact is not None
    assert first.exact.shape == first.input.valid.shape == (240, 320)
    assert first.exact.any()
    assert not first.exact[first.reference.labels == 0].all()  # more than lidar polygons show, less than the image
    assert len(first.input.current_from_previous) == 1


def test_a_drive_is_in_one_part_as_a_whole(card):
    drives = {part: {pair.recording for pair in training_pairs(card, part=part)} for part in ("training", "validation")}
    assert drives["validation"] == {"standing"}
    assert not drives["training"] & drives["validation"]
    assert len(list(training_pairs(card, part="all", every=2))) == 6


def test_data_without_a_split_or_masks_are_refused(card, tiny_card, tmp_path):
    with pytest.raises(UnknownNameError, match="validation"):
        next(training_pairs(tiny_card))
    shutil.copytree(tiny_card.parent / "data" / "tiny" / "crossing", tmp_path / "drives" / "crossing")
    shutil.rmtree(tmp_path / "drives" / "crossing" / "truth")
    (tmp_path / "bare.yaml").write_text("name: bare\ntitle: bare\nadapter: native\nroot: drives\nlicence: CC0-1.0\n")
    with pytest.raises(DataError, match="expected exact masks"):
        next(training_pairs(tmp_path / "bare.yaml", part="all"))


def test_earlier_images_come_along_where_there_are_some(card):
    pairs = list(training_pairs(card, longest_history=3))
    crossing = [len(pair.input.images) for pair in pairs if pair.recording == "crossing"]
    assert crossing == [2, 3, 4, 4]


@pytest.mark.parametrize("disturbed", [False, True])
def test_inputs_are_prepared_once(card, tmp_path, disturbed):
    told = []

    def prepared():
        return prepare(
            card, "validation", tmp_path, disturbed=disturbed, workers=1, progress=lambda *count: told.append(count)
        )

    (drive,) = prepared()
    coarse, fine = drive.coarse(), drive.fine()
    images = 3  # that have an earlier one
    assert coarse.shape == (images, len(COARSE), 120, 160)
    assert fine.shape == (images, len(FINE) + 1, 240, 320)
    assert coarse.dtype == fine.dtype == np.uint8
    moving = fine[:, -1] > 127
    sigmas = coarse[:, COARSE.index("sigmas")].astype(int) - ZERO
    seen = sigmas.repeat(2, axis=1).repeat(2, axis=2)
    assert 0 < moving.mean() < 0.05
    assert seen[moving].mean() > 5 * seen[~moving].mean()  # the ego vehicle stands: what moves has flow
    (again,) = prepared()
    assert told == [(0, 1), (1, 1), (1, 1)]
    np.testing.assert_array_equal(again.coarse(), coarse)
