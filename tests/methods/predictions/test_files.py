"""The three kinds of file: what they say, and what no file can do to us."""

import json
import zipfile

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from pycocotools import mask as coco

from bench.errors import DataError
from bench.harness.stages import largest_resident_mb
from bench.methods.predictions.files import (
    ImageSizes,
    MaskEntry,
    RunLengths,
    UnclearError,
    WrongSizeError,
    decode_union,
    read_entries,
    read_npz_scores,
    read_png_map,
)
from tests.hostile.files import npy_header, png

SIZES = ImageSizes(evaluated_px=(6, 4), stored_px=(6, 4))
MASK = np.array([[0, 0, 0, 0, 0, 1], [0, 1, 1, 0, 0, 1], [0, 0, 1, 0, 0, 0], [0, 0, 0, 0, 0, 0]], dtype=bool)


def write_png(path, values):
    assert cv2.imwrite(str(path), values)
    return path


@pytest.mark.parametrize("moving", [1, 255])
def test_a_mask_of_either_scale(tmp_path, moving):
    found = read_png_map(write_png(tmp_path / "a.png", MASK.astype(np.uint8) * moving), SIZES)
    assert found.dtype == bool
    np.testing.assert_array_equal(found, MASK)


def test_a_mask_of_one_bit(tmp_path):
    write_png(tmp_path / "a.png", MASK.astype(np.uint8) * 255)
    assert cv2.imwrite(str(tmp_path / "a.png"), MASK.astype(np.uint8) * 255, [cv2.IMWRITE_PNG_BILEVEL, 1])
    assert (tmp_path / "a.png").read_bytes()[24] == 1
    np.testing.assert_array_equal(read_png_map(tmp_path / "a.png", SIZES), MASK)


def test_16_bits_are_scores_where_the_folder_says_so(tmp_path):
    values = np.zeros((4, 6), dtype=np.uint16)
    values[0, :3] = 65535, 32768, 1
    found = read_png_map(write_png(tmp_path / "a.png", values), SIZES, sixteen_bits="score")
    assert found.dtype == np.float32
    np.testing.assert_allclose(found[0, :4], [1, 32768 / 65535, 1 / 65535, 0], rtol=1e-6)


@pytest.mark.parametrize("ids", [(0, 1001, 2003), (0, 26000, 26001), (0, 1)])
def test_16_bits_may_be_instances_and_are_refused_where_the_folder_says_nothing(tmp_path, ids):
    file = write_png(tmp_path / "a.png", np.resize(np.array(ids, dtype=np.uint16), (4, 6)))
    got = ", ".join(map(str, ids))
    with pytest.raises(UnclearError, match=rf"expected a mask of 8 bits, or .* got 16 bits, the values {got}; write"):
        read_png_map(file, SIZES)


def test_an_indexed_png_is_refused_with_the_remedy(tmp_path):
    palette = Image.fromarray(MASK.astype(np.uint8), "P")
    palette.putpalette([0, 0, 0, 255, 0, 0])
    palette.save(tmp_path / "a.png")
    with pytest.raises(DataError, match=r"got an indexed one.*; store the indices as a grey PNG"):
        read_png_map(tmp_path / "a.png", SIZES)


@pytest.mark.parametrize(("values", "got"), [((0, 1, 255), "0, 1, 255"), ((37,), "37"), ((0, 128), "0, 128")])
def test_other_values_are_unclear(tmp_path, values, got):
    grey = np.resize(np.array(values, dtype=np.uint8), (4, 6))
    with pytest.raises(UnclearError, match=f"got the values {got}; write scores as .npz"):
        read_png_map(write_png(tmp_path / "a.png", grey), SIZES)


def black(*shape: int) -> bytes:
    return cv2.imencode(".png", np.zeros(shape, np.uint8))[1].tobytes()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "got an empty file"),
        (b"GIF89a", "6 bytes that begin with 47 49 46"),
        (black(4, 6)[:20], "expected a whole PNG file, got 20 bytes"),
        (black(4, 6, 3), "expected one grey channel, got 3 channels"),
        (black(4, 6, 4), "expected one grey channel, got 4 channels"),
        (png(6, 4, colour=3, rows=bytes(7) * 4), "expected a PNG of grey values, got an indexed one"),
        (png(6, 4, bits=7), "expected a whole PNG"),
        (png(6, 4)[:33], "expected a whole PNG file, got 33 bytes"),
        (png(6, 4)[:-12], "a PNG cut short at"),
        (png(60_000, 40_000), "at most 67108864 pixels, got 60000 x 40000"),
        (png(6, 5, bits=16), "got 6 x 5"),
    ],
)
def test_what_is_no_mask_is_refused(tmp_path, content, message):
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(DataError, match=message):
        read_png_map(tmp_path / "a.png", SIZES)


