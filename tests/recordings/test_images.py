"""Images: whole, broken, and of another size."""

import struct
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from bench.errors import DataError
from bench.recordings import ImageRef, open_native, read_image, read_truth
from bench.recordings.images import JPEG_SCAN, decode_image, decode_values, read_mask
from tests.hostile import files
from tests.hostile.files import png_chunk
from tests.support import tiny
from tests.support.limits import at_most


def read(path, *, colour=False):
    return read_image(ImageRef(camera="front", timestamp_ns=1, path=path), tiny.front_camera(), colour=colour)


@pytest.mark.parametrize("kind", ["plain", "paeth", "turned", "one transparent", "gamma", "few bits"])
def test_grey_png_files_of_every_kind_are_read_as_they_are(tmp_path, kind):
    pixels = np.random.default_rng(1).integers(0, 256, (tiny.HEIGHT, tiny.WIDTH), dtype=np.uint8)
    filters = [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_PAETH] if kind == "paeth" else []
    content = cv2.imencode(".png", pixels, filters)[1].tobytes()
    asides = {  # what a reader could take as an order to change values
        "turned": png_chunk(b"eXIf", b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"),
        "one transparent": png_chunk(b"tRNS", b"\0\7"),
        "gamma": png_chunk(b"gAMA", struct.pack(">I", 45455)),
        "few bits": png_chunk(b"sBIT", b"\5"),
    }
    (tmp_path / "1.png").write_bytes(content[:33] + asides.get(kind, b"") + content[33:])
    assert np.array_equal(read(tmp_path / "1.png"), pixels)
    assert np.array_equal(read(tmp_path / "1.png", colour=True), np.dstack([pixels] * 3))


def scene():
    noise = np.random.default_rng(4).integers(0, 256, (tiny.HEIGHT, tiny.WIDTH, 3), dtype=np.uint8)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX)


def jpeg(kind):
    options = {
        "best": [cv2.IMWRITE_JPEG_QUALITY, 100],
        "progressive": [cv2.IMWRITE_JPEG_PROGRESSIVE, 1],
        "restarts": [cv2.IMWRITE_JPEG_RST_INTERVAL, 4],
        "4:4:4": [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444],
        "4:2:2": [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422],
    }
    pixels = scene()[..., 1] if kind == "grey" else scene()
    return cv2.imencode(".jpg", pixels, options.get(kind, []))[1].tobytes()


JPEGS = ["plain", "grey", "best", "progressive", "restarts", "4:4:4", "4:2:2"]


@pytest.mark.parametrize("kind", JPEGS)
@pytest.mark.parametrize("flags", [cv2.IMREAD_GRAYSCALE, cv2.IMREAD_COLOR, cv2.IMREAD_UNCHANGED])
def test_whole_jpegs_have_the_pixels_that_opencv_gives_them(kind, flags):
    content = jpeg(kind)
    if flags == cv2.IMREAD_UNCHANGED:
        seen = decode_values(content, file=Path("1.jpg"))
    else:
        seen = decode_image(content, colour=flags == cv2.IMREAD_COLOR, file=Path("1.jpg"))
    assert np.array_equal(seen, cv2.imdecode(np.frombuffer(content, np.uint8), flags | cv2.IMREAD_IGNORE_ORIENTATION))


@pytest.mark.parametrize("kind", JPEGS)
@pytest.mark.parametrize("share", [0.5, 0.97])
def test_a_jpeg_without_its_last_lines_is_refused_though_its_end_is_marked(tmp_path, capfd, kind, share):
    """OpenCV fills the lines and prints a warning."""
    content = jpeg(kind)
    path = tmp_path / "1.jpg"
    data = content.index(JPEG_SCAN)
    path.write_bytes(content[: data + int(share * (len(content) - data))] + b"\xff\xd9")
    assert cv2.imread(str(path)).shape == (tiny.HEIGHT, tiny.WIDTH, 3)
    assert "JPEG" in capfd.readouterr().err
    for colour in (False, True):
        with pytest.raises(DataError, match=r"1\.jpg: expected a whole JPEG, got data that is damaged or ends before"):
            read(path, colour=colour)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("kind", JPEGS)
