"""Images from disk, at the size at which they are evaluated."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import kornia_rs.io
import numpy as np
from numpy.typing import NDArray
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile

from bench.errors import DataError
from bench.recordings.files import read_whole
from bench.records.recording import ImageRef, MountedCamera

PNG_START, PNG_END = b"\x89PNG\r\n\x1a\n", b"\0\0\0\0IEND\xaeB`\x82"
JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"
JPEG_SCAN, MOST_SCANS = b"\xff\xda", 100  # each takes the time of a whole image; encoders write ten or so
PNG_INDEXED = b"\x03"  # kind of colour, in the header
MOST_WHITE = 65535
IMAGE_FILE = "an image file"
LARGEST_PX = 1 << 26  # 8192 x 8192; a header of a few bytes can ask for far more


def read_image(image: ImageRef, camera: MountedCamera, *, colour: bool = False) -> NDArray[np.uint8]:
    """Read an image.

    Args:
        image: which.
        camera: the camera that took it.
        colour: BGR instead of grey.

    Returns:
        (height, width) uint8 grey or (height, width, 3) uint8 BGR, at the size of `camera.model`.

    Raises:
        DataError: missing, cut short, not to be decoded, or of another size than the calibration's.
    """
    if image.stored is None:
        pixels = decode_image(read_whole(image.path, expected=IMAGE_FILE), colour=colour, file=image.path)
    else:
        pixels = image.stored.pixels(colour=colour)
    return np.asarray(_at_model_size(pixels, image.path, camera, cv2.INTER_AREA), dtype=np.uint8)


@dataclass(frozen=True, slots=True)
class WhiteLevelImage:
    """A file of more than 8 bits a value whose white is stated; a `bench.records.recording.StoredImage`.

    Attributes:
        container: the file.
        white_level: value that becomes 255; what is brighter becomes 255 too.
    """

    container: Path
    white_level: int

    def content(self) -> bytes:
        """Bytes of the file, after its white level."""
        return f"white level {self.white_level} ".encode() + read_whole(self.container, expected=IMAGE_FILE)

    def pixels(self, *, colour: bool) -> NDArray[np.uint8]:
        """Decode it, as `decode_image`."""
        return decode_image(
            read_whole(self.container, expected=IMAGE_FILE),
            colour=colour,
            white_level=self.white_level,
            file=self.container,
        )


def read_truth(image: ImageRef, camera: MountedCamera | None = None) -> NDArray[np.uint16]:
    """Read the true instance ids of a synthetic image.

    Args:
        image: which.
        camera: checks the size and brings the ids to the size of its model; None for the size on disk.

    Returns:
        (height, width) uint16; 0 where no object is seen.

    Raises:
        DataError: the recording has no truth for the image, or the file is not a 16-bit PNG of the right size.
    """
    if image.truth_path is None:
        raise DataError(image.path, expected="an image with truth beside it", got="one of a recording without")
    ids = _grey_values(image.truth_path, np.uint16, "a 16-bit grey PNG")
    return np.asarray(ids if camera is None else _at_model_size(ids, image.truth_path, camera, cv2.INTER_NEAREST))


def read_moving_mask(image: ImageRef, camera: MountedCamera) -> NDArray[np.bool_]:
    """Read what moves in an image, where its data set has masks: any value but 0.

    Args:
        image: which.
        camera: the camera that took it.

    Returns:
        (height, width) bool, at the size of `camera.model`.

    Raises:
        DataError: the image has no mask, or a file that is not an 8-bit grey image of the calibration's size.
    """
    if image.moving_path is None:
        raise DataError(image.path, expected="an image with a mask of what moves", got="one without")
    classes = _grey_values(image.moving_path, np.uint8, "an 8-bit grey PNG")
    return np.asarray(_at_model_size(classes, image.moving_path, camera, cv2.INTER_NEAREST) > 0)


def _grey_values(file: Path, dtype: type[np.generic], expected: str) -> NDArray[Any]:
    values = decode_values(read_whole(file, expected=IMAGE_FILE), file=file)
    if values.dtype != dtype or values.ndim != 2:
        raise DataError(file, expected=expected, got=f"{values.dtype} {values.shape}")
    return values


def read_mask(path: Path, size_px: tuple[int, int]) -> NDArray[np.bool_]:
    """Read a mask: True where the image is not 0.

    Args:
        path: an image file.
        size_px: (width, height) that it must have.

    Raises:
        DataError: missing, cut short, or of another size.
    """
    pixels = decode_image(read_whole(path, expected=IMAGE_FILE), file=path)
    got = (pixels.shape[1], pixels.shape[0])
    if got != tuple(size_px):
        raise DataError(path, expected="{} x {} px".format(*size_px), got="{} x {}".format(*got))
    return np.asarray(pixels > 0)


def decode_image(
    content: bytes, *, colour: bool = False, white_level: int = MOST_WHITE, file: Path
) -> NDArray[np.uint8]:
    """Decode an image file to what is seen.

    Args:
        content: a whole PNG or JPEG file.
        colour: BGR instead of grey.
        white_level: value of files of 16 bits that becomes 255; what is brighter becomes 255 too.
        file: it comes from, for messages.

    Returns:
        (height, width) uint8 or (height, width, 3) uint8 BGR.

    Raises:
        DataError: cut short, damaged, or not to be decoded.
    """
    pixels = _decoded(content, cv2.IMREAD_COLOR if colour else cv2.IMREAD_GRAYSCALE, file)
    return as_seen(pixels, white_level) if pixels.dtype == np.uint16 else np.asarray(pixels, dtype=np.uint8)


def decode_values(content: bytes, *, file: Path) -> NDArray[Any]:
    """Decode an image file to the values that it holds: (height, width) or (height, width, channels), uint8 or uint16.

    Args:
        content: a whole PNG or JPEG file.
        file: it comes from, for messages.

    Raises:
        DataError: cut short, damaged, not to be decoded, or indices into a palette.
    """
    if content.startswith(PNG_START) and content[25:26] == PNG_INDEXED:
        got = "an indexed one, of which a decoder gives colours"
        raise DataError(file, expected="a PNG of grey values", got=got, hint="store the indices as a grey PNG")
    return _decoded(content, cv2.IMREAD_UNCHANGED, file)


def as_seen(values: NDArray[np.uint16], white_level: int) -> NDArray[np.uint8]:
    """Values of 16 bits on the scale of 8, where `white_level` and all above is 255."""
    scaled = np.minimum(values.astype(np.float32) * (255.0 / white_level), 255.0)
    return np.asarray(scaled.round(), dtype=np.uint8)


def _decoded(content: bytes, kind: int, file: Path) -> NDArray[Any]:
    """The decoder of all images; `kind` is OpenCV's flag for grey, colour or values as they are."""
    fault = _fault(content)
    if fault is not None:
        raise DataError(file, expected="a whole PNG or JPEG file", got=fault)
    is_png = content.startswith(PNG_START)
    try:
        header = (PngImageFile if is_png else JpegImageFile)(BytesIO(content))
        if is_png:
            header.verify()  # its checksums; OpenCV ignores those of image data
    except (SyntaxError, OSError, ValueError) as error:  # also other errors of reading come as SyntaxError
        got = f"a damaged {'PNG' if is_png else 'JPEG'}"
        raise DataError(file, expected="a whole PNG or JPEG file", got=got) from error
    if header.width * header.height > LARGEST_PX:
        got = f"{header.width} x {header.height}"
        raise DataError(file, expected=f"an image of at most {LARGEST_PX} px", got=got)
    if isinstance(header, JpegImageFile):
        return _jpeg(content, header, kind, file)
    flags = kind if kind == cv2.IMREAD_UNCHANGED else kind | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        pixels = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), flags)
    except cv2.error as error:
        raise DataError(file, expected="an image that can be decoded", got=" ".join(str(error).split())) from error
    if pixels is None:
        raise DataError(file, expected="an image that can be decoded", got=f"{len(content)} bytes that cannot")
    return pixels


