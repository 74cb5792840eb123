"""Images of a bag, raw and compressed: found again by their position, decoded to grey or BGR."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from bench.adapters.rosbag.messages import COMPRESSED_IMAGE, decode
from bench.adapters.rosbag.storage import StoredMessage
from bench.errors import DataError
from bench.recordings.images import as_seen, decode_image, stated_size_px


class _Encoding(NamedTuple):
    """Layout of pixels in a raw image: bytes and OpenCV's channels of each, and OpenCV's codes; None for as stored."""

    pixel_bytes: int
    channels: int
    to_grey: int | None
    to_bgr: int | None


# ROS and these names of OpenCV both give the colours of a filter's first row and then of its second.
ENCODINGS: Mapping[str, _Encoding] = {
    "mono8": _Encoding(1, 1, None, cv2.COLOR_GRAY2BGR),
    "8UC1": _Encoding(1, 1, None, cv2.COLOR_GRAY2BGR),
    "mono16": _Encoding(2, 1, None, cv2.COLOR_GRAY2BGR),
    "16UC1": _Encoding(2, 1, None, cv2.COLOR_GRAY2BGR),
    "bgr8": _Encoding(3, 3, cv2.COLOR_BGR2GRAY, None),
    "8UC3": _Encoding(3, 3, cv2.COLOR_BGR2GRAY, None),
    "rgb8": _Encoding(3, 3, cv2.COLOR_RGB2GRAY, cv2.COLOR_RGB2BGR),
    "bgra8": _Encoding(4, 4, cv2.COLOR_BGRA2GRAY, cv2.COLOR_BGRA2BGR),
    "rgba8": _Encoding(4, 4, cv2.COLOR_RGBA2GRAY, cv2.COLOR_RGBA2BGR),
    "bayer_rggb8": _Encoding(1, 1, cv2.COLOR_BayerRGGB2GRAY, cv2.COLOR_BayerRGGB2BGR),
    "bayer_bggr8": _Encoding(1, 1, cv2.COLOR_BayerBGGR2GRAY, cv2.COLOR_BayerBGGR2BGR),
    "bayer_gbrg8": _Encoding(1, 1, cv2.COLOR_BayerGBRG2GRAY, cv2.COLOR_BayerGBRG2BGR),
    "bayer_grbg8": _Encoding(1, 1, cv2.COLOR_BayerGRBG2GRAY, cv2.COLOR_BayerGRBG2BGR),
    "yuv422": _Encoding(2, 2, cv2.COLOR_YUV2GRAY_UYVY, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": _Encoding(2, 2, cv2.COLOR_YUV2GRAY_UYVY, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": _Encoding(2, 2, cv2.COLOR_YUV2GRAY_YUY2, cv2.COLOR_YUV2BGR_YUY2),
    "yuyv": _Encoding(2, 2, cv2.COLOR_YUV2GRAY_YUY2, cv2.COLOR_YUV2BGR_YUY2),
}


@dataclass(frozen=True, slots=True)
class BagImage(StoredMessage):
    """An image in a bag; a `bench.records.recording.StoredImage`.

    Attributes:
        size_px: (width, height) that it must have.
        white_level: value of 16-bit images that becomes 255; what is brighter becomes 255 too.
        name: for errors.
    """

    size_px: tuple[int, int]
    white_level: int
    name: Path

    @override
    def decoding(self) -> tuple[Any, ...]:
        return self.size_px, self.white_level

    def pixels(self, *, colour: bool) -> NDArray[np.uint8]:
        """Decode it: (height, width) uint8 grey or (height, width, 3) uint8 BGR.

        Raises:
            DataError: it cannot be read or decoded, or has another size than the rig file says.
        """
        return self.decoded(decode(self.topic, self.payload(), file=self.container), colour=colour)

    def decoded(self, message: Any, *, colour: bool) -> NDArray[np.uint8]:
        """The pixels of a `sensor_msgs/Image` or, by the topic's type, of a `sensor_msgs/CompressedImage`.

        Args:
            message: decoded.
            colour: BGR instead of grey.

        Returns:
            (height, width) uint8 or (height, width, 3) uint8 BGR.

        Raises:
            DataError: another size, an encoding or format that is not read here, or fewer bytes than the size asks for.
        """
        return (self._compressed if self.topic.message_type == COMPRESSED_IMAGE else self._raw)(message, colour)

    def _raw(self, message: Any, colour: bool) -> NDArray[np.uint8]:
        encoding = ENCODINGS.get(str(message.encoding))
        if encoding is None:
            expected, got = f"one of {', '.join(ENCODINGS)}", repr(str(message.encoding)[:40])
            raise DataError(self.name, field="encoding", expected=expected, got=got)
        self._refuse_other_size((int(message.width), int(message.height)))
        rows = self._rows(message, encoding)
        if message.encoding in ("mono16", "16UC1"):
            pixels = as_seen(rows.view(">u2" if message.is_bigendian else "<u2"), self.white_level)
        else:
            pixels = rows if encoding.channels == 1 else rows.reshape(len(rows), -1, encoding.channels)
        code = encoding.to_bgr if colour else encoding.to_grey
        return np.array(pixels) if code is None else np.asarray(cv2.cvtColor(pixels, code), dtype=np.uint8)

    def _compressed(self, message: Any, colour: bool) -> NDArray[np.uint8]:
        """JPEG or PNG; another size is refused before anything is decoded."""
        kind, content = str(message.format), bytes(message.data)
        if "compressedDepth" in kind:
            raise DataError(self.name, field="format", expected="JPEG or PNG", got=repr(kind[:60]))
        stated_px = stated_size_px(content)
        if stated_px is None:
            got = f"{len(content)} bytes of the format {kind[:60]!r} that begin with {content[:8].hex(' ')}"
            raise DataError(self.name, field="data", expected="a JPEG or PNG image", got=got)
        self._refuse_other_size(stated_px)
        return decode_image(content, colour=colour, white_level=self.white_level, file=self.name)

    def _rows(self, message: Any, encoding: _Encoding) -> NDArray[np.uint8]:
        """(height, bytes of a row without padding) uint8, contiguous."""
        width, height, step = int(message.width), int(message.height), int(message.step)
        used, filtered = width * encoding.pixel_bytes, str(message.encoding).startswith("bayer")
        if (width % 2 and (filtered or encoding.channels == 2)) or (height % 2 and filtered):
            expected, got = f"an even size for {message.encoding}", f"{width} x {height}"
            raise DataError(self.name, field="width", expected=expected, got=got)
        if step < used:
            raise DataError(self.name, field="step", expected=f"at least {used} bytes a row", got=str(step))
        needed = step * (height - 1) + used  # some drivers leave out the padding of the last row
        if len(message.data) < needed:
            expected, got = f"{needed} bytes for {height} rows of {step}", str(len(message.data))
            raise DataError(self.name, field="data", expected=expected, got=got)
        return np.ascontiguousarray(np.ndarray((height, used), np.uint8, message.data, 0, (step, 1)))

    def _refuse_other_size(self, found_px: tuple[int, int]) -> None:
        if found_px != tuple(self.size_px):
            expected = "{} x {} px, as the rig file says".format(*self.size_px)
            raise DataError(self.name, field="image size", expected=expected, got="{} x {}".format(*found_px))
