"""Images and point clouds of a bag, found again by their position: decoded to grey or BGR, and to sweeps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.adapters.rosbag.messages import COMPRESSED_IMAGE, StoredMessage, decode, header_stamp_ns
from bench.adapters.rosbag.rig import LidarRig
from bench.errors import DataError
from bench.lidar.fields import sweep_of
from bench.lidar.sweep import LidarSweep
from bench.recordings.images import as_seen, decode_image


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
    name: Path = field(repr=False)

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
        kind = str(message.format)
        if "compressedDepth" in kind:
            raise DataError(self.name, field="format", expected="JPEG or PNG", got=repr(kind[:60]))
        pixels = decode_image(bytes(message.data), colour=colour, white_level=self.white_level, file=self.name)
        self._refuse_other_size((pixels.shape[1], pixels.shape[0]))
        return pixels

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

    def _refuse_other_size(self, size_px: tuple[int, int]) -> None:
        if size_px != tuple(self.size_px):
            expected = "{} x {} px, as the rig file says".format(*self.size_px)
            raise DataError(self.name, field="image size", expected=expected, got="{} x {}".format(*size_px))


TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # as PointField numbers them
TIME_HINT = "set time_unit of the lidar in the rig file"


@dataclass(frozen=True, slots=True)
class BagSweep(StoredMessage):
    """A point cloud in a bag, and the reader of its `SweepRef`.

    Attributes:
        rig: of the lidar.
    """

    rig: LidarRig

    def __call__(self, name: Path, timestamp_ns: int) -> LidarSweep:
        """Decode it.

        Args:
            name: of the sweep, for errors.
            timestamp_ns: the sweep's reference time.

        Raises:
            DataError: it cannot be read or decoded, or its points are in another frame than the rig file says.
        """
        payload = self.payload()
        message = decode(self.topic, payload, file=self.container)
        frame = str(message.header.frame_id).lstrip("/")
        if self.rig.frame is not None and frame != self.rig.frame:
            expected, hint = f"{self.rig.frame!r}, as the rig file says", "name this frame there, if its points are"
            raise DataError(
                name, field="header.frame_id", expected=expected, got=repr(frame), hint=f"{hint} as measured"
            )
        return cloud_sweep(message, timestamp_ns, stamp_ns=header_stamp_ns(payload), rig=self.rig, name=name)


def cloud_sweep(message: Any, timestamp_ns: int, *, stamp_ns: int, rig: LidarRig, name: Path) -> LidarSweep:
    """The points of a `sensor_msgs/PointCloud2` that have a position, in the order of the message.

    Args:
        message: decoded.
        timestamp_ns: the sweep's reference time, which stands for the message's stamp.
        stamp_ns: the stamp in the message's header, in the clock of times that count from the start of it.
        rig: of the lidar.
        name: of the sweep, for errors.

    Raises:
        DataError: fields that are missing or do not fit the data, or times that are none of this sweep.
    """
    rows = _structured(message, name)
    fields = {key: rows[key].astype(rows[key].dtype.newbyteorder("=")) for key in rows.dtype.names or ()}
    return sweep_of(
        np.stack([fields.pop(axis) for axis in "xyz"], axis=-1),
        fields,
        timestamp_ns,
        name=name,
        stamp_ns=stamp_ns,
        time_field=rig.time_field,
        time_unit=rig.time_unit,
        drop_origin=rig.drop_origin,
        time_hint=TIME_HINT,
    )


def _structured(message: Any, name: Path) -> NDArray[Any]:
    """(N,) of a structured type with the fields of the message."""
    width, height = int(message.width), int(message.height)
    step, row_step = int(message.point_step), int(message.row_step)
    dtype, used = _layout(message, step, name), width * step
    if height == 1:
        row_step = max(row_step, used)  # some drivers leave it 0 where it does not matter
    if row_step < used:
        raise DataError(name, field="row_step", expected=f"at least {used} bytes", got=str(row_step))
    needed = row_step * (height - 1) + used if width * height else 0
    if len(message.data) < needed:
        expected = f"{needed} bytes for {height} rows of {width} points"
        raise DataError(name, field="data", expected=expected, got=str(len(message.data)))
    return np.ndarray((height, width), dtype, np.ascontiguousarray(message.data), 0, (row_step, step)).reshape(-1)


def _layout(message: Any, step: int, name: Path) -> np.dtype[Any]:
    layout: dict[str, tuple[str, int]] = {}
    for entry in message.fields:
        field, kind, offset = str(entry.name), int(entry.datatype), int(entry.offset)
        if kind not in TYPES:
            raise DataError(name, field=f"fields, {field[:40]}", expected="a datatype from 1 to 8", got=str(kind))
        if int(entry.count) > 1 or not field or field in layout:
            continue  # padding, or more than one number a point, which nothing here asks for
        if offset + int(TYPES[kind][1]) > step:
            got = f"byte {offset} of points of {step} bytes"
            raise DataError(name, field=f"fields, {field[:40]}", expected="an offset inside the point", got=got)
        layout[field] = TYPES[kind], offset
    for axis in "xyz":
        if layout.get(axis, ("", 0))[0] not in ("f4", "f8"):
            got = ", ".join(layout)[:200] or "none"
            raise DataError(name, field="fields", expected=f"{axis} as float32 or float64", got=got)
    order = ">" if message.is_bigendian else "<"
    formats, offsets = [order + kind for kind, _ in layout.values()], [offset for _, offset in layout.values()]
    return np.dtype({"names": list(layout), "formats": formats, "offsets": offsets, "itemsize": step})