def test_a_damaged_png_is_refused(tmp_path):
    file = write_png(tmp_path / "a.png", MASK.astype(np.uint8) * 255)
    content = bytearray(file.read_bytes())
    content[45] ^= 0xFF
    file.write_bytes(content)
    with pytest.raises(DataError, match="damaged"):
        read_png_map(file, SIZES)


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_scores_of_any_float(tmp_path, kind):
    scores = np.linspace(0, 1, 24).reshape(4, 6).astype(kind)
    np.savez_compressed(tmp_path / "a.npz", score=scores, other=np.array([object()]))
    found = read_npz_scores(tmp_path / "a.npz", SIZES)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, scores.astype(np.float32))


@pytest.mark.parametrize(
    ("scores", "error", "message"),
    [
        (np.full((4, 6), 2.0), UnclearError, r"scores in \[0, 1\], got 2 to 2; bring them to"),
        (np.full((4, 6), -0.1), UnclearError, "got -0.1 to -0.1"),
        (np.full((4, 6), np.nan), UnclearError, "got nan to nan"),
        (np.full((4, 6), np.inf), UnclearError, "got inf to inf"),
        (np.zeros((3, 6)), WrongSizeError, "got 6 x 3"),
        (np.zeros((0, 0)), WrongSizeError, "got 0 x 0"),
        (np.zeros((4, 6, 1)), DataError, r"floats on \(rows, columns\), got float64 \(4, 6, 1\)"),
        (np.zeros((4, 6), dtype=np.uint8), DataError, "got uint8"),
        (np.array([[object()] * 6] * 4), DataError, "got object"),
    ],
)
def test_what_is_no_score_is_refused(tmp_path, scores, error, message):
    np.savez(tmp_path / "a.npz", score=scores)
    with pytest.raises(error, match=message):
        read_npz_scores(tmp_path / "a.npz", SIZES)


@pytest.mark.parametrize(
    ("member", "message"),
    [
        (npy_header((600_000_000, 600_000_000), "<f8"), "got 600000000 x 600000000"),  # nothing is unpacked for it
        (npy_header((4, 6), "<f8"), "score: expected an .npz file with this array"),  # and no numbers
        (b"no array", "score: expected an .npz file with this array"),
        (b"\x93NUMPY\x07\x00", "format 1 or 2"),
        (npy_header((4, 6), "<f8").replace(b"False", b"f(x) "), "score: expected an .npz file with this array"),
    ],
)
def test_hostile_archives_are_refused(tmp_path, member, message):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("score.npy", member)
    with pytest.raises(DataError, match=message):
        read_npz_scores(tmp_path / "a.npz", SIZES)


def test_a_zip_of_zeros_is_not_unpacked(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("score.npy", npy_header((4, 6), "<f8") + bytes(192) + bytes(1 << 28))
    assert read_npz_scores(tmp_path / "a.npz", SIZES).max() == 0


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"x" * 100])
def test_what_is_no_archive_is_refused(tmp_path, content):
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(DataError, match=r"score: expected an \.npz file with this array"):
        read_npz_scores(tmp_path / "a.npz", SIZES)


def entry(size, counts) -> MaskEntry:
    return MaskEntry(image=1, segmentation=RunLengths(size=size, counts=counts))


def encoded(mask) -> MaskEntry:
    found = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
    return entry(found["size"], found["counts"].decode())


def test_run_lengths_go_down_the_columns(tmp_path):
    np.testing.assert_array_equal(decode_union([entry((4, 6), [5, 1, 3, 2, 9, 2, 2])], SIZES, file=tmp_path), MASK)


@given(st.integers(0, 10_000), st.integers(1, 40), st.integers(1, 40), st.floats(0, 1))
def test_text_means_what_coco_means(seed, height, width, share):
    mask = np.random.default_rng(seed).random((height, width)) < share
    sizes = ImageSizes(evaluated_px=(width, height), stored_px=(width, height))
    np.testing.assert_array_equal(decode_union([encoded(mask)], sizes, file="a.json"), mask)


