"""Images of ROS 2 messages, raw and compressed, brought to grey or BGR."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError
from bench.recordings.images import JPEG_START, PNG_START, decode_image

GREY_OF_16_BITS = b"\x10\x00"  # depth and kind in the head of a PNG


@dataclass(frozen=True, slots=True, kw_only=True)
class _Encoding:
    """How pixels lie in a raw image.

    Attributes:
        bytes_per_pixel: of a row, without padding.
        to_grey: OpenCV's code; None for grey as it is.
        to_bgr: OpenCV's code; None for BGR as it is.
        channels: values of a pixel in OpenCV's array.
        even: the width, and for colour filters the height, has to be even.
    """

    bytes_per_pixel: int
    to_grey: int | None
    to_bgr: int | None
    channels: int = 1
    even: bool = False


def _bayer(pattern: str) -> _Encoding:
    """A colour filter; ROS and these names of OpenCV both tell the first row's and then the second row's colours."""
    grey, bgr = (getattr(cv2, f"COLOR_Bayer{pattern}2{kind}") for kind in ("GRAY", "BGR"))
    return _Encoding(bytes_per_pixel=1, to_grey=grey, to_bgr=bgr, even=True)


_UYVY = _Encoding(
    bytes_per_pixel=2, to_grey=cv2.COLOR_YUV2GRAY_UYVY, to_bgr=cv2.COLOR_YUV2BGR_UYVY, channels=2, even=True
)
_YUYV = _Encoding(
    bytes_per_pixel=2, to_grey=cv2.COLOR_YUV2GRAY_YUY2, to_bgr=cv2.COLOR_YUV2BGR_YUY2, channels=2, even=True
)
_GREY = _Encoding(bytes_per_pixel=1, to_grey=None, to_bgr=cv2.COLOR_GRAY2BGR)
_GREY16 = _Encoding(bytes_per_pixel=2, to_grey=None, to_bgr=cv2.COLOR_GRAY2BGR)
_BGR = _Encoding(bytes_per_pixel=3, to_grey=cv2.COLOR_BGR2GRAY, to_bgr=None, channels=3)
_RGB = _Encoding(bytes_per_pixel=3, to_grey=cv2.COLOR_RGB2GRAY, to_bgr=cv2.COLOR_RGB2BGR, channels=3)
_BGRA = _Encoding(bytes_per_pixel=4, to_grey=cv2.COLOR_BGRA2GRAY, to_bgr=cv2.COLOR_BGRA2BGR, channels=4)
_RGBA = _Encoding(bytes_per_pixel=4, to_grey=cv2.COLOR_RGBA2GRAY, to_bgr=cv2.COLOR_RGBA2BGR, channels=4)
ENCODINGS: Mapping[str, _Encoding] = {
    "mono8": _GREY,
    "8UC1": _GREY,
    "mono16": _GREY16,
    "16UC1": _GREY16,
    "bgr8": _BGR,
    "8UC3": _BGR,
    "rgb8": _RGB,
    "bgra8": _BGRA,
    "rgba8": _RGBA,
    "bayer_rggb8": _bayer("RGGB"),
    "bayer_bggr8": _bayer("BGGR"),
    "bayer_gbrg8": _bayer("GBRG"),
    "bayer_grbg8": _bayer("GRBG"),
    "yuv422": _UYVY,
    "uyvy": _UYVY,
    "yuv422_yuy2": _YUYV,
    "yuyv": _YUYV,
}


def image_pixels(
    message: Any, *, colour: bool, size_px: tuple[int, int], white_level: int, place: Path
) -> NDArray[np.uint8]:
    """Decode a `sensor_msgs/Image`.

    Args:
        message: decoded.
        colour: BGR instead of grey.
        size_px: (width, height) that it must have.
        white_level: value of 16-bit images that becomes 255; what is brighter becomes 255 too.
        place: where it comes from, for messages.

    Returns:
        (height, width) uint8 or (height, width, 3) uint8 BGR.

    Raises:
        DataError: another size, an encoding that is not read here, or fewer bytes than the size asks for.
    """
    encoding = ENCODINGS.get(str(message.encoding))
    if encoding is None:
        got = repr(str(message.encoding)[:40])
        raise DataError(place, field="encoding", expected=f"one of {', '.join(ENCODINGS)}", got=got)
    _refuse_other_size((int(message.width), int(message.height)), size_px, place)
    rows = _rows(message, encoding, place)
    if encoding is _GREY16:
        values = np.ascontiguousarray(rows).view(">u2" if message.is_bigendian else "<u2")
        pixels = _of_16_bits(values, white_level)
    else:
        shape = rows.shape if encoding.channels == 1 else (rows.shape[0], -1, encoding.channels)
        pixels = np.ascontiguousarray(rows).reshape(shape)
    code = encoding.to_bgr if colour else encoding.to_grey
    return np.array(pixels) if code is None else np.asarray(cv2.cvtColor(pixels, code), dtype=np.uint8)


def compressed_pixels(
    message: Any, *, colour: bool, size_px: tuple[int, int], white_level: int, place: Path
) -> NDArray[np.uint8]:
    """Decode a `sensor_msgs/CompressedImage`, JPEG or PNG.

    Args:
        message: decoded.
        colour: BGR instead of grey.
        size_px: (width, height) that it must have; another is refused before anything is decoded.
        white_level: value of grey PNG images of 16 bits that becomes 255.
        place: where it comes from, for messages.

    Returns:
        (height, width) uint8 or (height, width, 3) uint8 BGR.

    Raises:
        DataError: another format or size, cut short, or not to be decoded.
    """
    kind = str(message.format)
    if "compressedDepth" in kind:
        raise DataError(place, field="format", expected="JPEG or PNG", got=repr(kind[:60]))
    content = bytes(message.data)
    told = _size_of(content)
    if told is None:
        got = f"{len(content)} bytes of the format {kind[:60]!r} that begin with {content[:8].hex(' ')}"
        raise DataError(place, field="data", expected="a JPEG or PNG image", got=got)
    _refuse_other_size(told, size_px, place)
    if content.startswith(PNG_START) and content[24:26] == GREY_OF_16_BITS:
        pixels = _of_16_bits(decode_image(content, cv2.IMREAD_UNCHANGED, place=place), white_level)
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR), dtype=np.uint8) if colour else pixels
    flags = cv2.IMREAD_COLOR if colour else cv2.IMREAD_GRAYSCALE
    return np.asarray(decode_image(content, flags | cv2.IMREAD_IGNORE_ORIENTATION, place=place), dtype=np.uint8)


def _of_16_bits(values: NDArray[np.uint16], white_level: int) -> NDArray[np.uint8]:
    scaled = np.minimum(values.astype(np.float32) * (255.0 / white_level), 255.0)
    return np.asarray(scaled.round(), dtype=np.uint8)


def _rows(message: Any, encoding: _Encoding, place: Path) -> NDArray[np.uint8]:
    """(height, bytes of a row without padding) uint8."""
    width, height, step = int(message.width), int(message.height), int(message.step)
    data = np.frombuffer(message.data, dtype=np.uint8)
    used = width * encoding.bytes_per_pixel
    if encoding.even and (width % 2 or (encoding.channels == 1 and height % 2)):
        raise DataError(
            place, field="width", expected=f"an even size for {message.encoding}", got=f"{width} x {height}"
        )
    if step < used:
        raise DataError(place, field="step", expected=f"at least {used} bytes a row", got=str(step))
    due = step * (height - 1) + used  # some drivers leave out the padding of the last row
    if len(data) < due:
        raise DataError(place, field="data", expected=f"{due} bytes for {height} rows of {step}", got=str(len(data)))
    whole = data[: step * (height - 1)].reshape(height - 1, step)[:, :used]
    return np.concatenate([whole, data[step * (height - 1) : due][None]])


def _refuse_other_size(came_px: tuple[int, int], size_px: tuple[int, int], place: Path) -> None:
    if came_px != tuple(size_px):
        expected = "{} x {} px, as the rig file says".format(*size_px)
        raise DataError(place, field="image size", expected=expected, got="{} x {}".format(*came_px))


def _size_of(content: bytes) -> tuple[int, int] | None:
    """(width, height) that a JPEG or PNG tells; None for another format."""
    if content.startswith(PNG_START) and len(content) >= 24:
        width, height = struct.unpack_from(">II", content, 16)
        return width, height
    if not content.startswith(JPEG_START):
        return None
    place = 2
    while place + 9 <= len(content) and content[place] == 0xFF:
        marker = content[place + 1]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):  # a start of frame
            height, width = struct.unpack_from(">HH", content, place + 5)
            return width, height
        if marker == 0xFF:  # a byte of filling
            place += 1
        else:
            place += 2 + struct.unpack_from(">H", content, place + 2)[0]
    return None