def test_a_damaged_jpeg_is_refused_as_far_as_the_decoder_sees_it(capfd, kind):
    """It sees all that OpenCV prints a warning of; what leaves the stream in step is seen by neither."""
    content, random, refused = jpeg(kind), np.random.default_rng(7), 0
    for _ in range(60):
        place = int(random.integers(content.index(JPEG_SCAN) + 14, len(content) - 12))
        changed = content[:place] + random.bytes(10) + content[place + 10 :]
        pixels = cv2.imdecode(np.frombuffer(changed, np.uint8), cv2.IMREAD_GRAYSCALE)
        warned = "JPEG" in capfd.readouterr().err
        try:
            assert np.array_equal(decode_image(changed, file=Path("1.jpg")), pixels)
            assert not warned
        except DataError:
            refused += 1
        assert capfd.readouterr().err == ""
    assert refused > 15


def test_a_jpeg_of_very_many_scans_and_one_of_four_colours_are_refused(tmp_path):
    """Each scan takes as long as an image: a file of 100 kB can ask for an hour."""
    content = jpeg("progressive")
    last = content.rindex(JPEG_SCAN)
    with pytest.raises(DataError, match="expected at most 100 scans of a JPEG"):
        decode_image(content[:-2] + content[last:-2] * 1000 + content[-2:], colour=True, file=Path("1.jpg"))
    Image.fromarray(scene()).convert("CMYK").save(tmp_path / "1.jpg")
    with pytest.raises(DataError, match="expected a JPEG of one or three components of 8 bits, got 4 of 8 bits"):
        decode_image((tmp_path / "1.jpg").read_bytes(), colour=True, file=tmp_path / "1.jpg")


@pytest.mark.parametrize("what", files.IMAGES)
def test_what_is_no_whole_image_is_refused(tmp_path, what):
    content, message = files.IMAGES[what]
    path = tmp_path / "9.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DataError) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)
    with pytest.raises(DataError):
        read_mask(path, (tiny.WIDTH, tiny.HEIGHT))


@pytest.mark.parametrize("what", files.NO_FILES)
def test_nothing_waits_for_what_is_no_file(tmp_path, what):
    files.NO_FILES[what](tmp_path / "9.png")
    with at_most(60), pytest.raises(DataError, match=r"9\.png: expected an image file, got a .*, no regular file"):
        read(tmp_path / "9.png")


def test_an_image_has_the_size_of_the_calibration_and_truth_is_sixteen_bits_where_there_is_some(root, tmp_path):
    path = tmp_path / "1.png"
    cv2.imwrite(str(path), np.zeros((48, 60), np.uint8))
    told = "size: expected 64 x 48 px, as the calibration of camera 'front', got 60 x 48"
    with pytest.raises(DataError, match=told):
        read(path)
    with pytest.raises(DataError, match="expected an image with truth beside it"):
        read_truth(ImageRef(camera="front", timestamp_ns=1, path=path))
    recording = open_native(root)
    first = recording.images["front"][0]
    cv2.imwrite(str(first.truth_path), np.zeros((48, 64), np.uint8))
    with pytest.raises(DataError, match="expected a 16-bit grey PNG, got uint8"):
        read_truth(first, recording.cameras["front"])


@pytest.mark.parametrize("padding", [bytes(60), b"\xff" * 4096, b"\xff\xd8 another"])
def test_what_follows_the_end_of_a_jpeg_is_none_of_it(padding):
    whole = decode_image(jpeg("plain"), file=Path("1.jpg"))
    assert np.array_equal(decode_image(jpeg("plain") + padding, file=Path("1.jpg")), whole)


@pytest.mark.parametrize("colour", [False, True])
def test_an_indexed_png_is_seen_in_its_colours(colour):
    picture = Image.fromarray(scene()).quantize(16)
    content = BytesIO()
    picture.save(content, "PNG")
    bgr = np.asarray(picture.convert("RGB"))[..., ::-1]
    seen = decode_image(content.getvalue(), colour=colour, file=Path("1.png"))
    wanted = bgr if colour else cv2.cvtColor(np.ascontiguousarray(bgr), cv2.COLOR_BGR2GRAY)
    assert np.abs(seen.astype(int) - wanted).max() <= 1
    with pytest.raises(DataError, match=r"expected a PNG of grey values, got an indexed one.*; store the indices"):
        decode_values(content.getvalue(), file=Path("1.png"))
