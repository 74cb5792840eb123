"""Masks and scores of other programs: what a file says, at which sizes, and which image it is of."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from bench.errors import DataError
from bench.methods.predictions import PredictedMotion, PredictionIndex
from bench.methods.predictions.maps import ImageSizes, Prediction
from bench.methods.predictions.pairing import ImageKey, NamedImage, named_images
from bench.recordings import Exclusion, ImageRef, load_card, open_dataset
from tests.hostile.files import png
from tests.support.board_scene import crossing

SIZES = ImageSizes(evaluated_px=(6, 4), stored_px=(6, 4))
MASK = np.array([[0, 0, 0, 0, 0, 1], [0, 1, 1, 0, 0, 1], [0, 0, 1, 0, 0, 0], [0, 0, 0, 0, 0, 0]], dtype=bool)
STEP_NS = 66_666_667


def read(folder, content, *, are_scores=False):
    file = folder / "a.png"
    if isinstance(content, bytes):
        file.write_bytes(content)
    else:
        assert cv2.imwrite(str(file), content)
    prediction = Prediction(root=folder, files=(file,), sizes=SIZES, are_scores=are_scores)
    return prediction.values(prediction.content())


def encoded(values, *options) -> bytes:
    return cv2.imencode(".png", values, options)[1].tobytes()


WHITE = MASK.astype(np.uint8) * 255


@pytest.mark.parametrize("content", [MASK.astype(np.uint8), WHITE, encoded(WHITE, cv2.IMWRITE_PNG_BILEVEL, 1)])
def test_a_mask_of_either_scale_or_of_one_bit(tmp_path, content):
    moving = read(tmp_path, content)
    assert moving.dtype == bool
    np.testing.assert_array_equal(moving, MASK)


def test_16_bits_are_scores_where_the_folder_says_so_and_masks_are_none(tmp_path):
    values = np.zeros((4, 6), dtype=np.uint16)
    values[0, :3] = 65535, 32768, 1
    scores = read(tmp_path, values, are_scores=True)
    assert scores.dtype == np.float32
    np.testing.assert_allclose(scores[0, :4], [1, 32768 / 65535, 1 / 65535, 0], rtol=1e-6)
    with pytest.raises(DataError, match=r"expected scores of 16 bits, as predictions.yaml says, got 8 bits"):
        read(tmp_path, MASK.astype(np.uint8), are_scores=True)


@pytest.mark.parametrize(
    ("values", "got"),
    [
        (np.array([0, 1, 255], np.uint8), "8 bits, the values 0, 1, 255"),
        (np.arange(8, dtype=np.uint8), r"8 bits, the values 0, 1, 2, 3, 4, 5 and 2 more"),
        (np.array([0, 1], np.uint16), "16 bits, the values 0, 1"),
    ],
)
def test_values_of_no_mask_are_refused_with_the_remedy(tmp_path, values, got):
    with pytest.raises(DataError, match=f"got {got}; write scores as 16-bit PNG .* `sixteen_bits: score`"):
        read(tmp_path, np.resize(values, (4, 6)))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "got an empty file"),
        (b"GIF89a", "6 bytes that begin with 47 49 46"),
        (encoded(np.zeros((4, 6), np.uint8))[:20], "a PNG cut short at 20 bytes"),
        (cv2.imencode(".jpg", np.zeros((4, 6), np.uint8))[1].tobytes(), "expected a PNG, .* got a JPEG"),
        (encoded(np.zeros((4, 6, 3), np.uint8)), "expected one grey channel, got 3 channels"),
        (png(6, 4, colour=3, rows=bytes(7) * 4), "expected a PNG of grey values, got an indexed one"),
        (png(6, 4, bits=7), "expected a whole PNG"),
        (png(60_000, 40_000), "at most 67108864 px, got 60000 x 40000"),
        (encoded(np.zeros((5, 6), np.uint8)), "expected 6 x 4 px, or a whole fraction or multiple of it, got 6 x 5"),
    ],
)
def test_what_is_no_mask_is_refused(tmp_path, content, message):
    with pytest.raises(DataError, match=message):
        read(tmp_path, content)


def test_a_file_too_large_is_refused(tmp_path):
    with (tmp_path / "a.png").open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(DataError, match="got 1099511627776 bytes, over the limit of 268435456"):
        Prediction(root=tmp_path, files=(tmp_path / "a.png",), sizes=SIZES, are_scores=False).content()


HALVED = ImageSizes(evaluated_px=(8, 4), stored_px=(16, 8))


def test_whole_fractions_and_multiples_pass_and_others_are_refused_with_both_sizes_that_are_known():
    for size in [(8, 4), (4, 2), (2, 1), (16, 8), (24, 12), (32, 16), (80, 40)]:
        HALVED.refuse_unfit(size, file=Path("a.png"))
    for size in [(4, 8), (1, 1), (8, 8), (7, 4), (12, 6), (0, 0), (4, 1), (160_000, 4)]:
        with pytest.raises(DataError, match=rf"8 x 4 or 16 x 8 px, or a whole fraction .* got {size[0]} x {size[1]}"):
            HALVED.refuse_unfit(size, file=Path("a.png"))


def test_a_smaller_map_is_cells_and_a_larger_one_the_mean_of_each_pixels_block():
    mask = np.array([[True, False, False, True], [False, True, False, False]])
    cells, cell_px = HALVED.on_cells(mask)
    assert cell_px == 2
    np.testing.assert_array_equal(cells, mask)
    large = np.zeros((12, 24), dtype=np.float32)
    large[0:3, 3:6] = np.arange(9).reshape(3, 3) / 8
    large[3:5, 0:3] = 1
    cells, cell_px = HALVED.on_cells(large)
    assert (cell_px, cells.shape) == (1, (4, 8))
    assert (cells[0, 1], cells[1, 0]) == (0.5, np.float32(6 / 9))
    assert np.count_nonzero(cells) == 2


@pytest.mark.parametrize("scale", [1, 2, 4])  # half of the stored size, the stored size, twice the stored size
def test_a_map_that_fits_the_stored_size_only_goes_by_way_of_it(scale):
    sizes = ImageSizes(evaluated_px=(6, 3), stored_px=(8, 4))
    left_half = np.repeat(np.arange(4)[None] < 2, 2, axis=0)
    cells, cell_px = sizes.on_cells(left_half.repeat(scale, axis=0).repeat(scale, axis=1))
    assert (cell_px, cells.shape) == (1, (3, 6))
    np.testing.assert_array_equal(cells >= 0.5, np.arange(6)[None, :].repeat(3, axis=0) < 3)


@pytest.mark.parametrize(
    ("values", "threshold", "moving"),
    [
        (np.uint8([[1, 1], [0, 0]]), None, True),  # half of the block of a pixel
        (np.uint8([[1, 0], [0, 0]]), None, False),
        (np.uint16([[32768]]), float(np.float32(32768) / np.float32(65535)), False),  # at the threshold
        (np.uint16([[32769]]), float(np.float32(32768) / np.float32(65535)), True),
    ],
)
def test_half_of_a_block_moves_and_a_score_at_the_threshold_does_not(tmp_path, values, threshold, moving):
    assert cv2.imwrite(str(tmp_path / "a.png"), np.tile(values, (4, 6)))
    are_scores = threshold is not None
    if are_scores:
        (tmp_path / "predictions.yaml").write_text("sixteen_bits: score")
    given = replace(crossing()[0], recording="drive", camera_name="front")
    key, index = ImageKey("drive", "front", given.timestamps_ns[-1]), PredictionIndex(tmp_path)
    index.take(NamedImage(key=key, places=("a",), sizes=SIZES, is_scored=True))
    method = PredictedMotion(name="masks", folder=str(tmp_path), dataset="tiny", threshold=threshold)
    method.use(index)
    found = method.segment(given)
    assert (found.cell_size_px, found.mask.shape) == (1, (4, 6))
    assert found.mask.all() if moving else not found.mask.any()


@pytest.fixture
def recording(tiny_card):
    return open_dataset(load_card(str(tiny_card)))[0].open()


def listed(recording, names, exclusions=(), *, alone=False):
    """The images of a drive whose k-th image has the k-th name."""
    refs = (ImageRef(camera="front", timestamp_ns=k * STEP_NS, path=Path(f"{name}.png")) for k, name in names.items())
    return list(named_images(replace(recording, images={"front": tuple(refs)}), exclusions, alone=alone))


def test_an_image_is_named_by_its_file_or_its_time_below_recording_and_camera(recording):
    camera = recording.cameras["front"]
    smaller = replace(recording, cameras={"front": replace(camera, model=camera.model.scaled(160, 120))})
    (image,) = listed(smaller, {3: "00003_FV"})
    assert image.places == ("crossing/front/00003_FV", "crossing/front/200000001")
    assert (image.sizes.evaluated_px, image.sizes.stored_px) == ((160, 120), (320, 240))
    (image,) = listed(recording, {3: "200000001"}, alone=True)
    assert image.places == ("crossing/front/200000001", "front/200000001")


def test_images_without_one_before_them_and_excluded_ones_are_not_scored(recording):
    images = listed(recording, dict.fromkeys((0, 1, 2, 4, 5, 6), "x"))  # one is missing
    assert [image.is_scored for image in images] == [False, True, True, False, True, True]
    start = Exclusion(recording=recording.name, reason="late", frames=(None, 1))
    images = listed(recording, dict.fromkeys(range(6), "x"), (start,))
    assert [image.is_scored for image in images] == [False, False, False, True, True, True]
