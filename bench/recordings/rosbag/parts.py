"""Single images and sweeps of a bag, read and decoded when they are wanted; they travel to other processes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError
from bench.lidar import LidarSweep
from bench.recordings.rosbag.clouds import DecodedCloud, cloud_sweep
from bench.recordings.rosbag.images import compressed_pixels, image_pixels
from bench.recordings.rosbag.index import read_message
from bench.recordings.rosbag.messages import COMPRESSED_IMAGE, decode, header_stamp_ns, message_type
from bench.recordings.rosbag.rig import LidarRig
from bench.recordings.rosbag.storage import Place, Topic


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSource:
    """What the images of a camera have in common.

    Attributes:
        topic: that they were sent on.
        packed: each message is compressed for itself.
        size_px: (width, height) that they have.
        white_level: value of 16-bit images that is white.
    """

    topic: Topic
    packed: bool
    size_px: tuple[int, int]
    white_level: int


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarSource:
    """What the sweeps of a lidar have in common.

    Attributes:
        topic: that they were sent on.
        packed: each message is compressed for itself.
        rig: of the lidar.
    """

    topic: Topic
    packed: bool
    rig: LidarRig


@dataclass(frozen=True, slots=True)
class BagImage:
    """An image in a bag; a `bench.recordings.records.StoredImage`.

    Attributes:
        container: the file that holds it.
        place: where in the file.
        name: for messages.
        source: what it has in common with the camera's others.
    """

    container: Path
    place: Place
    name: Path
    source: CameraSource

    def content(self) -> bytes:
        """The message's bytes, behind what says how they are decoded."""
        return repr(self.source).encode() + self._message()

    def _message(self) -> bytes:
        return read_message(self.container, self.place, packed=self.source.packed)

    def pixels(self, *, colour: bool) -> NDArray[np.uint8]:
        """Decode it: (height, width) uint8 grey or (height, width, 3) uint8 BGR.

        Raises:
            DataError: it cannot be read or decoded, or has another size than the rig file says.
        """
        source = self.source
        message = decode(source.topic, self._message(), file=self.container)
        decoder = compressed_pixels if message_type(source.topic) == COMPRESSED_IMAGE else image_pixels
        return decoder(message, colour=colour, size_px=source.size_px, white_level=source.white_level, place=self.name)


@dataclass(frozen=True, slots=True)
class BagSweep:
    """A point cloud in a bag; a `bench.recordings.records.StoredPart`, and the reader of its `SweepRef`.

    Attributes:
        container: the file that holds it.
        place: where in the file.
        source: what it has in common with the lidar's others.
    """

    container: Path
    place: Place
    source: LidarSource

    def content(self) -> bytes:
        """The message's bytes, behind what says how they are decoded."""
        return repr(self.source).encode() + self._message()

    def _message(self) -> bytes:
        return read_message(self.container, self.place, packed=self.source.packed)

    def cloud(self, name: Path, timestamp_ns: int) -> DecodedCloud:
        """Decode it, with the number of points that were left out.

        Args:
            name: for messages.
            timestamp_ns: the sweep's reference time.

        Raises:
            DataError: it cannot be read or decoded, or stands in another frame than the rig file says.
        """
        topic, rig = self.source.topic, self.source.rig
        content = self._message()
        message: Any = decode(topic, content, file=self.container)
        frame = str(message.header.frame_id).lstrip("/")
        if rig.frame is not None and frame != rig.frame:
            do = "name this frame in the rig file, if its points are as measured"
            raise DataError(
                name, field="header.frame_id", expected=f"{rig.frame!r}, as the rig file says", got=repr(frame), do=do
            )
        stamp_ns = header_stamp_ns(content) or 0
        return cloud_sweep(message, timestamp_ns, stamp_ns=stamp_ns, rig=rig, place=name)

    def __call__(self, name: Path, timestamp_ns: int) -> LidarSweep:
        """The sweep of `cloud`."""
        return self.cloud(name, timestamp_ns).sweep
