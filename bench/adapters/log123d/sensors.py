"""Images and sweeps of a log: found again by their cells, decoded when they are read."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.adapters.log123d.tables import StoredCell
from bench.errors import DataError
from bench.lidar import LidarSweep
from bench.lidar.fields import sweep_of
from bench.lidar.laz_files import laz_coordinates, laz_points
from bench.lidar.sweep import LARGEST_BYTES
from bench.recordings.images import decode_image

ARROW_START, LAZ_START, DRACO_START = b"\xff\xff\xff\xff", b"LASF", b"DRACO"
TIMES, LIDARS = "timestamps", "ids"
LARGEST_INTENSITY = 255
TIME_HINT = "set the card's option motion_compensated: start or end if they are no times of the points"


@dataclass(frozen=True, slots=True, kw_only=True)
class LogImage(StoredCell):
    """An image in a log; a `bench.records.recording.StoredImage`."""

    def pixels(self, *, colour: bool) -> NDArray[np.uint8]:
        """Decode it: (height, width) uint8 grey or (height, width, 3) uint8 BGR.

        Raises:
            DataError: it cannot be read or decoded.
        """
        value = self.value()
        if isinstance(value, bytes):
            return decode_image(value, colour=colour, file=self.container)
        frame = _video_frame(self.container.with_suffix(".mp4"), int(value))
        return frame if colour else np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def _video_frame(file: Path, number: int) -> NDArray[np.uint8]:
    """A frame of a video, BGR; it is looked for from the last key frame."""
    video = cv2.VideoCapture(str(file), cv2.CAP_FFMPEG)
    try:
        video.set(cv2.CAP_PROP_POS_FRAMES, number)
        there = int(video.get(cv2.CAP_PROP_POS_FRAMES))
        read, frame = video.read()
    finally:
        video.release()
    if not read or there != number:
        got = "no such file" if not file.is_file() else f"frame {there}" if read else "none"
        raise DataError(file, expected=f"frame {number} of the video", got=got)
    return np.asarray(frame, dtype=np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogSweep(StoredCell):
    """A sweep in a log, and the reader of its `SweepRef`.

    Attributes:
        lidar_id: whose points are used, of several that are merged; None for all.
        as_measured: whether points are each at their own time; else all are as at the time of the sweep.
    """

    lidar_id: int | None
    as_measured: bool

    def content(self) -> bytes:
        """All that decides what is read."""
        return StoredCell.content(self) + repr((self.lidar_id, self.as_measured)).encode()

    def __call__(self, name: Path, timestamp_ns: int) -> LidarSweep:
        """Decode it.

        Args:
            name: of the sweep, for messages.
            timestamp_ns: its reference time.

        Raises:
            DataError: it cannot be read or decoded, or lacks what the card asks for.
        """
        value = self.value()
        if not isinstance(value, bytes):
            hint = "convert again with lidar_store_option: binary"
            got = "the path of a file of the original data set"
            raise DataError(name, expected="points in the log itself", got=got, hint=hint)
        fields = decode_points(value, name)
        points = np.column_stack([fields.pop(axis) for axis in "xyz"])
        if self.lidar_id is not None:
            if LIDARS not in fields:
                raise DataError(name, field=LIDARS, expected="the lidar of each point", got="none")
            own = fields[LIDARS] == self.lidar_id
            points, fields = points[own], {key: values[own] for key, values in fields.items()}
        if not self.as_measured:
            fields.pop(TIMES, None)
        return sweep_of(
            points,
            fields,
            timestamp_ns,
            name=name,
            time_unit="us",
            full_intensity=LARGEST_INTENSITY,
            time_hint=TIME_HINT,
        )


def decode_points(content: bytes, name: Path) -> dict[str, NDArray[Any]]:
    """Decode points, each coordinate and feature an array (N,).

    Args:
        content: an Arrow stream or a .laz file.
        name: for messages.

    Raises:
        DataError: neither of the two, or damaged.
    """
    if content.startswith(DRACO_START):
        hint = "convert again with lidar_codec: laz or ipc_zstd"
        raise DataError(name, expected="points as Arrow or .laz", got="Draco", hint=hint)
    if not content.startswith((ARROW_START, LAZ_START)):
        raise DataError(name, expected="points as Arrow or .laz", got=f"bytes that begin with {content[:8].hex(' ')}")
    try:
        fields = _from_arrow(content) if content.startswith(ARROW_START) else _from_laz(name, content)
    except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
        got = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise DataError(name, expected="whole points", got=got) from error
    if missing := set("xyz") - fields.keys():
        raise DataError(name, expected="the coordinates x, y and z", got=f"no {', '.join(sorted(missing))}")
    return fields


def _from_arrow(content: bytes) -> dict[str, NDArray[Any]]:
    with pa.ipc.open_stream(pa.BufferReader(content)) as stream:
        batch = stream.read_next_batch()
    batch.validate(full=True)
    if batch.nbytes > LARGEST_BYTES:
        raise ValueError(f"{batch.nbytes} bytes when unpacked")
    return {name: batch.column(name).to_numpy(zero_copy_only=False) for name in batch.schema.names}


def _from_laz(name: Path, content: bytes) -> dict[str, NDArray[Any]]:
    """Features that share the name of a dimension of the format have the prefix `extra_`."""
    points = laz_points(name, io.BytesIO(content))
    fields: dict[str, NDArray[Any]] = dict(zip("xyz", laz_coordinates(points).astype(np.float32).T, strict=True))
    for dimension in points.point_format.extra_dimension_names:
        fields[dimension.removeprefix("extra_")] = np.asarray(points[dimension])
    return fields