def test_long_runs_have_several_groups():
    mask = np.zeros((1000, 2000), dtype=bool)
    mask[:, 700:1300] = True
    sizes = ImageSizes(evaluated_px=(2000, 1000), stored_px=(2000, 1000))
    np.testing.assert_array_equal(decode_union([encoded(mask)], sizes, file="a.json"), mask)


def test_masks_that_were_decoded_are_freed():
    """Of lengths that do not fit, the library keeps the mask for ever."""
    sizes = ImageSizes(evaluated_px=(1000, 1000), stored_px=(1000, 1000))
    packed, before = encoded(np.ones((1000, 1000), dtype=bool)), largest_resident_mb()
    for _ in range(500):
        decode_union([packed], sizes, file="a.json")
    assert largest_resident_mb() - before < 200


def test_several_masks_of_an_image_are_united_and_none_is_empty():
    one, other = MASK & (np.arange(6) < 3), MASK & (np.arange(6) >= 3)
    found = decode_union([encoded(one), encoded(other), MaskEntry(image=1, segmentation=None)], SIZES, file="a.json")
    np.testing.assert_array_equal(found, MASK)
    assert not decode_union([MaskEntry(image=1, segmentation=None)], SIZES, file="a.json").any()


@pytest.mark.parametrize(
    ("size", "counts", "message"),
    [
        ((4, 6), [24, 1], "add up to 4 x 6 = 24, got longer"),
        ((4, 6), [1, 2], "got shorter"),
        ((4, 6), [], "got shorter"),
        ((4, 6), [10**30], "got longer"),
        ((4, 6), [2**32 - 1, 25], "got longer"),
        ((4, 6), "5", "got shorter"),
        ((4, 6), "", "got shorter"),
        ((4, 6), "h0N", "got longer or negative ones"),
        ((4, 6), "~", "expected whole COCO run lengths, got '~'"),
        ((4, 6), "é", "expected whole COCO run lengths, got 'é'"),
        ((4, 6), "P", "expected whole COCO run lengths, got 'P'"),
        ((4, 6), "P" * 1000, "expected whole COCO run lengths"),
        ((4, 6), "PPPPPPP0", "expected whole COCO run lengths"),
        ((4_000_000, 6_000_000), [24 * 10**12], "at most 67108864 pixels, got 6000000 x 4000000"),
        ((5, 6), [30], "got 6 x 5"),
    ],
)
def test_run_lengths_that_are_none_are_refused(size, counts, message):
    with pytest.raises(DataError, match=message):
        decode_union([entry(size, counts)], SIZES, file="a.json")


def test_masks_of_different_sizes_cannot_be_united():
    with pytest.raises(DataError, match="all masks of an image at one size"):
        decode_union([entry((4, 6), [24]), entry((2, 3), [6])], SIZES, file="a.json")


def test_a_file_of_masks(tmp_path):
    entries = [
        {"image": "000", "segmentation": {"size": [4, 6], "counts": [24]}, "category_id": 3, "score": 0.5},
        {"image": 7, "camera": "front", "segmentation": None},
    ]
    (tmp_path / "a.json").write_text(json.dumps(entries))
    assert [(e.name, e.camera) for e in read_entries(tmp_path / "a.json")] == [("000", None), ("7", "front")]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "a.json: expected a list of"),
        ("{}", "a.json: expected a list of"),
        ("[" * 100_000, "a.json: expected a list of"),
        ('[{"image": 1}]', "0.segmentation: expected"),
        ('[{"image": 1.5, "segmentation": null}]', "0.image"),
        ('[{"image": 1, "segmentation": {"size": [4], "counts": []}}]', "0.segmentation.size"),
        ('[{"image": 1, "segmentation": {"size": [4, -6], "counts": []}}]', "0.segmentation.size.1"),
        ('[{"image": 1, "segmentation": {"size": [4, 6], "counts": [1.5]}}]', "0.segmentation.counts"),
        ('[{"image": 1, "segmentation": {"size": [4, 6], "counts": [-1]}}]', "0.segmentation.counts"),
        ('[{"image": NaN, "segmentation": null}]', "0.image"),
    ],
)
def test_other_files_are_refused_with_the_field(tmp_path, content, message):
    (tmp_path / "a.json").write_text(content)
    with pytest.raises(DataError, match=message):
        read_entries(tmp_path / "a.json")


def test_a_file_that_is_too_large_is_not_read(tmp_path):
    with (tmp_path / "a.json").open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(DataError, match="got 1099511627776 bytes, over the limit of 67108864"):
        read_entries(tmp_path / "a.json")
