"""Which image a name means."""

import pytest

from bench.errors import UsageError
from bench.methods.predictions.files import ImageSizes
from bench.methods.predictions.images import CameraImages, NamedImage, named_images

SIZES = ImageSizes(evaluated_px=(8, 4), stored_px=(8, 4))


def camera(images) -> CameraImages:
    named = [NamedImage(timestamp_ns=t, frame=f, file=f"{s}.png", scored=True) for t, f, s in images]
    return CameraImages(recording="drive", camera="front", sizes=SIZES, annotated=True, images=tuple(named))


DRIVE = camera([(1_000, 0, "1000"), (2_000, 1, "2000"), (3_000, 2, "3000")])
PAIRS = camera([(1_000, 0, "00000_FV"), (2_000, 1, "00001_FV")])
FROM_ZERO = camera([(0, 0, "0"), (1, 1, "1"), (2, 2, "2"), (66, 3, "66")])
SHIFTED = camera([(0, 250, "0000000250"), (250, 251, "0000000251"), (500, 252, "0000000252")])


def times(names, images, **options) -> dict[str, int]:
    return {name: image.timestamp_ns for name, image in named_images(names, images, **options).items()}


def test_times_frames_and_files_are_told_apart():
    assert times(["3000", "1000"], DRIVE) == {"3000": 3000, "1000": 1000}
    assert times(["0002", "0"], DRIVE) == {"0002": 3000, "0": 1000}
    assert times(["00001_FV"], PAIRS) == {"00001_FV": 2000}


def test_files_are_named_with_or_without_their_suffix():
    assert times(["00001_FV.png", "00000_FV"], PAIRS) == {"00001_FV.png": 2000, "00000_FV": 1000}
    assert times(["0000000250.png"], SHIFTED) == {"0000000250.png": 0}
    assert times(["2000.png"], DRIVE) == {"2000.png": 2000}
    assert times(["00001_FV.jpg"], PAIRS) == {}


def test_names_that_mean_no_image_are_left_out():
    assert times(["1000", "4000", "x", "-1", "9" * 5000, "²", "../1000"], DRIVE) == {"1000": 1000}
    assert times([], DRIVE) == {}


def test_most_names_decide():
    assert times(["0", "1", "2", "3"], FROM_ZERO) == {"0": 0, "1": 1, "2": 2, "3": 66}
    assert times(["0", "1", "2", "66"], FROM_ZERO) == {"0": 0, "1": 1, "2": 2, "66": 66}


def test_names_that_fit_two_readings_equally_are_refused():
    both = camera([(0, 0, "a"), (2, 1, "b"), (1, 2, "c")])
    with pytest.raises(UsageError, match=r"drive/front: '1' may be a timestamp or a frame.*--names timestamp or"):
        named_images(["0", "1", "2"], both)
    assert times(["0", "1", "2"], both, naming="timestamp") == {"0": 0, "1": 1, "2": 2}
    assert times(["0", "1", "2"], both, naming="frame") == {"0": 0, "1": 2, "2": 1}


def test_both_readings_may_mean_the_same_image():
    assert times(["0", "1", "2"], FROM_ZERO) == {"0": 0, "1": 1, "2": 2}


def test_numbers_of_the_files_are_the_frame_numbers():
    with pytest.raises(UsageError, match="'250' may be a timestamp or a frame"):
        named_images(["250"], SHIFTED)
    assert times(["250", "251"], SHIFTED) == {"250": 0, "251": 250}
    assert times(["0000000250"], SHIFTED, naming="image") == {"0000000250": 0}


@pytest.mark.parametrize("names", [["1", "2", "3"], ["2", "3"], ["1", "2"], ["1"], ["0001", "0002", "0003"]])
@pytest.mark.parametrize("naming", ["auto", "frame"])
def test_indices_without_a_0_that_may_count_from_1_are_asked_about(names, naming):
    with pytest.raises(UsageError, match=r"drive/front: expected frame numbers that count from 0, .* may count from 1"):
        named_images(names, DRIVE, naming=naming)
    said = times(names, DRIVE, naming=naming, first_frame=1)
    assert said == {name: 1000 * int(name) for name in names}
    said = times(names, DRIVE, naming=naming, first_frame=0)
    assert said == {name: 1000 * (int(name) + 1) for name in names if int(name) < 3}


def test_indices_that_can_only_count_from_0_are_taken():
    assert times(["0", "1", "2", "3"], DRIVE) == {"0": 1000, "1": 2000, "2": 3000}  # one too many, for whoever lists it
    assert times(["1", "2", "3"], camera([(1, 1, "1"), (2, 2, "2"), (3, 3, "3")])) == {"1": 1, "2": 2, "3": 3}
    assert times(["1", "2"], FROM_ZERO) == {"1": 1, "2": 2}, "they are the names of the files"


def test_a_first_number_contradicts_names_that_are_none():
    with pytest.raises(UsageError, match=r"first_frame: expected none beside --names timestamp"):
        named_images(["1000"], DRIVE, naming="timestamp", first_frame=1)


def test_an_asked_for_naming_is_the_only_one():
    assert times(["0", "1000"], DRIVE, naming="frame") == {"0": 1000}
    assert times(["0", "1000"], DRIVE, naming="timestamp") == {"1000": 1000}
    assert times(["0", "00001_FV"], PAIRS, naming="image") == {"00001_FV": 2000}