def _jpeg(content: bytes, header: JpegImageFile, kind: int, file: Path) -> NDArray[np.uint8]:
    """The pixels of a JPEG, grey or in colour.

    Pixels and time are as OpenCV's, which has the same library. But where that warns of damaged data, OpenCV prints
    the warning and gives an image that is grey or garbled from there on.

    Raises:
        DataError: the data is damaged or ends before the last line, or of another depth or kind of colour.
    """
    if header.layers not in (1, 3):
        got = f"{header.layers} of {header.bits} bits"
        raise DataError(file, expected="a JPEG of one or three components of 8 bits", got=got)
    if content.count(JPEG_SCAN) > MOST_SCANS:
        raise DataError(file, expected=f"at most {MOST_SCANS} scans of a JPEG", got=str(content.count(JPEG_SCAN)))
    grey = kind == cv2.IMREAD_GRAYSCALE or (kind == cv2.IMREAD_UNCHANGED and header.layers == 1)
    try:
        pixels = kornia_rs.io.decode_image_jpegturbo(content, "mono" if grey else "rgb")
    except Exception as error:  # it raises no narrower kind, without details
        got = "data that is damaged or ends before the last line"
        raise DataError(file, expected="a whole JPEG", got=got, hint="fetch or record the image again") from error
    seen = np.asarray(pixels, dtype=np.uint8)
    return seen[..., 0] if grey else np.asarray(cv2.cvtColor(seen, cv2.COLOR_RGB2BGR), dtype=np.uint8)


def _at_model_size(pixels: NDArray[Any], path: Path, camera: MountedCamera, interpolation: int) -> NDArray[Any]:
    """An image of the calibration's size at the size of the camera's model."""
    got_px, size_px = (pixels.shape[1], pixels.shape[0]), (camera.model.width, camera.model.height)
    if got_px != tuple(camera.stored_size_px):
        expected = "{} x {} px, as the calibration of camera {!r}".format(*camera.stored_size_px, camera.name)
        raise DataError(path, field="image size", expected=expected, got="{} x {}".format(*got_px))
    return (
        pixels if size_px == tuple(camera.stored_size_px) else cv2.resize(pixels, size_px, interpolation=interpolation)
    )


def _fault(content: bytes) -> str | None:
    """Fault of the file as a whole. OpenCV gives a partly grey image for one that is cut short."""
    if content.startswith(PNG_START):
        return None if PNG_END in content else f"a PNG cut short at {len(content)} bytes"
    if content.startswith(JPEG_START):
        return None if JPEG_END in content else f"a JPEG cut short at {len(content)} bytes"  # what follows is padding
    return f"{len(content)} bytes that begin with {content[:8].hex(' ')}" if content else "an empty file"
